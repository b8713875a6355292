"""Worlds and controls that several tests use."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from soter.adapters.pybullet import KinematicBackend
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.onboard.drive import Drive
from soter.sdk.values import RobotSpec, Waypoint
from soter_sim import BODY_RADIUS_M, LIMITS, Control, World

CASE = Workspace(
    5.0,
    5.0,
    (Box(2, 0, 3, 1), Box(2, 3, 3, 4), Box(1, 2, 1.9, 3)),
    (
        RobotPlace(1, 1.0, 1.0, Box(0.8, 0.8, 1.2, 1.2)),
        RobotPlace(2, 2.5, 2.0, Box(2.3, 1.8, 2.7, 2.2)),
    ),
)
"""The surveillance case."""


def empty(width_m: float = 20.0, depth_m: float = 20.0, *chargers: Box) -> Workspace:
    """A workspace without boxes."""
    return Workspace(width_m, depth_m, (), tuple(RobotPlace(i, 0, 0, box) for i, box in enumerate(chargers, 1)))


def promising(spec: RobotSpec, body_radius_m: float = BODY_RADIUS_M, **figures: Any) -> RobotSpec:
    """A robot of which other figures are asked than a TurtleBot's."""
    promised = replace(KinematicBackend.robot_class.declared, body_radius_m=body_radius_m, **figures)
    return replace(spec, promised=promised)


def constant(v_m_s: float, yaw_rate_rad_s: float = 0.0) -> Control:
    """A control that always commands the same."""

    def control(*_: float) -> tuple[float, float]:
        return v_m_s, yaw_rate_rad_s

    return control


def driven(target: Callable[[], Waypoint | None], period_s: float = 0.05) -> Control:
    """A control that drives to whatever `target` returns."""
    command = Drive(LIMITS, period_s).command

    def control(now_s: float, x: float, y: float, heading: float, v: float, yaw_rate: float) -> tuple[float, float]:
        return command(x, y, heading, v, yaw_rate, target())

    return control


def touring(world: World, targets: Sequence[Waypoint], each_s: float = 5.0) -> Control:
    """A control that drives to one target after the other, for a fixed time each."""
    return driven(lambda: targets[int(world.now_s / each_s) % len(targets)])


def scripted(commands: Sequence[tuple[float, float]], each_s: float) -> Control:
    """A control that commands one thing after the other, for a fixed time each."""

    def control(now_s: float, *_: float) -> tuple[float, float]:
        return commands[int(now_s / each_s) % len(commands)]

    return control


def from_segment(x: float, y: float, start: Sequence[float], end: Sequence[float]) -> tuple[float, float]:
    """How far a point is from a segment, and how far beyond its end."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy)
    if length == 0.0:
        return math.hypot(x - start[0], y - start[1]), 0.0
    along = ((x - start[0]) * dx + (y - start[1]) * dy) / length
    at = min(max(along, 0.0), length) / length
    return math.hypot(x - start[0] - at * dx, y - start[1] - at * dy), along - length


def positions(world: World) -> list[tuple[float, float]]:
    """Where all robots are."""
    return list(zip(world.bodies.x, world.bodies.y, strict=True))


def specs(*poses: tuple[float, float, float], battery: float | None = None) -> list[RobotSpec]:
    """Robots from 1 at the given poses."""
    return [RobotSpec(i, *pose, battery=battery) for i, pose in enumerate(poses, 1)]
