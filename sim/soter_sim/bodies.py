"""The bodies of a world's robots: their sizes, limits and states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Final

from soter.onboard.drive import DriveLimits
from soter.sdk.values import RobotSpec

BODY_RADIUS_M: Final = 0.105
"""By default a robot is a disc of this radius around its position."""

LIMITS: Final = DriveLimits()
"""Default limits: those of a TurtleBot3 Burger."""

Control = Callable[[float, float, float, float, float, float], tuple[float, float]]
"""A robot's side of the world, called once each control period with now_s, x_m, y_m, heading_rad, v_m_s and
yaw_rate_rad_s; it returns the speed in m/s along the heading and the turn rate in rad/s to steer for."""


def stand_still(*_state: float) -> tuple[float, float]:
    """Return the command to stand still; the default control of a robot."""
    return 0.0, 0.0


def built(spec: RobotSpec, otherwise: DriveLimits) -> DriveLimits:
    """Return a robot's limits: those of the promises that it is to make, or `otherwise` without any."""
    promised = spec.promised
    if promised is None:
        return otherwise
    accel_m_s2 = otherwise.accel_m_s2 if promised.accel_m_s2 is None else promised.accel_m_s2
    return DriveLimits(
        promised.v_max_m_s, promised.yaw_rate_max_rad_s, accel_m_s2, promised.brake_m_s2, otherwise.yaw_accel_rad_s2
    )


class Bodies:
    """The robots' states, one list for each quantity, indexed by the order of the specs.

    Only the engine writes them, in place; others may keep references to the lists and read them.

    Args:
        specs: the robots: their starts, charges and promises.
        otherwise: limits of a robot without promises.

    Attributes:
        ids: the robots' numbers.
        radius: radii of their discs, in metres; constant.
        limits: limits of their motion; constant.
        x: metres east.
        y: metres north.
        heading: radians in (-pi, pi].
        v: speed along the heading in m/s, negative backwards.
        yaw_rate: rad/s, counter-clockwise.
        charge: from 0 to 1.
        drive_per_s: charge used per second at full speed or full turn rate.
        idle_per_s: charge used per second at rest.
        charge_per_s: charge gained per second at rest with the centre on a charger.
        control: the control of each robot.
        carried: by index, how fast a robot is carried along beside its own speed: metres a second east and north.
    """

    __slots__ = (
        "carried",
        "charge",
        "charge_per_s",
        "control",
        "drive_per_s",
        "heading",
        "idle_per_s",
        "ids",
        "limits",
        "radius",
        "v",
        "x",
        "y",
        "yaw_rate",
    )

    def __init__(self, specs: Sequence[RobotSpec], otherwise: DriveLimits = LIMITS) -> None:
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
            if not 0.0 < spec.drive_s <= spec.idle_s < inf or not 0.0 < spec.charge_s < inf:
                raise ValueError(
                    f"robot {spec.id} has a battery of {spec.drive_s} s driving, {spec.idle_s} s idle and "
                    f"{spec.charge_s} s to charge, allowed: above 0, idle at least as long as driving"
                )
        self.radius = tuple(BODY_RADIUS_M if spec.promised is None else spec.promised.body_radius_m for spec in specs)
        self.limits = tuple(built(spec, otherwise) for spec in specs)
        self.x = [float(spec.x_m) for spec in specs]
        self.y = [float(spec.y_m) for spec in specs]
        self.heading = [float(spec.heading_rad) for spec in specs]
        self.v = [0.0] * len(specs)
        self.yaw_rate = [0.0] * len(specs)
        self.charge = [1.0 if spec.battery is None else float(spec.battery) for spec in specs]
        self.drive_per_s = [1.0 / spec.drive_s for spec in specs]
        self.idle_per_s = [1.0 / spec.idle_s for spec in specs]
        self.charge_per_s = [1.0 / spec.charge_s for spec in specs]
        self.control: list[Control] = [stand_still] * len(specs)
        self.carried: dict[int, tuple[float, float]] = {}
