"""Go-to-goal control of a differential-drive robot: brake, pivot in place, drive straight, stop at the target.

The path is simple on purpose: a straight segment from where the robot stood still can be certified before it is
driven. Standard library only, because the same code runs in the simulated worlds and on real robots.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, inf, pi, sin, sqrt
from typing import Final, Protocol

ARRIVED_M: Final = 0.01
"""A robot at rest this near to its target has arrived and does not move again."""

TUBE_M: Final = 0.02
"""A robot as slow as a TurtleBot3 stays this near to the segment from the start of its leg to its target."""

OVERSHOOT_M: Final = 0.01
"""Farthest that such a robot overshoots its target."""

_AT_TARGET_M: Final = 0.001
_NEAR_M: Final = 0.03
_REST_M_S: Final = 0.005
_CONE: Final = 0.2
_RESUME_CONE: Final = 0.15
_START_RAD: Final = 0.02
_START_RAD_S: Final = 0.4
_ALIGNED_RAD: Final = 0.01
_STEER_PER_S: Final = 6.0
_STEER_MAX_RAD_S: Final = 1.0
# Pivots are planned with less than the full yaw brake, so that motors that lag a little do not swing past.
_YAW_RESERVE: Final = 0.75

_BRAKE: Final = 0
_PIVOT: Final = 1
_GO: Final = 2


class Target(Protocol):
    """A target as the drive reads it, such as a `soter.sdk.Waypoint`. Metres and radians, workspace frame."""

    @property
    def x_m(self) -> float:
        """East."""

    @property
    def y_m(self) -> float:
        """North."""

    @property
    def heading_rad(self) -> float | None:
        """The heading to arrive with, or None."""

    @property
    def speed_m_s(self) -> float | None:
        """A cap on the speed, or None."""


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """A vehicle's limits, and the noise of its state; the defaults are a TurtleBot3 Burger's, without noise.

    Attributes:
        yaw_accel_rad_s2: change of the turn rate per second.
        speed_noise_m_s: largest error of the speed given to the drive.
        position_noise_m: largest error of the position given to the drive.
    """

    v_max_m_s: float = 0.22
    yaw_rate_max_rad_s: float = 2.84
    accel_m_s2: float = 1.0
    brake_m_s2: float = 1.0
    yaw_accel_rad_s2: float = 8.0
    speed_noise_m_s: float = 0.0
    position_noise_m: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value, exact = getattr(self, name), name.endswith(("noise_m_s", "noise_m"))
            if not 0.0 < value < inf and not (exact and value == 0.0):
                raise ValueError(f"DriveLimits.{name} is {value}, allowed: finite and above 0{', or 0' * exact}")


def tube_m(limits: DriveLimits, reaction_s: float) -> float:
    """Return the vehicle's largest distance from the segment to its target, for any earlier motion within the cone.

    Args:
        limits: the vehicle's limits.
        reaction_s: the longest time until the vehicle acts on a new target.
    """
    # Worst case: the old direction is at the edge of the cone, and the vehicle brakes along it.
    ahead_m = limits.v_max_m_s * reaction_s + limits.v_max_m_s * limits.v_max_m_s / (2.0 * limits.brake_m_s2)
    return max(TUBE_M, _RESUME_CONE * ahead_m)


class Drive:
    """Drives one robot to its target; keeps its phase between control periods.

    A new target that lies nearly along the present motion (within about 11 degrees) is steered to without stopping;
    any other makes the robot brake to rest, pivot, and drive. To a target with a heading it drives backwards if that
    arrives closer to the heading, and turns the rest in place at the end. Without a heading it drives forwards.
    """

    __slots__ = (
        "_arrived", "_brake", "_brake_dt", "_brake_dt_sq", "_cap", "_far", "_heading", "_mode", "_near", "_rest",
        "_sign", "_target", "_there", "_two_brake", "_two_yaw", "_v_max", "_x", "_y", "_yaw_dt", "_yaw_dt_sq",
        "_yaw_max", "limits", "period_s",
    )  # fmt: skip

    def __init__(self, limits: DriveLimits | None = None, period_s: float = 0.05) -> None:
        if not 0.0 < period_s < inf:
            raise ValueError(f"period_s is {period_s}, allowed: finite and above 0")
        self.limits = limits = limits or DriveLimits()
        self.period_s = period_s
        self._v_max = limits.v_max_m_s
        self._brake = limits.brake_m_s2
        self._brake_dt = self._brake * period_s
        self._brake_dt_sq = self._brake_dt * self._brake_dt
        self._two_brake = 2.0 * self._brake
        yaw_brake = _YAW_RESERVE * limits.yaw_accel_rad_s2
        self._yaw_max = limits.yaw_rate_max_rad_s
        self._yaw_dt = yaw_brake * period_s
        self._yaw_dt_sq = self._yaw_dt * self._yaw_dt
        self._two_yaw = 2.0 * yaw_brake
        # A robot at rest on its target may seem to move, or to be elsewhere, by the noise. A new target is driven to
        # however near it is: legs of safe controllers may be shorter than the noise.
        self._arrived = False
        self._rest = _REST_M_S + limits.speed_noise_m_s
        self._there = max(ARRIVED_M, limits.position_noise_m)
        self._near = max(_NEAR_M, 2.0 * limits.position_noise_m)
        self._target: Target | None = None
        self._x = self._y = 0.0
        self._heading: float | None = None
        self._cap = self._far = 0.0
        self._mode = _BRAKE
        self._sign = 1.0

    def command(
        self, x: float, y: float, heading: float, v: float, yaw_rate: float, target: Target | None
    ) -> tuple[float, float]:
        """Return the speed in m/s and the turn rate in rad/s to command for the next control period.

        Args:
            x: the robot's position, metres east.
            y: the robot's position, metres north.
            heading: radians counter-clockwise from east.
            v: present speed along the heading, m/s, negative backwards.
            yaw_rate: present turn rate, rad/s counter-clockwise.
            target: where to go; None to brake.
        """
        if target is not self._target:
            self._take(target)
        if target is None:
            return 0.0, 0.0
        dx = self._x - x
        dy = self._y - y
        c = cos(heading)
        s = sin(heading)
        along = dx * c + dy * s
        across = dy * c - dx * s
        if self._mode == _GO:
            if self._sign < 0.0:
                along = -along
                across = -across
        else:
            # Not driving yet: choose a direction, get to rest, turn; fall through once the robot may drive.
            resting = -self._rest <= v <= self._rest
            wanted = self._heading
            if resting:
                there = self._there if self._arrived else ARRIVED_M
                if dx * dx + dy * dy <= there * there:
                    self._mode, self._arrived = _BRAKE, True
                    return 0.0, 0.0 if wanted is None else self._align(wanted - heading)
                sign = 1.0 if wanted is None else self._choose(wanted, dx, dy)
            else:
                sign = 1.0 if v > 0.0 else -1.0
            self._sign = sign
            if sign < 0.0:
                along = -along
                across = -across
            if resting:
                error = atan2(across, along)
                if not (-_START_RAD <= error <= _START_RAD and -_START_RAD_S <= yaw_rate <= _START_RAD_S):
                    self._mode = _PIVOT
                    return 0.0, self._turn(error)
            elif abs(across) > _RESUME_CONE * along or along <= self._near or (sign < 0.0 and wanted is None):
                return 0.0, 0.0
            self._mode = _GO
        if along > self._near:
            if across > _CONE * along or across < -_CONE * along:
                self._mode = _BRAKE
                return 0.0, 0.0
            w = _STEER_PER_S * across / along
            if w > _STEER_MAX_RAD_S:
                w = _STEER_MAX_RAD_S
            elif w < -_STEER_MAX_RAD_S:
                w = -_STEER_MAX_RAD_S
        elif along > _AT_TARGET_M and -self._there <= across <= self._there:
            # So near, the bearing is unreliable, and the heading is right already.
            w = 0.0
        else:
            self._mode = _BRAKE
            return 0.0, 0.0
        speed = self._cap
        if along < self._far:
            # At this speed, one more period and then braking end exactly at the target.
            speed = sqrt(self._brake_dt_sq + self._two_brake * along) - self._brake_dt
        return (speed, w) if self._sign > 0.0 else (-speed, w)

    def _take(self, target: Target | None) -> None:
        self._target = target
        self._arrived = False
        if target is None:
            self._mode = _BRAKE
            return
        self._x, self._y = target.x_m, target.y_m
        self._heading = target.heading_rad
        cap = target.speed_m_s
        self._cap = cap = self._v_max if cap is None or cap > self._v_max else cap
        self._far = cap * self.period_s + cap * cap / self._two_brake
        if self._sign < 0.0 and self._heading is None:
            self._mode = _BRAKE

    def _choose(self, wanted: float, dx: float, dy: float) -> float:
        """Return 1.0 to drive the leg forwards, -1.0 backwards; if both are about as good, keep the earlier choice."""
        forwards = cos(wanted) * dx + sin(wanted) * dy
        if self._mode == _PIVOT and forwards * forwards < 0.01 * (dx * dx + dy * dy):
            return self._sign
        return 1.0 if forwards >= 0.0 else -1.0

    def _align(self, error: float) -> float:
        error = (error + pi) % (2.0 * pi) - pi
        return 0.0 if -_ALIGNED_RAD <= error <= _ALIGNED_RAD else self._turn(error)

    def _turn(self, error: float) -> float:
        """Return the turn rate with which one more period and braking turn the robot by `error`."""
        rate = sqrt(self._yaw_dt_sq + self._two_yaw * abs(error)) - self._yaw_dt
        if rate > self._yaw_max:
            rate = self._yaw_max
        return rate if error > 0.0 else -rate
