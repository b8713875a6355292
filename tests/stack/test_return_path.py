"""A robot always has a path home that it can drive, wherever the AC takes it, and it knows what that costs."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from soter.geometry.draft import site_of
from soter.geometry.workspace import Box, Workspace, grown
from soter.stack.recovery import RecoveryPlanner
from soter.stack.return_path import DETOUR_M, ReturnPath
from soter.stack.site_routes import Rectangle
from soter.stack.site_terrain import terrain_of
from soter.stack.terrain import Point, Terrain
from tests.geometry.drawn import drawn
from tests.stack.follower import Controllers, Follower
from tests.stack.ground import RADIUS_M, boxes, dock, inside, planner

STATION = Box(0.8, 0.8, 1.2, 1.2)
STEP_M = 0.011
"""At top speed a robot drives so far in a tick."""

walks = st.lists(st.tuples(st.floats(-math.pi, math.pi), st.integers(1, 60)), min_size=1, max_size=12)


def allowed(recovery: RecoveryPlanner, x_m: float, y_m: float) -> bool:
    """Whether a robot that was stopped may be at a place, as far as geofence and obstacle go."""
    terrain, path_m = recovery.terrain, recovery.path_m
    return terrain.fence_m(x_m, y_m) >= 0.5 * path_m and terrain.clearance_m(x_m, y_m) >= path_m


def walk(recovery: RecoveryPlanner, start: Point, turns: list[tuple[float, int]]) -> list[Point]:
    """Return where an AC takes a robot that goes on this way and that until it is stopped."""
    places = [start]
    for angle, steps in turns:
        for _ in range(steps):
            x, y = places[-1]
            there = (x + STEP_M * math.cos(angle), y + STEP_M * math.sin(angle))
            if not allowed(recovery, *there):
                break
            places.append(there)
    return places


def room(some: tuple[Box, ...], others: tuple[Point, ...] = ()) -> tuple[RecoveryPlanner, list[Rectangle]]:
    recovery = planner(Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M))
    return recovery, [grown(Box(*place, *place), recovery.apart_m(0.0)) for place in others]


def check_length(path: ReturnPath, places: list[Point], path_m: float) -> None:
    """The length is finite, no less than the straight line, and grows by no more than the way driven."""
    path.track(*places[0])
    lengths = [path.length_m(*places[0])]
    driven = [0.0]
    for before, there in pairwise(places):
        path.track(*there)
        lengths.append(path.length_m(*there))
        driven.append(driven[-1] + math.dist(before, there))
        assert lengths[-1] < math.inf
        assert lengths[-1] >= math.dist(there, path.place) - 1e-9
        # Whichever place it was looked from before: what has been driven since pays for all of it.
        assert lengths[-1] - driven[-1] <= min(a - b for a, b in zip(lengths, driven, strict=True)) + 2.0 * path_m
        legs = path.legs(*there)
        assert legs[-1] == path.place
        line = [there, *legs]
        assert sum(math.dist(a, b) for a, b in pairwise(line)) <= lengths[-1] + 2.0 * path_m


@settings(max_examples=60)
@given(boxes(), inside, walks)
def test_the_path_is_never_lost_and_grows_by_no_more_than_what_is_driven(
    some: tuple[Box, ...], start: Point, turns: list[tuple[float, int]]
) -> None:
    recovery, _ = room(some)
    assume(allowed(recovery, *start) and allowed(recovery, *STATION.centre))
    path = dock(recovery).path
    assume(path.shortest_m(*start) < math.inf)
    check_length(path, walk(recovery, start, turns), recovery.path_m)


@pytest.mark.parametrize("seed", range(6))
def test_in_a_site_little_more_is_accounted_for_than_the_roadmap_shows(seed: int) -> None:
    stream, site = random.Random(seed), site_of(drawn(seed), phi_safer_m=0.1, spacing_m=0.5)
    recovery = planner(terrain_of(site, RADIUS_M))
    path = dock(recovery, site.robots[0].charger).path
    low_x, low_y, high_x, high_y = site.bounds
    starts = [(stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)) for _ in range(300)]
    start = next(place for place in starts if allowed(recovery, *place) and path.shortest_m(*place) < math.inf)
    turns = [(stream.uniform(-math.pi, math.pi), stream.randint(20, 200)) for _ in range(25)]
    places = walk(recovery, start, turns)
    assert len(places) > 300
    check_length(path, places, recovery.path_m)
    path.track(*places[0])
    for place in places:
        path.track(*place)
        shortest_m = path.shortest_m(*place)
        assert path.length_m(*place) <= shortest_m + 2.0 * DETOUR_M + 4.0 * max(1.0, 0.03 * shortest_m)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("inset_m", [0.25, 50.0], ids=["roomy", "narrow"])
def test_a_path_that_is_looked_for_again_and_again_leads_on(seed: int, inset_m: float) -> None:
    # Safe controllers that take turns look for it anew each time, wherever the one before has let go.
    stream, site = random.Random(seed), site_of(drawn(seed), phi_safer_m=0.1, spacing_m=0.5)
    recovery = planner(terrain_of(site, RADIUS_M))
    path = dock(recovery, site.robots[0].charger, inset_m=inset_m).path
    low_x, low_y, high_x, high_y = site.bounds
    starts = [(stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)) for _ in range(300)]
    start = next(place for place in starts if allowed(recovery, *place) and path.shortest_m(*place) < math.inf)
    turns = [(stream.uniform(-math.pi, math.pi), stream.randint(20, 200)) for _ in range(25)]
    places = walk(recovery, start, turns)
    for place in places:
        path.track(*place)
    here, driven_m = places[-1], 0.0
    most_m = path.length_m(*here) + DETOUR_M
    while math.dist(here, path.place) > STEP_M:
        legs = path.legs(*here)
        for _ in range(stream.randint(5, 40)):
            while len(legs) > 1 and math.dist(here, legs[0]) < STEP_M:
                legs = legs[1:]
            away_m = math.dist(here, legs[0])
            part = min(1.0, STEP_M / away_m) if away_m else 1.0
            here = here[0] + part * (legs[0][0] - here[0]), here[1] + part * (legs[0][1] - here[1])
            driven_m += part * away_m
            path.track(*here)
        assert driven_m <= most_m, (here, legs)


OTHERS = ((3.5, 3.5), (3.5, 1.5))


@settings(max_examples=40)
@given(boxes(2), inside, walks)
def test_the_path_keeps_out_of_other_stations_but_for_where_the_robot_has_come_from(
    some: tuple[Box, ...], start: Point, turns: list[tuple[float, int]]
) -> None:
    recovery, occupied = room(some, OTHERS)
    assume(allowed(recovery, *start) and allowed(recovery, *STATION.centre))
    path = dock(recovery, occupied=occupied).path
    assume(path.shortest_m(*start) < math.inf)
    check_length(path, walk(recovery, start, turns), recovery.path_m)


@settings(max_examples=40)
@given(boxes(), inside, walks)
@example((Box(2.0, 0.0, 2.1, 3.0), Box(1.0, 3.4, 3.0, 3.6)), (4.0, 1.0), [(2.0, 60), (1.0, 60)])
def test_from_wherever_the_ac_has_left_it_a_robot_drives_home_by_certified_legs(
    some: tuple[Box, ...], start: Point, turns: list[tuple[float, int]]
) -> None:
    recovery, _ = room(some)
    assume(allowed(recovery, *start) and allowed(recovery, *STATION.centre))
    made = Controllers(recovery.terrain)
    assume(made.dock.path.shortest_m(*start) < math.inf)
    places = walk(recovery, start, turns)
    for place in places:
        made.dock.path.track(*place)
    robot = Follower(made, made.home, places[-1])
    for _ in range(600):
        robot.step()
        if robot.home_m() < 0.03:
            break
    assert robot.home_m() < 0.03, robot.place


@settings(max_examples=25)
@given(inside, walks)
def test_it_gets_home_past_robots_that_stand_on_all_other_stations(
    start: Point, turns: list[tuple[float, int]]
) -> None:
    others = ((3.5, 3.5), (2.0, 1.0))
    recovery, occupied = room((Box(2.5, 2.0, 3.0, 2.5),), others)
    places = walk(recovery, start, turns)
    assume(allowed(recovery, *start))
    assume(all(math.dist(place, other) >= recovery.apart_m(0.0) for place in (start, places[-1]) for other in others))
    made = Controllers(recovery.terrain, occupied=occupied)
    assume(made.dock.path.shortest_m(*start) < math.inf)
    for place in places:
        made.dock.path.track(*place)
    robot = Follower(made, made.home, places[-1], *others)
    for _ in range(600):
        robot.step()
        if robot.home_m() < 0.03:
            break
    assert robot.home_m() < 0.03, robot.place


# --- where the roadmap shows nothing -----------------------------------------------------------------------


def diagonal(aside_m: float) -> RecoveryPlanner:
    """Two boxes corner to corner: a disc passes between them, a square of its width does not."""
    high = 2.5 + aside_m
    made = Workspace(5.0, 5.0, (Box(0.0, 0.0, 2.5, 2.5), Box(high, high, 5.0, 5.0)), ())
    return planner(Terrain(made, RADIUS_M))


@pytest.mark.parametrize("ends", [[(4.5, 0.5)], [(4.5, 2.0), (4.5, 0.5), (2.8, 0.5), (2.8, 1.5)]])
def test_a_robot_that_has_come_through_a_gap_that_no_roadmap_shows_goes_back_through_it(ends: list[Point]) -> None:
    recovery = diagonal(0.25)
    station = Box(0.8, 3.8, 1.2, 4.2)
    made = Controllers(recovery.terrain, station=station)
    path = made.dock.path
    assert path.shortest_m(*ends[0]) == math.inf, "no roadmap shows it"
    places: list[Point] = []
    for one, other in pairwise([(1.0, 3.5), (2.125, 3.125), (3.125, 2.125), *ends]):
        steps = math.ceil(math.dist(one, other) / STEP_M)
        places += [(one[0] + (other[0] - one[0]) * k / steps, one[1] + (other[1] - one[1]) * k / steps)
                   for k in range(steps)]  # fmt: skip
    assert all(allowed(recovery, *place) for place in places)
    check_length(path, places, recovery.path_m)
    robot = Follower(made, made.home, places[-1])
    robot.run(30.0)
    assert robot.home_m() < 0.03, robot.place


def test_a_robot_that_is_set_down_behind_such_a_gap_has_no_path() -> None:
    path = dock(diagonal(0.25), Box(0.8, 3.8, 1.2, 4.2)).path
    path.track(4.5, 0.5)
    assert path.length_m(4.5, 0.5) == math.inf
    assert path.legs(4.5, 0.5) == []


def narrow_door() -> tuple[ReturnPath, Point]:
    """A room and a place from which the path leads through a narrow door, or around, which is 0.53 m longer."""
    wall = (Box(2.0, 0.0, 2.2, 2.0), Box(2.0, 2.34, 2.2, 2.6))
    return dock(room(wall)[0], Box(0.8, 1.97, 1.2, 2.37)).path, (3.2, 2.17)


def test_a_roomy_path_is_taken_before_a_narrow_one() -> None:
    """In the door the obstacle module would drive."""
    path, here = narrow_door()
    path.track(*here)
    assert path.narrow.distance_m(*here) == pytest.approx(math.dist(here, path.place))
    assert path.narrow.distance_m(*here) + DETOUR_M < path.roomy.distance_m(*here)
    assert path.legs(*here) == path.roomy.legs(*here)
    assert path.length_m(*here) == pytest.approx(path.roomy.distance_m(*here) + DETOUR_M)


def test_a_robot_that_has_come_by_a_narrow_path_need_not_pay_for_a_roomy_one() -> None:
    path, here = narrow_door()
    for step in range(221):
        path.track(1.0 + 0.01 * step, 2.17)
    assert path.length_m(*here) == pytest.approx(math.dist(here, path.place) + DETOUR_M, abs=1e-3)
    way = [here, *path.legs(*here)]
    assert sum(math.dist(a, b) for a, b in pairwise(way)) == pytest.approx(math.dist(here, path.place))
