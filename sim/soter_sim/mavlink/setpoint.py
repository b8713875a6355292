"""Set-points and samples of an autopilot's vehicle. East, north, up; radians counter-clockwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan2, hypot
from typing import Final, NamedTuple, Protocol

_NEAR_M: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A place to go to; a `soter.onboard.drive.Target`. Compared by identity, because each is one command to go there.

    Attributes:
        x_m: east.
        y_m: north.
        z_m: up from the ground; ignored by a rover.
        heading_rad: the heading to arrive with, or None.
        speed_m_s: a cap on the speed, or None.
    """

    x_m: float
    y_m: float
    z_m: float = 0.0
    heading_rad: float | None = None
    speed_m_s: float | None = None

    def backwards_from(self, at: Sample) -> Place:
        """Return the same place with the heading of a rover that backs to it, or its present heading if it is there."""
        dx_m, dy_m = at.x_m - self.x_m, at.y_m - self.y_m
        near = hypot(dx_m, dy_m) < _NEAR_M
        return replace(self, heading_rad=at.heading_rad if near else atan2(dy_m, dx_m))


@dataclass(frozen=True, slots=True, eq=False)
class Velocity:
    """A velocity to keep.

    Attributes:
        east_m_s: east.
        north_m_s: north.
        up_m_s: up; ignored by a rover.
        yaw_rate_rad_s: turn rate, or None: then a rover turns to its direction, and a copter does not turn.
        heading_rad: the heading to which a rover turns in place, or None.
    """

    east_m_s: float
    north_m_s: float
    up_m_s: float = 0.0
    yaw_rate_rad_s: float | None = None
    heading_rad: float | None = None


Setpoint = Place | Velocity | None
"""None means stop, and stay."""


class Sample(NamedTuple):
    """A vehicle's sensor readings.

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
    """The interface of an autopilot to its robot."""

    @property
    def v_max_m_s(self) -> float:
        """Its top speed."""

    def sample(self) -> Sample:
        """Return its state at the end of the last control period."""

    def steer(self, setpoint: Callable[[float], Setpoint]) -> None:
        """Call `setpoint`, with the world's time, once in each control period, and steer for what it returns."""
