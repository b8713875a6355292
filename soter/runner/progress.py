"""The progress of a run, and those who follow it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, Self

from soter.record.messages import AC
from soter.rta import RobotSupervisor
from soter.runner.metrics import Metrics

NOBODY: Final = "nobody"
"""In place of a driver's name, for a robot that does not obey."""

STARTING: Final = "starting"
"""In place of a driver's name, for a robot whose AC has not had it yet, since every module begins in SC."""


class RobotProgress(NamedTuple):
    """One robot at one moment.

    Attributes:
        robot_id: which robot.
        x_m: east.
        y_m: north.
        driver: "AC", the safety module that drives, `NOBODY` while the robot is not under control, or `STARTING`.
        cause: why a module drives, or why none does; empty else.
        battery: charge from 0 to 1, or None.
        margins: by module, the margin at its decision module's last look, in the module's unit.
        targets_reached: number so far.
        disengagements: number so far.
    """

    robot_id: int
    x_m: float
    y_m: float
    driver: str
    cause: str
    battery: float | None
    margins: dict[str, float]
    targets_reached: int
    disengagements: int


class Progress(NamedTuple):
    """A run at one moment.

    Attributes:
        time_s: fleet time.
        duration_s: fleet time at which it will end.
        wall_s: host time since the start.
        robots: the progress of all robots.
        violations: number so far by rule, or None without truth.
    """

    time_s: float
    duration_s: float
    wall_s: float
    robots: tuple[RobotProgress, ...]
    violations: dict[str, int] | None


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Follower:
    """Callbacks of a program that follows a run, and may end it.

    Attributes:
        show: called with the run's progress when the robots begin to move, and every `every_s`; or None.
        every_s: host time between two calls.
        stop: called at every tick; returns whether to end the run early, as Ctrl-C does.
        pace: called after every tick with the fleet time that has passed; the next tick waits until it returns. For
            virtual time: a wall clock has a pace of its own.
        connecting: returns a context manager that is entered while `stop` is not called: while modules are proved and
            tried, and, for robots on a wire, while they and the mission's process get ready. An exception ends the run.
        trying: called before robots are opened with what is tried, in words; trials of users' modules take seconds.
        say: called with which other processes of a distributed mission are missing.
        recording: called before the first tick with the recording's file, once it has the mission in it.
        falls_of: the rule whose least margin is followed, see `soter.runner.Run`; empty for none.
    """

    show: Callable[[Progress], None] | None = None
    every_s: float = 0.2
    stop: Callable[[], bool] = lambda: False
    pace: Callable[[float], None] | None = None
    connecting: Callable[[], AbstractContextManager[object]] | None = None
    trying: Callable[[str], None] | None = None
    say: Callable[[str], None] = logger.warning
    recording: Callable[[Path], None] | None = None
    falls_of: str = ""


def robot_progress(robots: Sequence[RobotSupervisor], metrics: Metrics) -> tuple[RobotProgress, ...]:
    """Return the progress of the robots."""
    return tuple(
        RobotProgress(
            robot.robot_id,
            robot.situation.own.x_m,
            robot.situation.own.y_m,
            *_driver(robot),
            robot.situation.own.battery,
            {module.name: module.margin for module in robot.modules},
            metrics.reached_by_robot[robot.robot_id],
            metrics.disengagements_by_robot[robot.robot_id],
        )
        for robot in robots
    )


def _driver(robot: RobotSupervisor) -> tuple[str, str]:
    """Return who drives a robot, and why."""
    if robot.uncontrolled:
        return NOBODY, robot.uncontrolled
    if robot.driver is None:
        return AC, ""
    return (STARTING, "") if robot.driver.begins(robot.situation.now_s) else (robot.driver.name, robot.driver.cause)


_LAST_S: Final = 1.0
"""How long the end of a run waits for the thread to finish showing."""


class ProgressThread:
    """A thread that shows the latest progress beside the ticks. A context manager.

    A terminal that is slow or stopped delays no tick.

    Args:
        show: called in the thread; not called again once it has raised.
    """

    def __init__(self, show: Callable[[Progress], None]) -> None:
        self._show: Final = show
        self._latest: Progress | None = None
        self._wake: Final = threading.Event()
        self._done = False
        self._thread: Final = threading.Thread(target=self._run, name="progress", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done = True
        self._wake.set()
        self._thread.join(_LAST_S)

    def put(self, progress: Progress) -> None:
        """Have progress shown, in place of any that still waits; returns at once."""
        self._latest = progress
        self._wake.set()

    def _run(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            latest, self._latest = self._latest, None
            if latest is not None:
                try:
                    self._show(latest)
                except Exception:
                    logger.exception("progress cannot be shown any more")
                    return
            if self._done:
                return
