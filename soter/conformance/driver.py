"""Driving robots as a supervisor does; and a process that does nothing else, for the kit to kill or to make hang."""

from __future__ import annotations

import importlib
import math
import subprocess
import sys
from collections.abc import Callable
from typing import Final

from soter.sdk import Controller, Fleet, Waypoint

TICK_S: Final = 0.05
"""How often a lease is renewed: SOTER's base tick."""

ROUNDING: Final = 1e-6


def drive_until(
    fleet: Fleet, until: Callable[[], bool], timeout_s: float, *, renew: bool = True, read: bool = True
) -> bool:
    """Tick like a supervisor: sleep, read every robot, renew every lease; until a condition holds.

    Args:
        fleet: robots that are ready.
        until: asked after every tick.
        timeout_s: in fleet time.
        renew: whether leases are renewed.
        read: whether states are read.

    Returns:
        Whether the condition held in time.
    """
    clock = fleet.clock
    start_s = clock.now()
    tick = 0
    while clock.now() - start_s < timeout_s - ROUNDING:
        tick += 1
        # A grid without drift; where the host was too slow for it, the next tick is the next one still ahead.
        tick = max(tick, math.ceil((clock.now() - start_s) / TICK_S - ROUNDING))
        clock.sleep_until(start_s + tick * TICK_S)
        for robot in fleet.robots:
            if read:
                robot.read_state()
            if renew:
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
    """Put the AC of the first robot in charge, send it to the target, and renew leases each tick, for ever."""
    robot = fleet.robots[0]
    robot.init(10.0)
    robot.switch_ac_sc(Controller.AC, "conformance")
    robot.goto(target, Controller.AC)
    drive_until(fleet, lambda: False, math.inf)


def main() -> None:
    """Do what `spawn` wants of its process, which gives the arguments."""
    opener, argument, x_m, y_m, timeout_s = sys.argv[1:]
    module, _, name = opener.partition(":")
    function: Callable[[str], Fleet] = getattr(importlib.import_module(module), name)
    with function(argument) as fleet:
        drive(fleet, Waypoint(float(x_m), float(y_m), timeout_s=float(timeout_s)))
