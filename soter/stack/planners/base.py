"""The interface of planners: requests, results, and the virtual time that a result costs."""

from __future__ import annotations

import hashlib
import math
import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field

from soter.geometry.workspace import Workspace

Point = tuple[float, float]
"""A point of the workspace: x and y in metres."""

CHECK_COST_S = 20e-6
"""Virtual time that one state validity check takes, in seconds."""

MAX_COST_S = 1.0
"""The most virtual time that a plan costs, in seconds, and the cost of a failure with an unknown number of checks."""

MAX_WAYPOINTS = 1000
"""Most waypoints of a path; a longer one is treated as garbage."""


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """One request to a planner. The result must depend on nothing else.

    Attributes:
        request_id: number of the request, unique within a run.
        robot_id: the robot that wants to move.
        start: where its centre is, x and y in metres.
        goal: where its centre is to go, x and y in metres; it may be outside the fence or inside boxes.
        discs: other robots to keep away from: x and y in metres, and the distance in metres that the centre of
            this robot must keep from there (the planner adds nothing to it).
        seed: the seed of the run or of the request; the planner mixes it with both ids.
    """

    request_id: int
    robot_id: int
    start: Point
    goal: Point
    discs: tuple[tuple[float, float, float], ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        numbers = (*self.start, *self.goal, *(value for disc in self.discs for value in disc))
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"a plan request needs finite numbers, got {self}")

    def random_seed(self) -> int:
        """Return a seed from 1 to 2**32 - 1 derived from seed, robot and request, the same in every process."""
        text = f"{self.seed}/{self.robot_id}/{self.request_id}".encode()
        (value,) = struct.unpack("<I", hashlib.blake2b(text, digest_size=4).digest())
        return int(value) or 1


@dataclass(frozen=True, slots=True)
class PlanResult:
    """The result of a request: a path, or the reason why there is none.

    Attributes:
        request_id: the request that this answers.
        path: waypoints without the start, x and y in metres; empty if and only if the plan failed.
        checks: number of state and motion validity checks, which decides what the plan costs.
        reason: why there is no path; None if there is one.
        reaches_goal: whether the path ends at the goal itself, not at the nearest point free of other robots.
    """

    request_id: int
    path: tuple[Point, ...] = ()
    checks: int = 0
    reason: str | None = None
    reaches_goal: bool = True

    @property
    def ok(self) -> bool:
        """Whether there is a path."""
        return self.reason is None

    @property
    def cost_s(self) -> float:
        """Virtual time in seconds between the request and the delivery of this result."""
        return min(max(self.checks, 1) * CHECK_COST_S, MAX_COST_S)

    @classmethod
    def failed(cls, request_id: int, reason: str, checks: int | None = None) -> Self:
        """Return a failure.

        Args:
            request_id: the request that failed.
            reason: why it failed, for people to read.
            checks: number of checks made; None, if the planner cannot be trusted to know, costs the maximum.
        """
        spent = round(MAX_COST_S / CHECK_COST_S) if checks is None else checks
        return cls(request_id, (), spent, reason, False)


class PlannerOptions(BaseModel):
    """Options of every planner in `[planners.NAME]`; a planner's own model adds more.

    Attributes:
        clearance_m: distance in metres that a planned path keeps between the body and every box.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    clearance_m: float = Field(default=0.15, ge=0.0, le=10.0)


class Planner(ABC):
    """A motion planner. Untrusted: the service runs it in a process of its own and checks what it returns.

    Plans must be reproducible: `plan()` may depend on the arguments of the constructor and on the request, not on
    time, on the process or on earlier requests. Random numbers come from `request.random_seed()`.

    Args:
        workspace: the known fence and boxes.
        body_radius_m: radius of the robot's round body, in metres.
        options: the options, an instance of `options_model`.
    """

    options_model: ClassVar[type[PlannerOptions]] = PlannerOptions
    """The model that validates the planner's options; a subclass of `PlannerOptions`."""

    def __init__(self, workspace: Workspace, body_radius_m: float, options: PlannerOptions) -> None:
        self.workspace, self.body_radius_m, self.options = workspace, body_radius_m, options

    @abstractmethod
    def plan(self, request: PlanRequest) -> PlanResult:
        """Return a path for the request, or a failure; the service gives it ten seconds of host time."""


class StraightLine(Planner):
    """Answers every request with its goal, whatever stands in the way; costs one check.

    Only the safety modules then keep the robot from boxes, which makes it a cheap application that needs protection.
    """

    def plan(self, request: PlanRequest) -> PlanResult:
        return PlanResult(request.request_id, (request.goal,), checks=1)
