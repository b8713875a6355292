"""The four rules: their margins against brute force, and that what is unknown is never safe."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.rta import Region, Situation
from soter.stack.battery import Charged, ChargeForTheWayHome
from soter.stack.collision import Separation
from soter.stack.return_path import DETOUR_M
from soter.stack.static_rules import Clearance, Fence
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.stack.ground import COST_PER_M, TERRAIN, between, clear_m, dock, fence_m, inside, planner, seen

anywhere = st.tuples(st.floats(-1.0, 6.0), st.floats(-1.0, 6.0))
FENCE = Fence(0.0, 5.0, 0.0, 5.0)
DOCK = dock()
FROM_ANCHOR_M = 0.26
"""The path is looked for again at the latest when the robot has got so far from where it was looked for last."""


def at(place: Point, battery: float | None = 1.0) -> Situation:
    return seen(At(*place, battery=battery))


@given(anywhere)
def test_the_fences_margin_is_the_distance_to_the_nearest_side(place: Point) -> None:
    assert FENCE.margin(at(place)) == pytest.approx(fence_m(*place))
    assert FENCE.inset(0.5).margin(at(place)) == pytest.approx(fence_m(*place) - 0.5)


@given(anywhere)
def test_clearance_is_the_bodys(place: Point) -> None:
    margin = Clearance(TERRAIN, 0.1).margin(at(place))
    if clear_m(TERRAIN, *place) > -TERRAIN.body_radius_m:
        assert margin == pytest.approx(clear_m(TERRAIN, *place) - 0.1)
    else:
        assert margin <= -TERRAIN.body_radius_m - 0.1


@given(inside, st.lists(inside, max_size=5))
def test_separation_is_the_distance_to_the_nearest_peer(own: Point, others: list[Point]) -> None:
    peers = [At(*place, robot_id=number) for number, place in enumerate(others, start=2)]
    nearest = min((math.dist(own, place) for place in others), default=math.inf)
    assert Separation(0.3, 0.22).margin(seen(At(*own), peers)) == pytest.approx(nearest - 0.3)


@given(inside, st.lists(st.tuples(inside, st.floats(0.0, 0.49)), min_size=1, max_size=4))
def test_an_older_peer_may_have_come_nearer_since(own: Point, others: list[tuple[Point, float]]) -> None:
    now_s = 10.0
    peers = [At(*place, stamp_s=now_s - age_s, robot_id=n) for n, (place, age_s) in enumerate(others, start=2)]
    expected = min(math.dist(own, place) - 0.22 * age_s for place, age_s in others) - 0.3
    margin = Separation(0.3, 0.22).margin(seen(At(*own, stamp_s=now_s), peers, now_s))
    assert margin == pytest.approx(expected)


@pytest.mark.parametrize(("region", "safer", "edge"), [
    (FENCE, FENCE.inset(0.5), 0.5),
    (Fence(0.0, 5.0, 0.0, 5.0), Fence(0.5, 4.9, 0.5, 4.0), 0.1),
    (Clearance(TERRAIN), Clearance(TERRAIN, 0.1), 0.1),
    (Separation(0.3, 0.2), Separation(0.5, 0.2), 0.2),
    (Charged(0.1), Charged(0.85), 0.75),
])  # fmt: skip
def test_edges(region: Region, safer: Region, edge: float) -> None:
    assert region.edge_margin(safer) == pytest.approx(edge)
    with pytest.raises(TypeError, match="phi_safer of"):
        region.edge_margin(FENCE if not isinstance(region, Fence) else Charged(0.5))


@given(inside, st.floats(0.0, 1.0))
def test_the_charge_pays_for_the_return_path(place: Point, charge: float) -> None:
    rule = ChargeForTheWayHome(DOCK)
    length_m = DOCK.path.length_m(*place)
    assert length_m >= math.dist(place, DOCK.place) + DETOUR_M - 1e-9
    assert rule.margin(at(place, charge)) == pytest.approx(charge - length_m * COST_PER_M)
    if DOCK.path.roomy.distance_m(*place) <= DOCK.longest_m:
        assert rule.edge_margin(Charged(0.85)) <= rule.margin(at(place, 0.85)) + 1e-9


def test_without_a_path_no_charge_is_enough() -> None:
    wall = Terrain(Workspace(5.0, 5.0, (Box(2.0, 0.0, 2.2, 5.0),), ()), TERRAIN.body_radius_m)
    rule = ChargeForTheWayHome(dock(planner(wall)))
    assert rule.margin(at((4.0, 1.0), 1.0)) == -math.inf
    assert rule.margin(at((1.0, 4.0), 1.0)) > 0.9


def test_the_path_does_not_depend_on_what_was_asked_before() -> None:
    place, beside = (3.0, 3.0), (3.0 + 1e-9, 3.0)
    asked_first = DOCK.path.length_m(*place)
    assert DOCK.path.length_m(*beside) != asked_first
    assert DOCK.path.length_m(*place) == asked_first


def test_a_charge_that_is_not_known_is_no_charge() -> None:
    for rule in (ChargeForTheWayHome(DOCK), Charged(0.5)):
        assert math.isnan(rule.margin(at((1.0, 1.0), None)))


@pytest.mark.parametrize("start", [(4.0, 0.5), (4.5, 4.5), (0.5, 4.5), (1.45, 3.3)])
def test_the_margin_does_not_fall_while_driving_home(start: Point) -> None:
    """What is used up on the way, the path gets shorter by, to within the distance from the last place looked from."""
    station = dock()
    rule, place, charge = ChargeForTheWayHome(station), start, 0.09
    station.path.track(*place)
    first = rule.margin(at(place, charge))
    for corner in station.path.legs(*place):
        for there in between(place, corner):
            station.path.track(*there)
            left = rule.margin(at(there, charge - math.dist(place, there) * COST_PER_M))
            assert left >= first - 2.0 * FROM_ANCHOR_M * COST_PER_M
        charge -= math.dist(place, corner) * COST_PER_M
        place = corner
    assert place == station.place


def test_a_robot_is_docked_on_its_station_and_charges_if_it_wants_to() -> None:
    assert DOCK.docked(at((1.19, 0.81)))
    assert not DOCK.docked(at((1.21, 1.0)))
    assert not DOCK.charging(at((1.0, 1.0)))
    DOCK.wants_charge = True
    try:
        assert DOCK.charging(at((1.0, 1.0)))
        assert not DOCK.charging(at((2.0, 1.5)))
    finally:
        DOCK.wants_charge = False


def test_a_detour_keeps_away_from_peers() -> None:
    peer = (2.5, 1.4)
    disc = (peer[0] - 0.5, peer[1] - 0.5, peer[0] + 0.5, peer[1] + 0.5)
    way = [(4.0, 0.5), *DOCK.path.around(4.0, 0.5, [disc])]
    assert way[-1] == DOCK.place
    for a, b in pairwise(way):
        for x, y in between(a, b):
            assert max(abs(x - peer[0]), abs(y - peer[1])) >= 0.5 - 1e-9
    assert DOCK.path.around(1.5, 1.0, []) == [DOCK.place]
