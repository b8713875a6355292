"""The track of a robot, as samples of its way, and the speeds and ramps that are computed from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import Final, NamedTuple

from soter.sdk import Capabilities, RobotState

MOVING_M_S: Final = 0.02
TURNING_RAD_S: Final = 0.1


class TrackSample(NamedTuple):
    """Where a robot was at one moment, by its own state or by the truth. Metres, radians, seconds."""

    at_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    state: RobotState

    @property
    def moves(self) -> bool:
        """Whether the robot drives or turns by more than noise."""
        return self.speed_m_s > MOVING_M_S or abs(self.yaw_rate_rad_s) > TURNING_RAD_S

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the distance to a place."""
        return math.hypot(self.x_m - x_m, self.y_m - y_m)


def turn(from_rad: float, to_rad: float) -> float:
    """Return the turn from one heading to another, in [-pi, pi)."""
    return (to_rad - from_rad + math.pi) % (2.0 * math.pi) - math.pi


def rates(before: TrackSample, at_s: float, x_m: float, y_m: float, heading_rad: float) -> tuple[float, float]:
    """Return the speed in m/s and the yaw rate in rad/s, counter-clockwise, from a sample to a later pose."""
    passed_s = at_s - before.at_s
    return before.distance_m(x_m, y_m) / passed_s, turn(before.heading_rad, heading_rad) / passed_s


class Fastest(NamedTuple):
    """The top speed in m/s, and the top turn rates to the left and to the right in rad/s, none of them negative."""

    speed_m_s: float
    left_rad_s: float
    right_rad_s: float


def fastest(track: Sequence[TrackSample], speed_s: float, turn_s: float) -> Fastest:
    """Return the top rates by the samples' own figures, or by their poses over a least time.

    Args:
        track: oldest first.
        speed_s: least time between two poses that make a speed; 0 to take the samples' own speeds. Those are exact if
            the truth is read in step with its simulation; otherwise the moments of reading are uncertain.
        turn_s: the same for turn rates.
    """
    if speed_s <= 0.0:
        speed, turns = max(each.speed_m_s for each in track), [each.yaw_rate_rad_s for each in track]
    else:
        # If the clock's offset is estimated anew on the way, some windows seem short: one in twenty does not count.
        speed = quantile([0.0, *(each[0] for each in _over(track, speed_s))], 0.95)
        turns = [each[1] for each in _over(track, turn_s)]
    return Fastest(speed, max((0.0, *turns)), -min((0.0, *turns)))


def _over(track: Sequence[TrackSample], window_s: float) -> Iterator[tuple[float, float]]:
    """Yield the speed and the yaw rate between samples that are at least some time apart, and hardly more."""
    first = 0
    for last, sample in enumerate(track):
        while first + 1 < last and sample.at_s - track[first + 1].at_s >= window_s:
            first += 1
        if sample.at_s - track[first].at_s >= window_s:
            yield rates(track[first], sample.at_s, sample.x_m, sample.y_m, sample.heading_rad)


class Ramp(NamedTuple):
    """One change between rest and an even speed on a straight way, as fitted to a track.

    Attributes:
        begins_s: from the event to the first change of speed.
        lasts_s: from there to the end of the change.
        speed_m_s: the even speed.
        run_m: how far the robot got after the event; 0 for a start.
        scatter_m: how far places were off the even way at most.
        unsure_s: how far the moments may be off because too few samples were taken during the change; mostly 0.
    """

    begins_s: float
    lasts_s: float
    speed_m_s: float
    run_m: float
    scatter_m: float
    unsure_s: float

    @property
    def rate_m_s2(self) -> float:
        """The acceleration or deceleration, if it was even."""
        return self.speed_m_s / max(self.lasts_s, 1e-3)


CRUISE_S: Final = 0.3
"""Length of the part of a track from which an even speed is taken."""

_CANDIDATES: Final = 40
_EARLY_S: Final = 0.02
_SWIFT_M_S: Final = 0.01
_DURING: Final = 2


def run_m(caps: Capabilities, gains_s: float, waits_s: float) -> float:
    """Return how far a robot may get while it gets up to speed, drives evenly, waits for `waits_s` and stops."""
    ramps_s = 1.5 * max(caps.v_max_m_s / caps.brake_m_s2, gains_s)
    return caps.v_max_m_s * (2.0 * reaction_s(caps) + ramps_s + 2.0 * CRUISE_S + waits_s)


def reaction_s(caps: Capabilities) -> float:
    """Return how long after a call a robot may begin to act, and a sample to show it."""
    return caps.latency_s + caps.jitter_s + caps.setpoint_period_s + caps.sample_age_s


def fit_stop(track: Sequence[TrackSample], event_s: float) -> Ramp | None:
    """Return how a robot that drove evenly came to rest after an event; None if it did not drive before.

    The one unknown is when the robot begins to brake; the way from there to rest says how hard. So a late brake and a
    weak one are told apart.
    """
    before = [each for each in track if event_s - CRUISE_S <= each.at_s <= event_s]
    line = _line(before, before)
    if line is None:
        return None
    speed, at_event, along, scatter_m = line[0], line[1] + line[0] * event_s, line[2], line[3]
    after = [(each.at_s - event_s, along(each) - at_event) for each in track if each.at_s > event_s]
    if not after:
        return None
    run_m = max(after[-1][1], 0.0)

    def lasts_s(begins_s: float) -> float:
        return 2.0 * max(run_m / speed - begins_s, 0.0)

    def miss(begins_s: float) -> float:
        ramp_s = lasts_s(begins_s)
        return sum((way - _braked(time_s, begins_s, ramp_s, speed)) ** 2 for time_s, way in after)

    # By an estimated clock braking may seem to begin just before the event; cut off there, it would seem harder.
    begins_s = _least(miss, -_EARLY_S, max(run_m / speed, 0.0))
    unsure_s = _unsure_s([time_s for time_s, _ in after], begins_s, lasts_s(begins_s))
    return Ramp(begins_s, lasts_s(begins_s), speed, run_m, scatter_m, unsure_s)


def fit_start(track: Sequence[TrackSample], event_s: float) -> Ramp | None:
    """Return how a robot at rest got going after an event; None if it did not get to an even speed."""
    after = [each for each in track if each.at_s > event_s]
    if not after:
        return None
    line = _line([each for each in after if each.at_s >= after[-1].at_s - CRUISE_S], after)
    if line is None:
        return None
    speed, along, scatter_m = line[0], line[2], line[3]
    still = [along(each) for each in track if event_s - CRUISE_S <= each.at_s <= event_s]
    began = along(after[0]) if not still else sum(still) / len(still)
    # An even motion from rest to the same way would begin in the middle of the ramp.
    middle_s = max((began - line[1]) / speed - event_s, 0.0)
    ways = [(each.at_s - event_s, along(each) - began) for each in after]

    def miss(begins_s: float) -> float:
        ramp_s = 2.0 * (middle_s - begins_s)
        return sum((way - _begun(time_s, begins_s, ramp_s, speed)) ** 2 for time_s, way in ways)

    begins_s = _least(miss, -_EARLY_S, middle_s)
    lasts_s = 2.0 * (middle_s - begins_s)
    return Ramp(begins_s, lasts_s, speed, 0.0, scatter_m, _unsure_s([time_s for time_s, _ in ways], begins_s, lasts_s))


def _unsure_s(times_s: Sequence[float], begins_s: float, lasts_s: float) -> float:
    """Return the time between samples if too few were taken during a change of speed to tell its two moments."""
    if sum(begins_s < time_s < begins_s + lasts_s for time_s in times_s) >= _DURING:
        return 0.0
    return median([after_s - before_s for before_s, after_s in pairwise(times_s)] or [0.0])


def _line(
    even: Sequence[TrackSample], whole: Sequence[TrackSample]
) -> tuple[float, float, Callable[[TrackSample], float], float] | None:
    """Return a line fitted to samples of an even way: speed, way at time 0, projection on the course, scatter."""
    if len(even) < 3 or even[-1].at_s <= even[0].at_s:
        return None
    dx, dy = even[-1].x_m - whole[0].x_m, even[-1].y_m - whole[0].y_m
    length = math.hypot(dx, dy)
    if length <= _SWIFT_M_S * (even[-1].at_s - even[0].at_s):
        return None
    ex, ey = dx / length, dy / length

    def along(sample: TrackSample) -> float:
        return sample.x_m * ex + sample.y_m * ey

    times = [each.at_s for each in even]
    ways = [along(each) for each in even]
    middle_s, middle_m = sum(times) / len(times), sum(ways) / len(ways)
    spread = sum((time_s - middle_s) ** 2 for time_s in times)
    speed = sum((time_s - middle_s) * (way - middle_m) for time_s, way in zip(times, ways, strict=True)) / spread
    if speed <= _SWIFT_M_S:
        return None
    begins_m = middle_m - speed * middle_s
    return speed, begins_m, along, max(abs(way - begins_m - speed * at) for at, way in zip(times, ways, strict=True))


def _braked(time_s: float, begins_s: float, lasts_s: float, speed: float) -> float:
    if time_s <= begins_s:
        return speed * time_s
    braking_s = min(time_s - begins_s, lasts_s)
    return speed * begins_s + (speed * braking_s * (1.0 - braking_s / (2.0 * lasts_s)) if lasts_s > 0.0 else 0.0)


def _begun(time_s: float, begins_s: float, lasts_s: float, speed: float) -> float:
    if time_s <= begins_s:
        return 0.0
    rising_s = min(time_s - begins_s, lasts_s)
    ramp_m = speed * rising_s * rising_s / (2.0 * lasts_s) if lasts_s > 0.0 else 0.0
    return ramp_m + speed * max(time_s - begins_s - lasts_s, 0.0)


def _least(miss: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function with one minimum is least."""
    best = low
    for _ in range(2):
        step = (high - low) / _CANDIDATES
        best = min((low + index * step for index in range(_CANDIDATES + 1)), key=miss)
        low, high = max(low, best - step), min(high, best + step)
    return best


def quantile(values: Sequence[float], share: float) -> float:
    """Return the least of the values that this share of them does not exceed."""
    ordered = sorted(values)
    return ordered[min(max(math.ceil(share * len(ordered)) - 1, 0), len(ordered) - 1)]
