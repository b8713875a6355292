"""Drives robots as a supervisor does; also in a process of its own, which the kit can kill or make hang."""

from __future__ import annotations

import math
import pkgutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Final

from soter.errors import Uncontrolled
from soter.sdk import Controller, Fleet, Waypoint

TICK_S: Final = 0.05
"""How often a lease is renewed: SOTER's base tick."""

ROUNDING: Final = 1e-6

GIVES_UP: Final = signal.SIGUSR1
"""The signal at which a driving process ends, and leaves its robots open."""


def drive_until(
    fleet: Fleet,
    until: Callable[[], bool],
    timeout_s: float,
    *,
    renew: bool = True,
    read: bool = True,
    looks: int = 1,
) -> bool:
    """Tick like a supervisor: sleep, read every robot, renew every lease; return whether a condition held in time.

    Args:
        fleet: robots that are ready.
        until: called after every look.
        timeout_s: in fleet time.
        renew: whether leases are renewed.
        read: whether states are read.
        looks: how often robots are read and renewed in each tick, at even intervals.
    """
    clock = fleet.clock
    start_s = clock.now()
    step, step_s, renewed = 0, TICK_S / looks, 0
    while clock.now() - start_s < timeout_s - ROUNDING:
        step += 1
        # A grid without drift; if the host was too slow, steps that are past are skipped.
        step = max(step, math.ceil((clock.now() - start_s) / step_s - ROUNDING))
        clock.sleep_until(start_s + step * step_s)
        due = step // looks > renewed
        renewed = step // looks
        for robot in fleet.robots:
            if read:
                robot.read_state()
            if renew and due:
                # A robot that does not obey raises at every tick; its lease is still renewed.
                with suppress(Uncontrolled):
                    robot.renew_lease()
        if until():
            return True
    return False


def spawn(opener: str, argument: str, target: Waypoint) -> subprocess.Popen[bytes]:
    """Start a process that opens a fleet and drives its first robot; its output goes where this process's goes.

    Args:
        opener: `module:function`, importable in a new Python; called with `argument`, it returns a Fleet whose robots
            are not initialised, connected to robots that live elsewhere.
        argument: whatever the function needs to find them, such as an address.
        target: where to drive; only its coordinates and its time-out count.
    """
    numbers = (str(value) for value in (target.x_m, target.y_m, target.timeout_s))
    program = f"from {__name__} import main; main()"
    return subprocess.Popen([sys.executable, "-c", program, opener, argument, *numbers])


def drive(fleet: Fleet, target: Waypoint) -> None:
    """Make the AC of the first robot active, send the robot to the target, and renew leases each tick, for ever."""
    robot = fleet.robots[0]
    robot.init(10.0)
    robot.switch_ac_sc(Controller.AC, "conformance")
    robot.goto(target, Controller.AC)
    drive_until(fleet, lambda: False, math.inf)


def main() -> None:
    """Run the process that `spawn` starts, with its arguments from the command line.

    At the signal `GIVES_UP` it ends as a program does by an error that nobody has thought of: without closing anything.
    """
    opener, argument, x_m, y_m, timeout_s = sys.argv[1:]
    function: Callable[[str], Fleet] = pkgutil.resolve_name(opener)
    given_up: list[int] = []

    def give_up(number: int, _frame: FrameType | None) -> None:
        if not given_up:
            given_up.append(number)
            sys.exit(1)

    signal.signal(GIVES_UP, give_up)
    fleet = function(argument)
    try:
        drive(fleet, Waypoint(float(x_m), float(y_m), timeout_s=float(timeout_s)))
    finally:
        if not given_up:
            fleet.close()
