"""The events of the mission's machines. Positions in metres, workspace frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from soter.machine import Event, MachineRef

Place = tuple[float, float]


class TargetOutcome(Enum):
    """How a target ended.

    `unsafe`: the geofence or obstacle module took control on the way; a retry would only repeat that.
    `blocked`: given up after the AC lost control too often for other reasons, or no plan led there.
    """

    REACHED = "reached"
    UNSAFE = "unsafe"
    BLOCKED = "blocked"
    TIMED_OUT = "timed_out"


OUTCOMES: Final = {outcome.value: outcome for outcome in TargetOutcome}

TRIES: Final = 3


@dataclass(frozen=True, slots=True)
class VisitTarget(Event):
    """Task planner to robot agent: visit a target.

    Attributes:
        target_id: the task planner's number for it.
        place: where the target is.
        timeout_s: time with the AC in control after which it is given up; None for the mission file's.
        tries: number of losses of control and failed paths after which it is given up.
    """

    target_id: int
    place: Place
    timeout_s: float | None = None
    tries: int = TRIES


@dataclass(frozen=True, slots=True)
class TargetEnded(Event):
    """Robot agent to task planner: a target has ended.

    Attributes:
        robot_id: the robot that it was given to.
        target_id: the task planner's number for it.
        outcome: how it ended.
        module: the safety module that ended it by taking the robot over; empty for any other end.
        reason: why the module took the robot, or why no path led there; empty if there is no reason to give.
    """

    robot_id: int
    target_id: int
    outcome: TargetOutcome
    module: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class RobotJoined(Event):
    """Task planner to robot agents: another robot has joined."""

    robot_id: int
    agent: MachineRef


@dataclass(frozen=True, slots=True)
class PlanAndGo(Event):
    """Robot agent to motion planner: plan a path to a place and have it executed."""

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
    """Robot agent to motion planner to plan executor: drop the path."""

    request_id: int


@dataclass(frozen=True, slots=True)
class PathCompleted(Event):
    """Back up the chain: the path's last waypoint is reached. `at_target` is False if the path ended short of it."""

    request_id: int
    at_target: bool = True


@dataclass(frozen=True, slots=True)
class PathFailed(Event):
    """Back up the chain: there is no path, or a waypoint was not reached."""

    request_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class GoalEnded(Event):
    """Port to plan executor: a goal ended; the status is that of `GoalReport`."""

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
    """A robot agent's own timer: time to look for robots that it is about to meet."""


@dataclass(frozen=True, slots=True)
class TryAgain(Event):
    """A robot agent's own timer: time to retry after a failed path."""

    target_id: int
