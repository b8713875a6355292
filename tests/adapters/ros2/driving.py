"""Driving as a supervisor does, without ROS."""

from __future__ import annotations

import math
from collections.abc import Callable

from soter.conformance.bench import drive_until
from soter.sdk import Fleet


def tick(fleet: Fleet, until: Callable[[], bool], timeout_s: float, *, renew: bool = True) -> bool:
    """Tick until something holds; return whether it does in time."""
    return drive_until(fleet, until, timeout_s, renew=renew)


def rest_after_s(fleet: Fleet, timeout_s: float, *, drive: bool) -> float:
    """Return after how long robot 1 has come to rest for good, as the truth has it; infinite if it has not.

    Args:
        fleet: of the robot.
        timeout_s: how long to watch it.
        drive: whether its supervisor goes on as if nothing had happened.
    """
    assert fleet.truth is not None
    truth, clock = fleet.truth, fleet.clock
    began_s = clock.now()
    before, moved_s = truth.pose(1), began_s
    while clock.now() - began_s < timeout_s:
        clock.sleep_until(clock.now() + 0.02)
        if drive:
            for robot in fleet.robots:
                robot.read_state()
                robot.renew_lease()
        pose = truth.pose(1)
        if math.dist(pose[:2], before[:2]) > 1e-4:
            before, moved_s = pose, clock.now()
    return math.inf if clock.now() - moved_s < 0.3 else moved_s - began_s
