"""What was seen of a robot while it was driven: samples of its way, and what they say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from soter.sdk import RobotState

MOVING_M_S: Final = 0.02
TURNING_RAD_S: Final = 0.1


class Sample(NamedTuple):
    """Where a robot was at one moment, as its own state or the truth has it. Metres, radians, seconds."""

    at_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    state: RobotState

    @property
    def moves(self) -> bool:
        """Whether it drives or turns, beyond what is noise."""
        return self.speed_m_s > MOVING_M_S or abs(self.yaw_rate_rad_s) > TURNING_RAD_S

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return how far it is from a place."""
        return math.hypot(self.x_m - x_m, self.y_m - y_m)


def turn(from_rad: float, to_rad: float) -> float:
    """Return the turn from one heading to another, in [-pi, pi)."""
    return (to_rad - from_rad + math.pi) % (2.0 * math.pi) - math.pi


def rates(before: Sample, at_s: float, x_m: float, y_m: float, heading_rad: float) -> tuple[float, float]:
    """Return the speed in m/s and the yaw rate in rad/s, counter-clockwise, from a sample to a later pose."""
    passed_s = at_s - before.at_s
    return before.distance_m(x_m, y_m) / passed_s, turn(before.heading_rad, heading_rad) / passed_s


def fastest(track: Sequence[Sample], window_s: float) -> tuple[float, float]:
    """Return the top speed and the top yaw rate that samples say, or their poses over at least so long.

    Args:
        track: oldest first.
        window_s: 0 to take the samples' word, which is exact where the truth is read in step with its simulation.
            Elsewhere it is read at moments that the simulation does not know: only over some time is a change of pose
            a speed.
    """
    if window_s <= 0.0:
        return max(each.speed_m_s for each in track), max(abs(each.yaw_rate_rad_s) for each in track)
    speed, rate, first = 0.0, 0.0, 0
    for last, sample in enumerate(track):
        while first + 1 < last and sample.at_s - track[first + 1].at_s >= window_s:
            first += 1
        if sample.at_s - track[first].at_s >= window_s:
            over = rates(track[first], sample.at_s, sample.x_m, sample.y_m, sample.heading_rad)
            speed, rate = max(speed, over[0]), max(rate, abs(over[1]))
    return speed, rate
