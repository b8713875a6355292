"""What a world knows of its robots' bodies, and the numbers that all of them share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Final

from soter.drive import DriveLimits
from soter.sdk.values import RobotSpec

BODY_RADIUS_M: Final = 0.105
"""A robot is a disc of this radius around its position."""

LIMITS: Final = DriveLimits()
"""What every robot of a world can do: a TurtleBot3 Burger."""

DRIVE_PER_S: Final = 1.0 / 1800.0
"""Charge used per second at full speed or full turn rate: empty after 30 minutes."""

IDLE_PER_S: Final = 1.0 / 7200.0
"""Charge used per second at rest: empty after two hours."""

CHARGE_PER_S: Final = 1.0 / 60.0
"""Charge gained per second while the robot's centre is on a charger, whatever it does there."""

Control = Callable[[float, float, float, float, float, float], tuple[float, float]]
"""A robot's side of the world, called once each control period with now_s, x_m, y_m, heading_rad, v_m_s and
yaw_rate_rad_s; it returns the speed in m/s along the heading and the turn rate in rad/s to steer for."""


def stand_still(*_state: float) -> tuple[float, float]:
    """Command rest: what a robot does that nobody controls."""
    return 0.0, 0.0


class Bodies:
    """The robots' states, one list for each quantity, indexed by the order of the specs.

    The engine alone writes them, in place; everybody else may keep references to the lists and read.

    Args:
        specs: which robots, where, and with what charge.

    Attributes:
        ids: the robots' numbers.
        x: metres east.
        y: metres north.
        heading: radians in (-pi, pi].
        v: speed along the heading in m/s, negative backwards.
        yaw_rate: rad/s, counter-clockwise.
        charge: from 0 to 1.
        control: what steers each robot.
    """

    __slots__ = ("charge", "control", "heading", "ids", "v", "x", "y", "yaw_rate")

    def __init__(self, specs: Sequence[RobotSpec]) -> None:
        if not specs:
            raise ValueError("a world without robots, allowed: one or more")
        self.ids = tuple(spec.id for spec in specs)
        if len(set(self.ids)) != len(self.ids):
            raise ValueError(f"robots have the ids {list(self.ids)}, allowed: each number once")
        for spec in specs:
            if not (isfinite(spec.x_m) and isfinite(spec.y_m) and isfinite(spec.heading_rad)):
                raise ValueError(f"robot {spec.id} starts at a pose that is not finite")
            if spec.battery is not None and not 0.0 <= spec.battery <= 1.0:
                raise ValueError(f"robot {spec.id} starts with the charge {spec.battery}, allowed: 0 to 1")
        self.x = [float(spec.x_m) for spec in specs]
        self.y = [float(spec.y_m) for spec in specs]
        self.heading = [float(spec.heading_rad) for spec in specs]
        self.v = [0.0] * len(specs)
        self.yaw_rate = [0.0] * len(specs)
        self.charge = [1.0 if spec.battery is None else float(spec.battery) for spec in specs]
        self.control: list[Control] = [stand_still] * len(specs)
