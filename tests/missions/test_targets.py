"""Targets: the right places, the same for one seed, and for every robot a stream of its own."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.errors import ConfigError
from soter.geometry.workspace import Box, Workspace
from soter.geometry.workspace_xml import read_workspace
from soter.missions.surveillance import OUTSIDE_M, Targets, grid_places
from soter.stack.events import Place

RADIUS_M = 0.105
CASE = read_workspace(Path(__file__).parents[2] / "examples" / "surveillance.xml", phi_safer_m=0.1, spacing_m=0.5)
SETS = ("grid", "uniform", "hostile")


def draw(name: str, seed: int = 1, robot_id: int = 1, count: int = 300, workspace: Workspace = CASE) -> list[Place]:
    targets = Targets(workspace, {robot_id: RADIUS_M}, name, seed)
    return [targets.next(robot_id) for _ in range(count)]


def test_the_grid_of_the_surveillance_case() -> None:
    places = grid_places(CASE, RADIUS_M)
    # 26 with (2, 2), which is 0.1 m from a box: a body with a radius of 0.105 m cannot stand there.
    assert len(places) == len(set(places)) == 25
    assert sum(x in (0.0, 5.0) or y in (0.0, 5.0) for x, y in places) == 18
    assert all(CASE.clearance_m(x, y, RADIUS_M) >= 0.0 for x, y in places)
    assert (2.0, 2.0) not in places
    assert len(grid_places(CASE, 0.1)) == 26


def test_grid_targets_are_all_of_the_grid() -> None:
    assert set(draw("grid", count=2000)) == set(grid_places(CASE, RADIUS_M))


@pytest.mark.parametrize("side_m", [90.0, 130.0, 2000.0, 38_000.0])
def test_the_grid_of_a_large_site_has_no_more_points_than_are_soon_looked_at(side_m: float) -> None:
    places = grid_places(Workspace(side_m, side_m, (), ()), RADIUS_M)
    assert 4000 <= len(places) <= 11_000
    assert max(x for x, _ in places) > 0.98 * side_m
    assert all(place in places for place in [(x, y) for x in range(90) for y in range(90)]) is (side_m == 90.0)


def test_uniform_targets_are_refused_where_a_place_would_be_drawn_for_ever() -> None:
    full = Workspace(10.0, 10.0, (Box(0.0, 0.0, 10.0, 10.0, 1.0),), ())
    with pytest.raises(ConfigError, match=r"uniform.* 0\.105 m; allowed here: 'hostile'"):
        Targets(full, {1: RADIUS_M}, "uniform", 1)


def test_uniform_targets_fit_a_body_and_fill_the_room() -> None:
    places = draw("uniform", count=3000)
    assert all(CASE.contains(x, y) and CASE.clearance_m(x, y, RADIUS_M) >= 0.0 for x, y in places)
    cells = {(int(x), int(y)) for x, y in places}
    assert len(cells) >= 22


def test_hostile_targets_lie_up_to_a_metre_outside_and_in_boxes_too() -> None:
    places = draw("hostile", count=3000)
    assert all(-OUTSIDE_M <= value <= 5.0 + OUTSIDE_M for place in places for value in place)
    assert min(x for x, _ in places) < -0.9
    assert max(y for _, y in places) > 5.9
    assert sum(not CASE.contains(x, y) for x, y in places) / len(places) == pytest.approx(1.0 - 25.0 / 49.0, abs=0.05)
    assert any(CASE.clearance_m(x, y, 0.0) < 0.0 for x, y in places)


@pytest.mark.parametrize("name", SETS)
@given(seed=st.integers(0, 2**63 - 1), robot_id=st.integers(1, 255))
def test_one_seed_gives_one_sequence_whatever_the_other_robots_ask_for(name: str, seed: int, robot_id: int) -> None:
    alone = draw(name, seed, robot_id, 10)
    targets = Targets(CASE, {robot_id: RADIUS_M, robot_id + 1: RADIUS_M}, name, seed)
    among_others = []
    for number in range(10):
        for _ in range(number % 3):
            targets.next(robot_id + 1)
        among_others.append(targets.next(robot_id))
    assert among_others == alone


@pytest.mark.parametrize("name", SETS)
def test_seeds_and_robots_draw_differently(name: str) -> None:
    drawn = {tuple(draw(name, seed, robot_id, 8)) for seed in range(4) for robot_id in (1, 2, 3)}
    assert len(drawn) == 12


@pytest.mark.parametrize("name", SETS)
def test_a_robot_is_never_sent_to_where_it_comes_from(name: str) -> None:
    places = draw(name, count=1000)
    assert all(math.dist(a, b) >= 0.5 for a, b in pairwise(places))


def test_an_unknown_set_is_refused() -> None:
    with pytest.raises(KeyError):
        Targets(CASE, {1: RADIUS_M}, "nowhere", 1)


def test_a_room_with_one_place_on_the_grid_has_its_robot_sent_there_again() -> None:
    room = Workspace(0.9, 0.9, (), CASE.robots)
    targets = Targets(room, {1: 0.0}, "grid", 1)
    assert [targets.next(1) for _ in range(3)] == [(0.0, 0.0)] * 3


def test_a_room_without_a_place_on_the_grid_is_refused() -> None:
    room = Workspace(5.0, 0.9, (Box(-1.0, -0.2, 6.0, 0.2),), CASE.robots)
    with pytest.raises(ConfigError, match=r"targets: it is 'grid', .* 0\.105 m; allowed here: 'uniform', 'hostile'"):
        Targets(room, {1: 0.105}, "grid", 1)
