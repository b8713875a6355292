"""The events of the mission's machines. Positions in metres, workspace frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from soter.machine import Event, MachineRef

Place = tuple[float, float]


class TargetOutcome(Enum):
    """How a target ended.

    `unsafe`: a geofence or obstacle module had to step in on the way; retrying such a target would only repeat that.
    `blocked`: given up after the AC lost control too often for other reasons, or after no plan led there.
    """

    REACHED = "reached"
    UNSAFE = "unsafe"
    BLOCKED = "blocked"
    TIMED_OUT = "timed_out"


OUTCOMES: Final = {outcome.value: outcome for outcome in TargetOutcome}

TRIES: Final = 3


@dataclass(frozen=True, slots=True)
class VisitTarget(Event):
    """Task planner to robot agent: go there.

    Attributes:
        target_id: the task planner's number for it.
        place: where.
        timeout_s: time with the AC in control after which it is given up; None for that of the mission file.
        tries: how often the AC may lose control on the way, or a path come to nothing, before it is given up.
    """

    target_id: int
    place: Place
    timeout_s: float | None = None
    tries: int = TRIES


@dataclass(frozen=True, slots=True)
class TargetEnded(Event):
    """Robot agent to task planner: that target is done with.

    Attributes:
        robot_id: whose.
        target_id: which.
        outcome: how it ended.
        module: the safety module that took the robot over and so ended it; empty for any other end.
        reason: why it took the robot, or why no path led there, in words; empty where there is nothing to say.
    """

    robot_id: int
    target_id: int
    outcome: TargetOutcome
    module: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class RobotJoined(Event):
    """Task planner to robot agents: there is another robot."""

    robot_id: int
    agent: MachineRef


@dataclass(frozen=True, slots=True)
class PlanAndGo(Event):
    """Robot agent to motion planner: plan a path to there and have it executed."""

    request_id: int
    place: Place
    timeout_s: float
    reply_to: MachineRef


@dataclass(frozen=True, slots=True)
class PathPlanned(Event):
    """Planner service to motion planner: the answer; without a path, the reason."""

    request_id: int
    path: tuple[Place, ...]
    reason: str | None
    reaches_goal: bool


@dataclass(frozen=True, slots=True)
class ExecutePath(Event):
    """Motion planner to plan executor: drive these waypoints one after the other."""

    request_id: int
    path: tuple[Place, ...]
    timeout_s: float
    reply_to: MachineRef


@dataclass(frozen=True, slots=True)
class AbandonPath(Event):
    """Robot agent to motion planner to plan executor: whatever you are doing, drop it."""

    request_id: int


@dataclass(frozen=True, slots=True)
class PathCompleted(Event):
    """Back up the chain: the path's last waypoint is reached. `at_target` is False if the path ended short of it."""

    request_id: int
    at_target: bool = True


@dataclass(frozen=True, slots=True)
class PathFailed(Event):
    """Back up the chain: no path, or a waypoint was not reached."""

    request_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class GoalEnded(Event):
    """Port to plan executor: a goal ended; status as in the narrow interface."""

    goal_id: int
    status: str


@dataclass(frozen=True, slots=True)
class Disengaged(Event):
    """Port to the robot's machines: the AC has lost control."""

    module: str
    cause: str


@dataclass(frozen=True, slots=True)
class Reengaged(Event):
    """Port to the robot's machines: the AC has control."""


@dataclass(frozen=True, slots=True)
class TargetTimeout(Event):
    """A robot agent's own timer."""

    target_id: int


@dataclass(frozen=True, slots=True)
class LookAbout(Event):
    """A robot agent's own timer: are there robots that it is about to meet?"""


@dataclass(frozen=True, slots=True)
class TryAgain(Event):
    """A robot agent's own timer, after a plan that came to nothing."""

    target_id: int
