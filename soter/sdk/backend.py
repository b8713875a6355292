"""Backends, which open robots, and fleets, which are the robots of an opened backend."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, ClassVar, Protocol, Self, get_args

from pydantic import BaseModel, ConfigDict, InstanceOf

from soter.clock import Clock
from soter.config.promises import Promise
from soter.errors import Unsupported
from soter.geometry.workspace import Workspace
from soter.sdk.capabilities import Capabilities
from soter.sdk.robot import Robot
from soter.sdk.values import (
    RULES,
    FaultReport,
    HeldMission,
    RobotSpec,
    RuleLimits,
    TruthReport,
    Violation,
)

__all__ = ["INTERFACE_VERSION", "RULES", "Backend", "BackendConfig", "Fleet", "Truth", "TruthReport", "Violation"]

INTERFACE_VERSION = 1
"""The version of this interface; a backend written for another one is refused by name."""

CLOSE_TIMEOUT_S = 5.0


class Truth(Protocol):
    """Ground truth of a simulated world, on a channel of its own, never through the adapter."""

    def report(self) -> TruthReport:
        """Return what has happened up to now."""

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad."""


def _models_of(kind: Any) -> Iterator[type[BaseModel]]:
    """Yield the models of a type: itself, if it is one, those of its fields, and those of what it consists of."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
        for field in kind.model_fields.values():
            yield from _models_of(field.annotation)
    for part in get_args(kind):
        yield from _models_of(part)


class BackendConfig(BaseModel):
    """The configuration of every backend. A backend's own model adds options, given in `[backends.NAME]`.

    Options that the model does not have are refused. One that accepts them, itself or in a table, raises TypeError.

    Attributes:
        workspace: set by the runner; a simulated backend builds its world from it.
        seed: set by the runner.
        limits: set by the runner; a simulated backend judges its world by them.
        promise: promises that replace declared ones; a backend may narrow it by a model of its own.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    workspace: InstanceOf[Workspace]
    seed: int = 0
    limits: InstanceOf[RuleLimits] = RuleLimits()
    promise: Promise = Promise()

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        super().__pydantic_init_subclass__(**options)
        for model in _models_of(cls):
            extra = model.model_config.get("extra", "ignore")
            if extra != "forbid":
                raise TypeError(
                    f"{cls.__qualname__}: model_config of {model.__qualname__} has extra = {extra!r}, allowed: "
                    "'forbid': a misspelt option would be accepted, and do nothing"
                )


class Fleet(ABC):
    """The robots of an opened backend. A context manager: leaving it stops and closes every robot.

    Args:
        clock: fleet time.
        robots: in the order in which they were requested.
        truth: ground truth of a simulated world, else None.
    """

    def __init__(self, clock: Clock, robots: Sequence[Robot], truth: Truth | None) -> None:
        self.clock = clock
        self.robots = tuple(robots)
        self.truth = truth

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop and close every robot, then what they share, whatever fails on the way. Idempotent.

        Raises:
            BaseException: the first failure, or Ctrl-C, after everything else has been closed.
        """
        failures: list[BaseException] = []
        for robot in self.robots:
            try:
                robot.close(CLOSE_TIMEOUT_S)
            except BaseException as failure:  # noqa: BLE001 - the other robots must be stopped too
                failures.append(failure)
        try:
            self._close()
        except BaseException as failure:  # noqa: BLE001 - raised below
            failures.append(failure)
        if failures:
            raise failures[0]

    def lost(self) -> str:
        """Return, in words, which process that was started for these robots has ended; empty for none.

        Called at every tick; must not wait. Empty, too, if no process was started for them.
        """
        return ""

    def injected(self) -> Sequence[FaultReport]:
        """Return what injected faults did up to now, always in the same order; empty without fault injection."""
        return ()

    @abstractmethod
    def _close(self) -> None:
        """Free what the robots share. Called after all robots are closed; must be idempotent."""


class Backend(ABC):
    """Opens robots of one kind. Registered under the entry-point group `soter.adapters`."""

    interface_version: ClassVar[int]
    config_model: ClassVar[type[BackendConfig]]
    robot_class: ClassVar[type[Robot]]

    @classmethod
    def promises(cls, config: Any) -> Capabilities:
        """Return what robots promise under these options, before any is opened.

        These are the declared promises, with those of `config.promise` in their place; an override may add to this,
        but not drop it.
        """
        return replace(cls.robot_class.declared, **config.promise.given)

    @abstractmethod
    def open(self, config: Any, robots: Sequence[RobotSpec]) -> Fleet:
        """Open the robots; they are not ready before `init()`.

        Args:
            config: the options.
            robots: the robots, and what each is to promise; see `RobotSpec.promised`.

        Raises:
            RobotUnavailable: a robot cannot be opened.
        """

    def read_missions(self, config: Any, robot_ids: Sequence[int], timeout_s: float) -> dict[int, HeldMission]:
        """Return the missions that robots hold, by id; nothing moves.

        Raises:
            Unsupported: robots of this backend hold no missions.
            RobotUnavailable: a robot does not answer in time.
        """
        raise Unsupported("its robots hold no missions of their own; those of mavlink and mavsdk do")
