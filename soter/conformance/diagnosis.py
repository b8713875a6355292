"""Faults that the kit finds in samples and in the harness; they are reported before a clause's own likely cause."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Final

from soter.conformance.track import MOVING_M_S, TrackSample, run_m
from soter.geometry.workspace import Point
from soter.sdk import Capabilities

if TYPE_CHECKING:
    from soter.conformance.judging import Judging

_OLD_S: Final = 0.5
_MANY: Final = 20
_OFF_M: Final = 0.1
_FROZEN_S: Final = 1.0
_RECENT: Final = 60
_SLIP_M: Final = 0.002
_SHARE: Final = 0.5
_RUNS: Final = 2.4
_EMPTY: Final = 1e-6


def explain(bench: Judging) -> str:
    """Return what is wrong with samples, charge and room of the open fleet, with a semicolon; empty if nothing is."""
    if bench.capabilities is None or not bench.fleets:
        return ""
    found = [_narrow(bench)] if bench.harness.room_m < room_needed_m(bench.caps) else []
    for robot in bench.fleet.robots:
        track = bench.tracks.get(robot.id, [])
        if not track:
            continue
        who = f"robot {robot.id}"
        # Whatever the adapter raises here is no reason to lose what the clause has found.
        with suppress(Exception):
            track = [*track, track[-1]._replace(state=robot.read_state())]
        age_s = bench.now_s - track[-1].state.stamp_s
        if age_s > bench.caps.sample_age_s + _OLD_S and not bench.faulty:
            found.append(f"the last sample of {who} is {age_s:.1f} s old, nothing has been heard since")
        else:
            found += _off_the_truth(bench, track, who)
            found += _moves_at_no_speed(track, who)
            charge = track[-1].state.battery
            if charge is not None and charge <= _EMPTY:
                found.append(f"the battery of {who} is empty: the harness is to give it a charge that lasts longer")
        scatter_m, allowed_m = _scatter_m(track), bench.caps.position_noise_m
        if scatter_m > 2.0 * allowed_m + _SLIP_M:
            found.append(
                f"positions of {who} scatter by {scatter_m:.3f} m between samples, position_noise_m promises "
                f"{allowed_m:.3f} m"
            )
        if robot.discarded and not bench.faulty:
            found.append(f"{robot.discarded} samples of {who} were discarded: {robot.discarded_for}")
    return "".join(f"{each}; " for each in found)


def room_needed_m(caps: Capabilities) -> float:
    """Return the side of a room in which a robot can get up to speed and stop wherever clauses have left it."""
    return _RUNS * run_m(caps, caps.v_max_m_s / (caps.accel_m_s2 or math.inf), 2.0 * caps.lease_s)


def _narrow(bench: Judging) -> str:
    return (
        f"its room of {bench.harness.room_m:g} m may be too small for its top speed, its brakes and how it gains "
        f"speed: the harness's room_m = {room_needed_m(bench.caps):.1f} would do"
    )


def _off_the_truth(bench: Judging, track: Sequence[TrackSample], who: str) -> Iterator[str]:
    """Yield what is wrong if samples show a wrong place, or report motion without a change of place."""
    state = track[-1].state
    frozen_s = state.stamp_s - next(
        (each.state.stamp_s for each in reversed(track) if each.state[4:6] != state[4:6]), track[0].state.stamp_s
    )
    frozen = f"they have been of one and the same place for {frozen_s:.1f} s: they are frozen, or kept from before"
    if bench.fleet.truth is not None or bench.harness.gives("observe"):
        x_m, y_m = state.x_m, state.y_m
        # Nobody tells the truth while the robots' program is off, which is no reason to lose what the clause has found.
        with suppress(Exception):
            x_m, y_m, _ = bench.true_pose(state.robot_id)
        off_m = math.hypot(state.x_m - x_m, state.y_m - y_m)
        far_m = _OFF_M + bench.caps.position_noise_m + bench.caps.v_max_m_s * (bench.now_s - state.stamp_s)
        if off_m > far_m:
            why = frozen if frozen_s > _FROZEN_S else _mixed_up((state.x_m, state.y_m), (x_m, y_m), far_m)
            yield f"the samples of {who} put it {off_m:.2f} m from where it really is: {why}"
    elif frozen_s > _FROZEN_S and math.hypot(state.vx_m_s, state.vy_m_s) > MOVING_M_S:
        yield f"the samples of {who} say that it moves, but {frozen}"


def _mixed_up(said: Point, true: Point, off_m: float) -> str:
    """Return by which mix-up of coordinates a place is off, if there is one that explains it."""
    x_m, y_m = said
    for place, what in (
        ((x_m, -y_m), "y has the wrong sign"),
        ((-x_m, y_m), "x has the wrong sign"),
        ((-x_m, -y_m), "x and y have the wrong signs"),
        ((y_m, x_m), "x and y are swapped, as between NED and ENU"),
        ((x_m / 1000.0, y_m / 1000.0), "it is in millimetres"),
        ((x_m / 100.0, y_m / 100.0), "it is in centimetres"),
    ):
        # Near the origin all of them are about the same.
        if math.dist(place, true) <= off_m < _SHARE * math.hypot(*true):
            return what
    return "another frame, unit or origin, or another robot's"


def _moves_at_no_speed(track: Sequence[TrackSample], who: str) -> Iterator[str]:
    """Yield what is wrong if places change and velocities stay 0."""
    seen = [each.state for each in track]
    near = [(a, b) for a, b in pairwise(seen) if b.stamp_s - a.stamp_s <= _OLD_S]
    way_m = sum(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in near if len(near) >= _MANY)
    lasts_s = sum(b.stamp_s - a.stamp_s for a, b in near)
    slow_m_s = min(MOVING_M_S, _SHARE * way_m / lasts_s) if lasts_s > 0.0 else 0.0
    if way_m > _OFF_M and all(math.hypot(each.vx_m_s, each.vy_m_s) <= slow_m_s for each in seen):
        yield (
            f"the samples of {who} say that it stands, while they put it {way_m:.2f} m farther on: no velocity, or one "
            "that is taken from one read to the next"
        )


def _scatter_m(track: Sequence[TrackSample]) -> float:
    """Return how far positions typically are off the line between their neighbours, after allowing for braking."""
    states = [each.state for each in track[-_RECENT:]]
    off = []
    for a, b, c in zip(states, states[1:], states[2:], strict=False):
        if not a.stamp_s < b.stamp_s < c.stamp_s:
            continue
        share = (b.stamp_s - a.stamp_s) / (c.stamp_s - a.stamp_s)
        x_m, y_m = a.x_m + share * (c.x_m - a.x_m), a.y_m + share * (c.y_m - a.y_m)
        off.append(math.hypot(b.x_m - x_m, b.y_m - y_m))
    return median(off) if len(off) >= _MANY else 0.0
