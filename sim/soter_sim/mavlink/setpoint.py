"""What an autopilot steers its vehicle for, and what it knows of it. East, north, up; radians counter-clockwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan2, hypot
from typing import Final, NamedTuple, Protocol

_NEAR_M: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A place to go to; a `soter.onboard.drive.Target`. Compared by identity, because each is one order to go there.

    Attributes:
        x_m: east.
        y_m: north.
        z_m: up from the ground; of no meaning to a rover.
        heading_rad: the heading to arrive with, or None.
        speed_m_s: a cap on the speed, or None.
    """

    x_m: float
    y_m: float
    z_m: float = 0.0
    heading_rad: float | None = None
    speed_m_s: float | None = None

    def backwards_from(self, at: Sample) -> Place:
        """Return the same place with the heading that a rover has which backs to it; at it, with the one it has."""
        dx_m, dy_m = at.x_m - self.x_m, at.y_m - self.y_m
        near = hypot(dx_m, dy_m) < _NEAR_M
        return replace(self, heading_rad=at.heading_rad if near else atan2(dy_m, dx_m))


@dataclass(frozen=True, slots=True, eq=False)
class Velocity:
    """A velocity to keep.

    Attributes:
        east_m_s: east.
        north_m_s: north.
        up_m_s: up; of no meaning to a rover.
        yaw_rate_rad_s: turn at this rate, or None: a rover turns to where it is to go, a copter does not turn.
    """

    east_m_s: float
    north_m_s: float
    up_m_s: float = 0.0
    yaw_rate_rad_s: float | None = None


Setpoint = Place | Velocity | None
"""None is: stop, and stay."""


class Sample(NamedTuple):
    """What a vehicle's sensors say.

    Attributes:
        x_m: east.
        y_m: north.
        z_m: up from the ground.
        heading_rad: in (-pi, pi].
        east_m_s: velocity.
        north_m_s: velocity.
        up_m_s: velocity.
        yaw_rate_rad_s: turn rate.
        charge: from 0 to 1.
    """

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    east_m_s: float
    north_m_s: float
    up_m_s: float
    yaw_rate_rad_s: float
    charge: float


class Vehicle(Protocol):
    """One robot of a world, as its autopilot sees it."""

    @property
    def v_max_m_s(self) -> float:
        """How fast it can go."""

    def sample(self) -> Sample:
        """Return how it is, at the end of the last control period."""

    def steer(self, setpoint: Callable[[float], Setpoint]) -> None:
        """Ask `setpoint`, with the world's time, once in each control period, and steer for what it says."""
