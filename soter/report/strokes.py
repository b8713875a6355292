"""Computes what a picture of a run draws: the driver over time, shares of control, and places of its changes."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import replace
from typing import Final, NamedTuple

from soter.record.tracks import RunTracks, Track

LONG_S: Final = 900.0
"""Length of a run above which not all of its ways are drawn, since they would hide each other."""

LAST_S: Final = 600.0
"""Length of the end of a long run whose ways are drawn."""


FEW_ROBOTS: Final = 3
CROWD_S: Final = 720.0
"""Time of ways drawn of all robots together, if there are many."""

LEAST_S: Final = 60.0


STARTING: Final = -1
"""In place of a driver, while a robot is starting."""


class Stretch(NamedTuple):
    """Neighbouring samples with one driver.

    Attributes:
        driver: index into `RunTracks.drivers`, or `STARTING`.
        first: index of the first sample.
        last: index of the last; the first of the next stretch, so that there is no gap between them.
    """

    driver: int
    first: int
    last: int


class Mark(NamedTuple):
    """A place, in metres, at which a module took a robot over from the AC, or with None the AC got it back."""

    robot_id: int
    x_m: float
    y_m: float
    module: str | None


def stretches(track: Track, since_s: float = -math.inf, started_s: float = 0.0) -> list[Stretch]:
    """Return the stretches of a robot with one driver each, in order, from a time on; it is starting until another."""
    first = bisect_left(track.time_s, since_s)
    found: list[Stretch] = []
    started, count = bisect_left(track.time_s, started_s), len(track.time_s)
    driver = [STARTING] * started + list(track.driver[started:])
    for index in range(first + 1, count):
        if driver[index] != driver[first]:
            found.append(Stretch(driver[first], first, index))
            first = index
    if first < count - 1:
        found.append(Stretch(driver[first], first, count - 1))
    return found


def end_s(run: RunTracks) -> float:
    """Return when a run ended; 0 without any sample."""
    return max((track.time_s[-1] for track in run.tracks.values() if len(track.time_s)), default=0.0)


def ways_since_s(run: RunTracks) -> float:
    """Return the time from which on a run's ways are drawn: all of a short run of few robots, else its end."""
    end = end_s(run)
    last_s = LAST_S if end > LONG_S else end
    if len(run.tracks) > FEW_ROBOTS:
        last_s = min(last_s, max(LEAST_S, CROWD_S / len(run.tracks)))
    return end - last_s


def until(run: RunTracks, time_s: float) -> RunTracks:
    """Return a run up to a moment."""
    tracks = {}
    for robot_id, track in run.tracks.items():
        end = bisect_right(track.time_s, time_s)
        tracks[robot_id] = Track(
            track.time_s[:end], track.x_m[:end], track.y_m[:end], track.battery[:end], track.driver[:end]
        )
    return replace(
        run, tracks=tracks, switches=[switch for switch in run.switches if switch.time_s <= time_s],
        violations=tuple(violation for violation in run.violations if violation.start_s <= time_s),
    )  # fmt: skip


def shares(run: RunTracks) -> dict[int, float]:
    """Return the part of the robots' time by driver, see `Stretch`; all parts add up to 1, or are all 0."""
    spent = dict.fromkeys(range(len(run.drivers)), 0.0)
    for robot_id, track in run.tracks.items():
        for driver, first, last in stretches(track, started_s=run.started_s(robot_id)):
            spent[driver] = spent.get(driver, 0.0) + track.time_s[last] - track.time_s[first]
    total = sum(spent.values())
    return {driver: part / total for driver, part in spent.items()} if total > 0.0 else spent


def place_at(track: Track, time_s: float) -> tuple[float, float] | None:
    """Return where a robot was, x and y in metres, between two samples on the straight line; None if never sampled."""
    times = track.time_s
    if not times:
        return None
    after = min(bisect_left(times, time_s), len(times) - 1)
    before = max(after - 1, 0)
    span_s = times[after] - times[before]
    part = min(max((time_s - times[before]) / span_s, 0.0), 1.0) if span_s > 0.0 else 0.0
    return (
        track.x_m[before] + part * (track.x_m[after] - track.x_m[before]),
        track.y_m[before] + part * (track.y_m[after] - track.y_m[before]),
    )


def marks(run: RunTracks, since_s: float) -> list[Mark]:
    """Return the places at which ACs lost and got back control, from a time on; changes between modules have none."""
    found = []
    for switch in run.switches:
        track = run.tracks.get(switch.robot_id)
        between_modules = (switch.before is None) == (switch.after is None)
        if track is None or between_modules or switch.time_s < since_s:
            continue
        # The first hand-over to the AC means nothing.
        if switch.time_s <= run.started_s(switch.robot_id):
            continue
        place = place_at(track, switch.time_s)
        if place is not None:
            found.append(Mark(switch.robot_id, *place, switch.after))
    return found


def broken_at(run: RunTracks) -> list[tuple[float, float]]:
    """Return where the robots were, x and y in metres, when they began to break a rule."""
    found = []
    for violation in run.violations:
        for robot_id in violation.robots:
            # Ground truth also judges the robots of other processes.
            track = run.tracks.get(robot_id)
            place = None if track is None else place_at(track, violation.start_s)
            if place is not None:
                found.append(place)
    return found


def time_unit(seconds: float) -> tuple[float, str]:
    """Return the unit for a time axis of some length: its length in seconds, and its name."""
    if seconds < 180.0:
        return 1.0, "s"
    return (60.0, "min") if seconds <= 4 * 3600.0 else (3600.0, "h")
