"""A room, its robots, and driving them as a supervisor does, whatever carries the messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from soter.adapters.velocity_controlled.robot import VelocityControlledRobot
from soter.conformance.driver import drive_until
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Controller, Fleet, RobotSpec, Waypoint

ROOM = Workspace(
    8.0, 6.0, (),
    (
        RobotPlace(1, 2.0, 2.5, Box(1.9, 2.4, 2.1, 2.6), 0.4),
        RobotPlace(2, 5.0, 3.5, Box(4.9, 3.4, 5.1, 3.6), -2.0),
    ),
)  # fmt: skip
SPECS = [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad, 0.8) for place in ROOM.robots]

PATIENT = [replace(SPECS[0], promised=replace(VelocityControlledRobot.declared, lease_s=5.0))]
"""One robot whose lease lives on while this host stands still for a moment."""


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


def moves(fleet: Fleet) -> bool:
    state = fleet.robots[0].read_state()
    return math.hypot(state.vx_m_s, state.vy_m_s) > 0.2


def under_way(fleet: Fleet) -> Waypoint:
    """Send the robot straight on and return where to, once it is at speed."""
    robot = fleet.robots[0]
    target = Waypoint(2.0 + 2.0 * math.cos(0.4), 2.5 + 2.0 * math.sin(0.4))
    robot.goto(target, Controller.SC)
    assert tick(fleet, lambda: moves(fleet), 5.0)
    return target
