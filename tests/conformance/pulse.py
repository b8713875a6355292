"""A robot that is nothing but the renewals in a file: it moves while the last one is younger than its lease.

So that a process that drives can be killed or hang, and the robot lives on without a process of its own.
"""

from __future__ import annotations

import subprocess
import threading
import time
from pathlib import Path
from typing import ClassVar

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.clock import Clock
from soter.conformance.driver import spawn
from soter.sdk import Capabilities, Controller, Fleet, Goal, Link, Robot, RobotSpec, RobotState, Waypoint
from tests.conformance.wire import WireHarness, WireRobot

SPEC = RobotSpec(1, 2.0, 3.5, 0.4)


class HostClock(Clock):
    """Time as every process of this host sees it."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, time_s: float) -> None:
        time.sleep(max(time_s - time.monotonic(), 0.0))


class PulseRobot(Robot):
    """Writes a line for each renewal."""

    declared: ClassVar[Capabilities] = SimulatedRobot.declared

    def __init__(self, clock: Clock, file: Path) -> None:
        super().__init__(SPEC, clock)
        self.file = file

    def _connect(self, timeout_s: float) -> Capabilities:
        return self.declared

    def _renew_lease(self) -> None:
        with self.file.open("a", encoding="ascii") as file:
            file.write(f"{time.monotonic()}\n")

    def _sample(self) -> RobotState:
        now_s = self.clock.now()
        return RobotState(1, now_s, now_s, 2.0, 3.5, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0, Controller.AC, None, Link.UP)

    def _send_goto(self, goal: Goal) -> None:
        pass

    def _hand_over(self, to: Controller) -> None:
        pass

    def _halt(self) -> None:
        pass

    def _disconnect(self, timeout_s: float) -> None:
        pass


class PulseFleet(Fleet):
    def _close(self) -> None:
        pass


def open_fleet(file: str) -> Fleet:
    """Open the robot of a file; what the driving process calls."""
    clock = HostClock()
    return PulseFleet(clock, [PulseRobot(clock, Path(file))], None)


def open_stubborn(file: str) -> Fleet:
    """Open it, and have a thread that the process waits for."""
    threading.Thread(target=threading.Event().wait).start()
    return open_fleet(file)


class PulseHarness(WireHarness):
    """The wire harness with a robot that outlives its driver.

    Args:
        file: where renewals go.
        lease_s: how long the robot moves after each of them.
        opener: what the driving process calls.
    """

    def __init__(self, file: Path, lease_s: float, opener: str = "open_fleet") -> None:
        super().__init__(WireRobot)
        self.opener = opener
        self.file = file
        self.lease_s = lease_s

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        return spawn(f"{__name__}:{self.opener}", str(self.file), target)

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        lines = self.file.read_text(encoding="ascii").splitlines() if self.file.exists() else []
        # The line that is being written may be cut short.
        times = [float(line) for line in lines[:-1]]
        ends = [*times[1:], time.monotonic()]
        moved_s = sum(min(end - begin, self.lease_s) for begin, end in zip(times, ends, strict=False))
        return 2.0 + 0.1 * moved_s, 3.5, 0.4
