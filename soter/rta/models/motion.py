"""Motion bounds that use the robot's present state: its speed, or that of a unicycle.

The closed forms are bounds for every input, not simulations; each docstring has the argument.
"""

from __future__ import annotations

from math import acos, cos, hypot, inf, pi, remainder, sin
from typing import Final

from soter.rta.models.base import ROUNDING_M, Motion
from soter.rta.situation import Sample, Situation

_ROUNDING_RAD: Final = 1e-9
_ROUNDING_M_S: Final = 1e-9
_SLOW_TURN_RAD: Final = 1e-3


def positive(name: str, value: float) -> float:
    """Return the value if it is above 0 and finite.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 < value < inf:
        raise ValueError(f"{name} is {value}, allowed: above 0")
    return value


def not_negative(name: str, value: float) -> float:
    """Return the value if it is 0 or more, and finite.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 <= value < inf:
        raise ValueError(f"{name} is {value}, allowed: 0 or more")
    return value


def way_m(speed: float, most: float, accel: float, time_s: float) -> float:
    """Return the longest distance within a time from a speed that grows by at most `accel`, up to `most`.

    The speed may be negative, along a direction that the robot moves away from at first.
    """
    rising_s = (most - speed) / accel
    if time_s <= rising_s:
        return (speed + 0.5 * accel * time_s) * time_s
    if rising_s <= 0.0:
        return most * time_s
    return most * time_s - 0.5 * accel * rising_s * rising_s


class SpeedAccelerationBound(Motion):
    """A bound from the present speed, which grows by at most `accel_m_s2`, up to v_max.

    At time t the speed is at most s(t) = min(v_max, s0 + accel t), because a speed, a length, grows no faster than
    the robot accelerates along its way, wherever that leads. So the way within T is at most the integral of s, and
    from s(T) stopping takes at most s(T)^2 / (2 brake). Both grow with s, hence no input covers more.

    Args:
        v_max_m_s: top speed.
        accel_m_s2: how fast the speed grows, at most.
        brake_m_s2: guaranteed deceleration.
        speed_noise_m_s: error of a reported speed, at most.
    """

    def __init__(self, v_max_m_s: float, accel_m_s2: float, brake_m_s2: float, speed_noise_m_s: float = 0.0) -> None:
        self.v_max_m_s: Final = positive("v_max_m_s", v_max_m_s)
        self.accel_m_s2: Final = positive("accel_m_s2", accel_m_s2)
        self.brake_m_s2: Final = positive("brake_m_s2", brake_m_s2)
        self.speed_noise_m_s: Final = not_negative("speed_noise_m_s", speed_noise_m_s)
        self._stop_m = v_max_m_s * v_max_m_s / (2.0 * brake_m_s2)

    def bound(self, time_s: float) -> float:
        return self.v_max_m_s * time_s + self._stop_m

    def reach(self, situation: Situation, time_s: float) -> float:
        return self.extent(situation.own, time_s, 1.0, 0.0)

    def extent(self, sample: Sample, time_s: float, ux: float, uy: float, uz: float = 0.0) -> float:
        speed = self._speed(sample)
        reached = min(self.v_max_m_s, speed + self.accel_m_s2 * time_s)
        return way_m(speed, self.v_max_m_s, self.accel_m_s2, time_s) + reached * reached / (2.0 * self.brake_m_s2)

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        elapsed_s = after.stamp_s - before.stamp_s
        if not elapsed_s >= 0.0 or not self._speeds_fit(before, after, elapsed_s):
            return False
        most_m = way_m(self._speed(before), self.v_max_m_s, self.accel_m_s2, elapsed_s) + 2.0 * noise_m + ROUNDING_M
        return hypot(after.x_m - before.x_m, after.y_m - before.y_m) <= most_m

    def _speed(self, sample: Sample) -> float:
        speed = hypot(sample.vx_m_s, sample.vy_m_s) + self.speed_noise_m_s
        # Written so that a speed that is not a number counts as the top speed.
        return min(self.v_max_m_s, speed)

    def _speeds_fit(self, before: Sample, after: Sample, elapsed_s: float) -> bool:
        speed = hypot(after.vx_m_s, after.vy_m_s) - self.speed_noise_m_s - _ROUNDING_M_S
        return speed <= self.v_max_m_s and speed <= self._speed(before) + self.accel_m_s2 * elapsed_s


class UnicycleBound(SpeedAccelerationBound):
    """A robot that moves along its heading only, forwards or backwards, and turns at no more than `yaw_rate_max`.

    Let alpha be the angle between the heading and a direction u. At time t the heading has turned by at most
    w t + e, where e is its error, so that forwards it lies along u by at most c(t) = cos(max(0, alpha - e - w t)),
    and backwards by at most c'(t), the same with pi - alpha. The speed forwards is at most f(t) = min(v_max, f0 +
    accel t), with f0 the most that the robot may drive forwards now; f'(t) backwards, likewise: a robot may stop at
    once, at a wall for example, but has to gain any speed the other way. So the robot moves along u by at most
    max(0, f c, f' c') at every t. Two bounds follow, and the lesser of them is taken:

    - the sum of the integrals of f c and of f' c', where they are positive;
    - the integral of the larger speed times c of the end that lies nearer to u, which c' never exceeds.

    It is told to stop at T: the integrals go on from there, with speeds that fall by `brake` to 0, and with c a period
    later, because a vehicle may make up to all of the way of a control period at its end.

    f0 and f0' follow from the reported velocity v, wrong by n at most, and the reported heading h, wrong by e at most.
    A robot that drives forwards at s along its true heading has v.h >= s cos e - n, as long as e is below a right
    angle; so s <= (v.h + n) / cos e, and no robot drives forwards where that is negative. Backwards the same holds
    with -v.h. And s <= |v| + n in any case. Both hold for a velocity that is reported along the reported heading, too.

    Reported positions are those of the point between the wheels, about which it turns.

    Args:
        v_max_m_s: top speed forwards.
        accel_m_s2: how fast the speed grows, at most.
        brake_m_s2: guaranteed deceleration.
        yaw_rate_max_rad_s: top turn rate, taken to be reached at once.
        reverse_m_s: top speed backwards; 0 for a robot that cannot reverse.
        speed_noise_m_s: error of a reported velocity, at most.
        heading_noise_rad: error of a reported heading, at most.
        period_s: control period of the vehicle; the speed may fall at any moment within it.
    """

    def __init__(
        self,
        v_max_m_s: float,
        accel_m_s2: float,
        brake_m_s2: float,
        yaw_rate_max_rad_s: float,
        reverse_m_s: float,
        speed_noise_m_s: float = 0.0,
        heading_noise_rad: float = 0.0,
        period_s: float = 0.0,
    ) -> None:
        positive("v_max_m_s", v_max_m_s)
        super().__init__(
            max(v_max_m_s, not_negative("reverse_m_s", reverse_m_s)), accel_m_s2, brake_m_s2, speed_noise_m_s
        )
        self.forward_m_s: Final = v_max_m_s
        self.reverse_m_s: Final = reverse_m_s
        self.yaw_rate_max_rad_s: Final = positive("yaw_rate_max_rad_s", yaw_rate_max_rad_s)
        self.heading_noise_rad: Final = not_negative("heading_noise_rad", heading_noise_rad)
        self.period_s: Final = not_negative("period_s", period_s)
        self._aligned: Final = cos(heading_noise_rad) if heading_noise_rad < 0.5 * pi else 0.0

    def extent(self, sample: Sample, time_s: float, ux: float, uy: float, uz: float = 0.0) -> float:
        return self._along(sample, time_s, ux, uy, self.brake_m_s2)

    def reach(self, situation: Situation, time_s: float) -> float:
        return SpeedAccelerationBound.extent(self, situation.own, time_s, 1.0, 0.0)

    def _along(self, sample: Sample, time_s: float, ux: float, uy: float, brake: float) -> float:
        """Return how far the robot gets along u; with an infinite brake, stopping is left out."""
        heading = sample.heading_rad
        c, s = cos(heading), sin(heading)
        along = c * ux + s * uy
        ahead = acos(1.0 if along > 1.0 else max(along, -1.0))
        behind = pi - ahead
        noise = self.heading_noise_rad
        ahead = ahead - noise if ahead > noise else 0.0
        behind = behind - noise if behind > noise else 0.0
        speed = sample.vx_m_s * c + sample.vy_m_s * s
        if speed != speed:
            return self.bound(time_s)
        forwards = max(0.0, self.speed_noise_m_s + speed)
        backwards = max(0.0, self.speed_noise_m_s - speed)
        if noise > 0.0:
            fastest, aligned = hypot(sample.vx_m_s, sample.vy_m_s) + self.speed_noise_m_s, self._aligned
            # Written so that nothing is divided by an alignment of 0, where every speed is possible.
            forwards = forwards / aligned if forwards < fastest * aligned else fastest
            backwards = backwards / aligned if backwards < fastest * aligned else fastest
        total = self._swept(forwards, self.forward_m_s, ahead, time_s, brake)
        other = self._swept(backwards, self.reverse_m_s, behind, time_s, brake)
        # Written so that NaN is returned.
        if not (total > 0.0 and other > 0.0):
            return total + other
        nearer = self._swept(max(forwards, backwards), self.v_max_m_s, min(ahead, behind), time_s, brake)
        return min(total + other, nearer)

    def _swept(self, speed: float, most: float, angle: float, time_s: float, brake: float) -> float:
        """Return the integral of speed times alignment over [0, T], and over the time that stopping takes."""
        if most == 0.0:
            return 0.0
        if speed > most:
            speed = most
        accel, turn = self.accel_m_s2, self.yaw_rate_max_rad_s
        rising_s = min((most - speed) / accel, time_s)
        reached = speed + accel * rising_s
        rests_s = time_s + reached / brake
        swung = angle - turn * self.period_s
        last = swung - turn * rests_s
        if last >= 0.5 * pi:
            return 0.0
        if turn * rests_s < _SLOW_TURN_RAD:
            # The closed form divides by the turn rate twice; counting the turn as done at once is an upper bound.
            way = way_m(speed, most, accel, time_s) + reached * reached / (2.0 * brake)
            return way * (cos(last) if last > 0.0 else 1.0)
        return (
            self._piece(speed, accel, angle, 0.0, rising_s)
            + self._piece(reached, 0.0, angle, rising_s, time_s)
            + self._piece(reached, -brake, swung, time_s, rests_s)
        )

    def _piece(self, speed: float, slope: float, angle: float, start_s: float, end_s: float) -> float:
        """Return the integral of max(0, cos(max(0, angle - turn t))) times a speed that changes at a constant rate."""
        turn = self.yaw_rate_max_rad_s
        begins_s = (angle - 0.5 * pi) / turn
        if begins_s >= end_s or start_s >= end_s:
            return 0.0
        if begins_s > start_s:
            speed += slope * (begins_s - start_s)
            start_s = begins_s
        aligned_s = angle / turn
        swept_m = 0.0
        if start_s < aligned_s:
            until_s = min(aligned_s, end_s)
            after = speed + slope * (until_s - start_s)
            first, last = angle - turn * start_s, angle - turn * until_s
            swept_m = (speed * sin(first) - after * sin(last)) / turn
            if slope != 0.0:
                swept_m += slope * (cos(last) - cos(first)) / (turn * turn)
            speed, start_s = after, until_s
        if start_s < end_s:
            rest_s = end_s - start_s
            swept_m += (speed + 0.5 * slope * rest_s) * rest_s
        return swept_m

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        elapsed_s = after.stamp_s - before.stamp_s
        if not elapsed_s >= 0.0 or not self._speeds_fit(before, after, elapsed_s):
            return False
        turned = abs(remainder(after.heading_rad - before.heading_rad, 2.0 * pi))
        if not turned <= self.yaw_rate_max_rad_s * elapsed_s + 2.0 * self.heading_noise_rad + _ROUNDING_RAD:
            return False
        dx, dy = after.x_m - before.x_m, after.y_m - before.y_m
        apart = hypot(dx, dy)
        spare = 2.0 * noise_m + ROUNDING_M
        return apart <= spare or apart <= self._along(before, elapsed_s, dx / apart, dy / apart, inf) + spare
