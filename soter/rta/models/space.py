"""Motion bound in three dimensions, for vehicles that fly."""

from __future__ import annotations

from math import hypot
from typing import Final

from soter.rta.models.base import ROUNDING_M, Motion
from soter.rta.models.motion import not_negative, positive, way_m
from soter.rta.situation import Sample, Situation


class PointMassBound(Motion):
    """A point that accelerates in any direction, such as a copter: bounded by itself, horizontally and vertically.

    Horizontally, the part of the velocity along a direction u starts at p0 = v.u, negative when the vehicle flies
    away from u. It grows by at most `accel`, since no acceleration is longer than that, up to the top speed. So along
    u it gets at most the integral of p(t) = min(v_max, p0 + accel t) far, and never less than 0, which is where it
    is. It is told to stop at T, at some velocity w with |w| <= s(T) (see `SpeedAccelerationBound`) and w.u <= p(T);
    braking along w takes |w|^2 / (2 brake), of which w.u / |w| is along u: at most s(T) p(T) / (2 brake). Vertically
    the same holds for the single direction up or down. A direction in space is part horizontal and part vertical, and
    so is the way along it.

    A sample without a vertical speed counts as climbing, or sinking, at top speed.

    Args:
        v_max_m_s: top speed, horizontally.
        accel_m_s2: how fast the horizontal velocity changes, at most, in any direction.
        brake_m_s2: guaranteed deceleration, horizontally.
        climb_m_s: top speed, upwards.
        sink_m_s: top speed, downwards.
        climb_accel_m_s2: how fast the vertical speed changes, at most.
        climb_brake_m_s2: guaranteed deceleration, vertically.
        speed_noise_m_s: error of a reported speed, at most, horizontally and vertically.
    """

    def __init__(
        self,
        v_max_m_s: float,
        accel_m_s2: float,
        brake_m_s2: float,
        climb_m_s: float,
        sink_m_s: float,
        climb_accel_m_s2: float,
        climb_brake_m_s2: float,
        speed_noise_m_s: float = 0.0,
    ) -> None:
        self.v_max_m_s: Final = positive("v_max_m_s", v_max_m_s)
        self.accel_m_s2: Final = positive("accel_m_s2", accel_m_s2)
        self.brake_m_s2: Final = positive("brake_m_s2", brake_m_s2)
        self.climb_m_s: Final = positive("climb_m_s", climb_m_s)
        self.sink_m_s: Final = positive("sink_m_s", sink_m_s)
        self.climb_accel_m_s2: Final = positive("climb_accel_m_s2", climb_accel_m_s2)
        self.climb_brake_m_s2: Final = positive("climb_brake_m_s2", climb_brake_m_s2)
        self.speed_noise_m_s: Final = not_negative("speed_noise_m_s", speed_noise_m_s)
        self._vertical_m_s = max(climb_m_s, sink_m_s)

    def bound(self, time_s: float) -> float:
        level = self.v_max_m_s * time_s + self.v_max_m_s**2 / (2.0 * self.brake_m_s2)
        upright = self._vertical_m_s * time_s + self._vertical_m_s**2 / (2.0 * self.climb_brake_m_s2)
        return hypot(level, upright)

    def reach(self, situation: Situation, time_s: float) -> float:
        own = situation.own
        speed = hypot(own.vx_m_s, own.vy_m_s)
        level = self._level(speed, speed, time_s)
        return hypot(level, max(self._upright(own, time_s, 1.0), self._upright(own, time_s, -1.0)))

    def extent(self, sample: Sample, time_s: float, ux: float, uy: float, uz: float = 0.0) -> float:
        level = hypot(ux, uy)
        far = 0.0
        if level > 0.0:
            along = (sample.vx_m_s * ux + sample.vy_m_s * uy) / level
            far = level * self._level(along, hypot(sample.vx_m_s, sample.vy_m_s), time_s)
        return far + abs(uz) * self._upright(sample, time_s, uz) if uz != 0.0 else far

    def _level(self, along: float, speed: float, time_s: float) -> float:
        noise, most, accel = self.speed_noise_m_s, self.v_max_m_s, self.accel_m_s2
        return _ahead(along + noise, most, accel, time_s, min(most, speed + noise + accel * time_s), self.brake_m_s2)

    def _upright(self, sample: Sample, time_s: float, uz: float) -> float:
        most = self.climb_m_s if uz > 0.0 else self.sink_m_s
        if sample.vz_m_s is None:
            return most * time_s + most * most / (2.0 * self.climb_brake_m_s2)
        speed = (sample.vz_m_s if uz > 0.0 else -sample.vz_m_s) + self.speed_noise_m_s
        reached = speed + self.climb_accel_m_s2 * time_s
        return _ahead(speed, most, self.climb_accel_m_s2, time_s, reached, self.climb_brake_m_s2)

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        elapsed_s = after.stamp_s - before.stamp_s
        if not elapsed_s >= 0.0:
            return False
        spare, unsure = 2.0 * noise_m + ROUNDING_M, 2.0 * self.speed_noise_m_s + ROUNDING_M
        changed = hypot(after.vx_m_s - before.vx_m_s, after.vy_m_s - before.vy_m_s)
        speed = hypot(after.vx_m_s, after.vy_m_s)
        if not changed <= self.accel_m_s2 * elapsed_s + unsure or not speed <= self.v_max_m_s + unsure:
            return False
        if before.vz_m_s is not None and after.vz_m_s is not None:
            climbs = abs(after.vz_m_s - before.vz_m_s) <= self.climb_accel_m_s2 * elapsed_s + unsure
            if not climbs or not -self.sink_m_s - unsure <= after.vz_m_s <= self.climb_m_s + unsure:
                return False
        was = min(self.v_max_m_s, hypot(before.vx_m_s, before.vy_m_s) + self.speed_noise_m_s)
        level = way_m(was, self.v_max_m_s, self.accel_m_s2, elapsed_s)
        rise = after.z_m - before.z_m
        return (
            hypot(after.x_m - before.x_m, after.y_m - before.y_m) <= level + spare
            and -self.sink_m_s * elapsed_s - spare <= rise <= self.climb_m_s * elapsed_s + spare
        )


def _ahead(along: float, most: float, accel: float, time_s: float, speed: float, brake: float) -> float:
    """Return how far a vehicle gets along a direction, stopping from `speed` included; at least 0.

    Args:
        along: its present speed along the direction, negative away from it.
        most: its top speed.
        accel: how fast that speed grows, at most.
        time_s: for how long it may.
        speed: how fast the vehicle may be by then, in whatever direction.
        brake: guaranteed deceleration.
    """
    # Written so that NaN counts as the top speed.
    along = min(most, along)
    speed = min(most, speed)
    reached = min(most, along + accel * time_s)
    if reached <= 0.0:
        return 0.0
    return max(0.0, way_m(along, most, accel, time_s)) + speed * reached / (2.0 * brake)
