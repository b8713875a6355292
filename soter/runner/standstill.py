"""Robots that get nowhere: for long without their AC, without it for good, or without ever having moved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from soter.rta import RobotSupervisor
from soter.runner.result import StallFigures

STALL_S: Final = 300.0
"""A robot that has been without its AC for so long, and not charging, is stalled."""

MOVED_M: Final = 0.05
LEAST_RUN_S: Final = 60.0
"""A run that is no longer does not say whether a robot moves."""

_FULL: Final = 0.999
"""A robot with such a charge is not charging, even if it stands on its station for that."""


@dataclass(frozen=True, slots=True)
class Stalled:
    """A time of at least `STALL_S` in which a robot was without its AC and not charging.

    Attributes:
        robot_id: which robot.
        start_s: fleet time at which it began.
        end_s: fleet time at which it ended; None while it goes on.
        module: whose safe controller had the robot, when it was last looked at.
        cause: why, in words.
    """

    robot_id: int
    start_s: float
    end_s: float | None
    module: str
    cause: str


class Standstill:
    """One robot, looked at a few times a second.

    Attributes:
        longest_s: longest time without the AC while not charging, up to the last look.
        stalls: those that were stalls.
        moved_m: how far it got from where it was first seen.
    """

    __slots__ = ("_begin", "_robot_id", "_since_s", "longest_s", "moved_m", "stalls")

    def __init__(self, robot_id: int) -> None:
        self._robot_id: Final = robot_id
        self._begin: tuple[float, float] | None = None
        self._since_s = math.nan
        self.longest_s = 0.0
        self.stalls: list[Stalled] = []
        self.moved_m = 0.0

    def look(self, now_s: float, robot: RobotSupervisor, *, charging: bool) -> None:
        """Take one look.

        Args:
            now_s: fleet time.
            robot: its supervisor.
            charging: whether it stands on its station because it has to charge.
        """
        own, driver = robot.situation.own, robot.driver
        begin = self._begin = self._begin or (own.x_m, own.y_m)
        self.moved_m = max(self.moved_m, math.hypot(own.x_m - begin[0], own.y_m - begin[1]))
        charging = charging and not (own.battery is not None and own.battery >= _FULL)
        # A robot whose AC has failed for good is its safe controllers' for the rest of the run, as it ought to be.
        if driver is None or charging or robot.ac_failure:
            if self.stalls and self.stalls[-1].end_s is None:
                self.stalls[-1] = replace(self.stalls[-1], end_s=now_s)
            self._since_s = math.nan
            return
        if math.isnan(self._since_s):
            self._since_s = now_s
        lasted_s = now_s - self._since_s
        self.longest_s = max(self.longest_s, lasted_s)
        if lasted_s >= STALL_S:
            goes_on = bool(self.stalls) and self.stalls[-1].end_s is None
            stalled = Stalled(self._robot_id, self._since_s, None, driver.name, driver.cause)
            self.stalls[-1 if goes_on else len(self.stalls) :] = [stalled]


class Standstills:
    """All robots of a run."""

    def __init__(self, robot_ids: Sequence[int]) -> None:
        self.robots: Final = {robot_id: Standstill(robot_id) for robot_id in robot_ids}

    @property
    def longest_s(self) -> float:
        """The longest time that a robot was without its AC and not charging."""
        return max((robot.longest_s for robot in self.robots.values()), default=0.0)

    def stalls(self) -> list[Stalled]:
        """Return every stall up to now."""
        return [stalled for robot in self.robots.values() for stalled in robot.stalls]

    def permanent(self, end_s: float) -> dict[int, StallFigures]:
        """Return, by robot, the stalls that went on at the end of the run, at fleet time `end_s`."""
        return {
            each.robot_id: StallFigures(
                since_s=round(each.start_s, 6), lasted_s=round(end_s - each.start_s, 6), module=each.module,
                cause=each.cause,
            )
            for each in self.stalls()
            if each.end_s is None
        }  # fmt: skip

    def never_moved(self, duration_s: float) -> tuple[int, ...]:
        """Return the robots that never moved in a run of this length, whatever they had to do."""
        if duration_s <= LEAST_RUN_S:
            return ()
        return tuple(robot_id for robot_id, robot in self.robots.items() if robot.moved_m <= MOVED_M)
