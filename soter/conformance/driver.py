"""A process that does nothing but drive one robot, so that the kit can kill it or make it hang."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable
from typing import Final

from soter.sdk import Controller, Fleet, Waypoint

TICK_S: Final = 0.05
"""How often a lease is renewed: SOTER's base tick."""


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
    """Put the AC of the first robot in charge, send it to the target, and renew its lease each tick, for ever."""
    robot, clock = fleet.robots[0], fleet.clock
    robot.init(10.0)
    robot.switch_ac_sc(Controller.AC, "conformance")
    robot.goto(target, Controller.AC)
    due_s = clock.now()
    while True:
        due_s = max(due_s + TICK_S, clock.now())
        clock.sleep_until(due_s)
        robot.read_state()
        robot.renew_lease()


def main() -> None:
    """Do what `spawn` wants of its process, which gives the arguments."""
    opener, argument, x_m, y_m, timeout_s = sys.argv[1:]
    module, _, name = opener.partition(":")
    function: Callable[[str], Fleet] = getattr(importlib.import_module(module), name)
    with function(argument) as fleet:
        drive(fleet, Waypoint(float(x_m), float(y_m), timeout_s=float(timeout_s)))
