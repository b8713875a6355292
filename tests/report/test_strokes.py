"""What of a run is drawn."""

from __future__ import annotations

from dataclasses import replace

import pytest

from soter.record.tracks import RunTracks, Track
from soter.report.strokes import (
    CROWD_S,
    LAST_S,
    LEAST_S,
    LONG_S,
    STARTING,
    Mark,
    Stretch,
    broken_at,
    end_s,
    marks,
    place_at,
    shares,
    stretches,
    time_unit,
    until,
    ways_since_s,
)
from soter.rta import BEGINS_S, SwitchRecord
from soter.sdk import Violation
from tests.report.conftest import make_run, make_track


def test_stretches_follow_each_other_without_gap() -> None:
    assert stretches(make_track(1, "1000200")) == [
        Stretch(1, 0, 1), Stretch(0, 1, 4), Stretch(2, 4, 5), Stretch(0, 5, 6),
    ]  # fmt: skip


def test_stretches_from_a_time_on() -> None:
    assert stretches(make_track(1, "1000200"), 2.5) == [Stretch(0, 3, 4), Stretch(2, 4, 5), Stretch(0, 5, 6)]
    assert stretches(make_track(1, "1000200"), 99.0) == []


def test_a_robot_is_starting_until_its_ac_first_has_it() -> None:
    run = make_run(1, "110100", 0.5)
    assert run.started_s(1) == 1.0
    assert stretches(run.tracks[1], started_s=1.0) == [
        Stretch(STARTING, 0, 2), Stretch(0, 2, 3), Stretch(1, 3, 4), Stretch(0, 4, 5),
    ]  # fmt: skip


@pytest.mark.parametrize("drivers", ["111111", "1", "111110"])
def test_a_robot_that_a_module_has_for_long_is_not_starting_any_more(drivers: str) -> None:
    assert make_run(1, drivers).started_s(1) == BEGINS_S


def test_without_modules_and_in_trials_no_robot_is_starting() -> None:
    assert make_run(1, "0000").started_s(1) == 0.0
    assert make_run(1, "").started_s(1) == 0.0
    assert replace(make_run(1, "1100"), begins=False).started_s(1) == 0.0


@pytest.mark.parametrize(("drivers", "count"), [("", 0), ("0", 0), ("00", 1), ("01", 1), ("011", 2)])
def test_a_stretch_needs_two_samples(drivers: str, count: int) -> None:
    assert len(stretches(make_track(1, drivers))) == count


def test_shares_add_up() -> None:
    # Each robot was starting for 1 s of its 9, and the modules had it from 4 to 5 and from 8 to 9; the AC had the rest.
    assert shares(make_run()) == pytest.approx({0: 6 / 9, 1: 1 / 9, 2: 1 / 9, STARTING: 1 / 9})
    assert sum(shares(make_run(5, "0120120120")).values()) == pytest.approx(1.0)


def test_shares_of_nothing_are_nothing() -> None:
    empty = make_run(1, "")
    assert shares(empty) == {0: 0.0, 1: 0.0, 2: 0.0}
    assert end_s(empty) == 0.0


def test_places_lie_between_samples() -> None:
    track = make_track(2, "000")
    assert place_at(track, 0.5) == pytest.approx((0.05, 2.0))
    assert place_at(track, -1.0) == pytest.approx((0.0, 2.0))
    assert place_at(track, 9.0) == pytest.approx((0.2, 2.0))
    assert place_at(Track(), 0.0) is None


def test_marks_are_changes_between_ac_and_sc() -> None:
    run = make_run(1)
    assert [(mark.robot_id, round(mark.x_m, 3), mark.y_m, mark.module) for mark in marks(run, 0.0)] == [
        (1, 0.4, 1.0, "geofence"), (1, 0.5, 1.0, None), (1, 0.8, 1.0, "collision"),
    ]  # fmt: skip
    assert len(marks(run, 4.5)) == 2


def test_neither_the_start_nor_a_change_of_module_is_marked() -> None:
    run = make_run(1, "1000")
    run.switches = [
        SwitchRecord(0.9, 1, "collision", None, "", "", ()),
        SwitchRecord(1.0, 1, "collision", "geofence", "", "", ()),
        SwitchRecord(2.0, 7, None, "geofence", "", "", ()),
        SwitchRecord(2.0, 1, None, "geofence", "", "", ()),
    ]
    assert marks(run, 0.0) == [Mark(1, 0.2, 1.0, "geofence")]


def test_a_violation_is_where_its_robots_were_when_it_began() -> None:
    run = make_run(2)
    run.violations = Violation("geofence", (2,), 4.5, 6.0), Violation("collision", (1, 2, 7), 8.0, None)
    # Robot 7 is of another process.
    assert [(round(x_m, 3), y_m) for x_m, y_m in broken_at(run)] == [(0.45, 2.0), (0.8, 1.0), (0.8, 2.0)]
    assert broken_at(until(run, 4.6)) == [(0.4, 2.0)]
    assert broken_at(until(run, 4.0)) == []


def test_of_a_long_run_only_the_end_is_drawn(run: RunTracks) -> None:
    assert ways_since_s(run) == 0.0
    assert ways_since_s(make_run(1, "0" * 10, LONG_S / 9)) == 0.0
    assert ways_since_s(make_run(1, "0" * 10, 800.0)) == 7200.0 - LAST_S


@pytest.mark.parametrize(("seconds", "unit"), [(60.0, "s"), (600.0, "min"), (7200.0, "min"), (86400.0, "h")])
def test_time_units(seconds: float, unit: str) -> None:
    assert time_unit(seconds)[1] == unit


def test_a_run_until_a_moment_has_nothing_of_later() -> None:
    run = make_run()
    part = until(run, 4.5)
    assert [list(track.time_s) for track in part.tracks.values()] == [[0.0, 1.0, 2.0, 3.0, 4.0]] * 2
    assert [len(track.driver) for track in part.tracks.values()] == [5, 5]
    assert part.switches == [switch for switch in run.switches if switch.time_s <= 4.5] != run.switches
    assert until(run, 100.0) == run
    assert end_s(until(run, -1.0)) == 0.0


def test_of_many_robots_less_is_drawn_of_each() -> None:
    two, six = make_run(robots=2, period_s=30.0), make_run(robots=6, period_s=30.0)
    assert end_s(two) == end_s(six) == 270.0
    assert ways_since_s(two) == 0.0
    assert ways_since_s(six) == 270.0 - CROWD_S / 6
    assert ways_since_s(make_run(robots=60, period_s=30.0)) == 270.0 - LEAST_S
