"""The base of all faults, which act between SOTER and one robot: on commands, on samples, or on the vehicle itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from enum import Enum
from random import Random
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Generic,
    Literal,
    NamedTuple,
    Protocol,
    Self,
    TypeVar,
    runtime_checkable,
)

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, WrapValidator, model_validator

from soter.config.table import RobotId, Table, wrong
from soter.geometry.workspace import MAX_ROBOT_ID
from soter.problems import not_allowed
from soter.sdk import Capabilities, Controller, Goal, RobotState, Waypoint

Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
Interval = Annotated[float, Field(ge=0.001, le=1e7, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]

ROUNDING_S: Final = 1e-9


def _all_or_one(value: object, handler: ValidatorFunctionWrapHandler) -> object:
    """Say once what is allowed; a union says it of each of its parts, by keys that no file has."""
    try:
        return handler(value)
    except ValidationError as failure:
        raise not_allowed(f"'all', or the id of a robot, a whole number from 1 to {MAX_ROBOT_ID}") from failure


class FaultOptions(Table):
    """The part of a `[[fault]]` table that all kinds share; each kind's own model adds its parameters.

    Attributes:
        kind: a built-in kind, or a class as `module:Class`.
        robot: the id of the affected robot, or "all".
        start_s: when the fault begins, in seconds after the robot is ready.
        duration_s: how long it lasts; by default to the end of the run.
        every_s: time between two beginnings; by default the fault does not repeat.
        declared: whether the robot's promise is widened by the fault, so that the safety modules allow for it. The
            stack does not know of an undeclared fault, which breaks the promise.
    """

    kind: str
    robot: Annotated[Literal["all"] | RobotId, WrapValidator(_all_or_one)] = "all"
    start_s: Seconds = 0.0
    duration_s: Interval | None = None
    every_s: Interval | None = None
    declared: bool = True

    @model_validator(mode="after")
    def _repeats_after_its_end(self) -> Self:
        if self.every_s is not None and (self.duration_s is None or self.duration_s >= self.every_s):
            least = (
                "a fault with a duration_s" if self.duration_s is None else f"above duration_s, {self.duration_s:.12g}"
            )
            raise wrong(("every_s",), self.every_s, least)
        return self

    @property
    def pause_s(self) -> float:
        """How long the fault is off between two times; 0 without an end, infinite without a repetition."""
        if self.duration_s is None:
            return 0.0
        return math.inf if self.every_s is None else self.every_s - self.duration_s

    def active(self, time_s: float) -> bool:
        """Return whether the fault is on at a time in seconds after the robot was ready."""
        since_s = time_s - self.start_s + ROUNDING_S
        if since_s < 0.0:
            return False
        if self.duration_s is None:
            return True
        if self.every_s is not None:
            since_s %= self.every_s
        return since_s < self.duration_s

    def window(self, time_s: float) -> int | None:
        """Return how often the fault has repeated at a time in seconds after the robot was ready; None if it is off."""
        if not self.active(time_s):
            return None
        return 0 if self.every_s is None else int((time_s - self.start_s + ROUNDING_S) // self.every_s)

    def end_s(self, time_s: float) -> float:
        """Return when a fault that is on at a time ends, in seconds after the robot was ready; infinite if never."""
        if self.duration_s is None:
            return math.inf
        since_s = time_s - self.start_s + ROUNDING_S
        if self.every_s is not None:
            since_s %= self.every_s
        return time_s + self.duration_s - since_s


T = TypeVar("T")
O = TypeVar("O", bound=FaultOptions)  # noqa: E741 - the options of one kind


class Call(Enum):
    """The kinds of commands to a robot."""

    GOTO = "goto"
    HALT = "halt"
    SWITCH = "switch"
    RENEW = "renew"


@dataclass(frozen=True, slots=True)
class SentCommand:
    """One command on its way to the robot.

    Attributes:
        call: the kind of the command.
        goal: the goal to go to, or None.
        target: the goal's waypoint, as it will arrive; None without a goal.
        to: the controller to make active, or None.
    """

    call: Call
    goal: Goal | None = None
    target: Waypoint | None = None
    to: Controller | None = None


class Passage(NamedTuple):
    """One arrival of a command: a doubled command has several passages, a lost one has none.

    Attributes:
        command: the command as it arrives.
        delay_s: how late it arrives.
        overtakes: whether it may arrive before earlier commands; else the order is kept.
    """

    command: SentCommand
    delay_s: float = 0.0
    overtakes: bool = False


class Impairment(NamedTuple):
    """The defects of a vehicle. The defaults mean no defect.

    Attributes:
        left: part of the left wheel's motion that reaches the ground, from 0 to 1.
        right: the same of the right wheel.
        brake: part of the deceleration that the brakes still have, from 0 to 1.
        alive: False for a vehicle with motors off, which does not answer, and forgets everything.
    """

    left: float = 1.0
    right: float = 1.0
    brake: float = 1.0
    alive: bool = True

    def joined(self, other: Impairment) -> Impairment:
        """Return the impairment of a vehicle that has both."""
        return Impairment(
            self.left * other.left, self.right * other.right, min(self.brake, other.brake), self.alive and other.alive
        )


@runtime_checkable
class Impairable(Protocol):
    """A robot whose vehicle can be impaired; an optional hook of robots simulated in this process."""

    def impair(self, left: float, right: float, brake: float, alive: bool) -> None:
        """Impair the vehicle from now on; see `Impairment`. Ones and True end the impairment."""


class Spacing(NamedTuple):
    """A fault's effect on the time between new samples, in readings of the state.

    New samples at most g readings apart are at most (dropped + 1) g + held apart behind the fault. `Fault.widened` adds
    the age that `dropped` costs for g = 1; `widened` in `soter.faults.robot` adds as much for each reading beyond.

    Attributes:
        dropped: how many new samples in a row may be lost.
        held: how many readings longer one sample may be delayed than another.
    """

    dropped: int = 0
    held: int = 0


@dataclass(frozen=True, slots=True)
class Context:
    """The circumstances of a fault, besides its table.

    Attributes:
        robot_id: the affected robot.
        tick_s: time between two readings of the state.
        random: the fault's own source of random numbers; the same mission gives the same faults.
    """

    robot_id: int
    tick_s: float
    random: Random


class Fault(Generic[O]):
    """One fault of one robot. A kind overrides the methods for what it changes; the others pass everything unchanged.

    Times are seconds after the robot was ready. Supervisor's thread only.

    Attributes:
        affected: number of commands and samples changed so far, or of times that the vehicle was impaired.
    """

    options_model: ClassVar[type[FaultOptions]]
    needs_vehicle: ClassVar[bool] = False
    """Whether the robot must be `Impairable`."""

    def __init__(self, options: O, context: Context) -> None:
        self.options: Final = options
        self.context: Final = context
        self.affected = 0

    def widened(self, capabilities: Capabilities) -> Capabilities:
        """Return the robot's promise with this fault, for a new sample at every reading.

        If new samples are rarer, `spacing` gives the additional cost.
        """
        return capabilities

    def spacing(self) -> Spacing:
        """Return this fault's effect on the time between new samples."""
        return Spacing()

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        """Return the arrivals of a command that is sent while the fault is on."""
        return (Passage(command),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        """Return the sample to show in place of the robot's latest, or None for none.

        Called at every reading of the state, even while the fault is off: some faults remember earlier samples.
        """
        return sample

    def impairment(self) -> Impairment | None:
        """Return the vehicle's impairment while the fault is on; None for none."""
        return None

    def ticks(self, duration_s: float) -> int:
        """Return a duration in readings of the state, rounded up: a late sample is seen at the next reading."""
        return max(0, math.ceil((duration_s - 1e-9) / self.context.tick_s))

    def up_to_ticks(self, duration_s: float) -> float:
        """Return a duration rounded up to whole readings of the state."""
        return self.ticks(duration_s) * self.context.tick_s


def widened(
    capabilities: Capabilities,
    faults: Sequence[Fault[Any]],
    blaming: Callable[[int], AbstractContextManager[None]] = lambda index: nullcontext(),
) -> Capabilities:
    """Return a robot's promise under its faults; undeclared faults change nothing.

    The costs of faults more than add up: behind a fault that lets a new sample through at every other reading, each
    lost sample costs two readings.

    Args:
        capabilities: the promise without faults.
        faults: the robot's faults, in the order of their tables.
        blaming: returns the context in which a fault is asked, by its index.
    """
    apart, exact_s = 1, capabilities.sample_age_s
    for index, fault in enumerate(faults):
        if fault.options.declared:
            with blaming(index):
                dropped, held = agreed(fault.spacing(), Spacing)
                if min(dropped, held) < 0:
                    raise ValueError(f"its spacing is {dropped} and {held}, allowed: 0 or more")
                wider = agreed(fault.widened(capabilities), Capabilities)
                if (name := capabilities.widened_beyond(wider)) is not None:
                    better, before = getattr(wider, name), getattr(capabilities, name)
                    raise ValueError(
                        f"it makes {name} better, {better} in place of {before}; a fault can only widen it"
                    )
                capabilities = wider
                further_s = dropped * (apart - 1) * fault.context.tick_s
                capabilities = replace(capabilities, sample_age_s=capabilities.sample_age_s + further_s)
                apart = (dropped + 1) * apart + held
    if capabilities.sample_age_s > exact_s:
        # Ages counted in readings grow by the readings' own jitter, once.
        with blaming(len(faults) - 1):
            capabilities = replace(capabilities, sample_age_s=capabilities.sample_age_s + capabilities.jitter_s)
    return capabilities


def agreed(value: T, kind: type[T]) -> T:
    """Return an answer of a fault, which may be of a user's class; raises TypeError if it is of another type."""
    if not isinstance(value, kind):
        raise TypeError(f"it answers {value!r:.200}, allowed: a {kind.__name__}")
    return value
