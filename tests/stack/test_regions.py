"""The four rules: their margins against brute force, and that what is unknown is never safe."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import Region, Situation
from soter.stack.battery import COMFORT, Charged, ChargeForTheWayHome, Dock
from soter.stack.collision import Separation
from soter.stack.geofence import Fence
from soter.stack.obstacle import Clearance
from soter.stack.terrain import Point
from soter.workspace import Box
from tests.rta.doubles import At
from tests.stack.ground import TERRAIN, clear_m, fence_m, inside, seen

anywhere = st.tuples(st.floats(-1.0, 6.0), st.floats(-1.0, 6.0))
FENCE = Fence(0.0, 5.0, 0.0, 5.0)
COST_PER_M = 0.0025
DOCK = Dock(TERRAIN, Box(0.8, 0.8, 1.2, 1.2), 0.15, 0.5, COST_PER_M)


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


@given(inside, st.floats(0.0, 1.0), st.floats(0.0, 0.3))
def test_the_charge_pays_for_the_way_home_and_the_reserve(place: Point, charge: float, reserve: float) -> None:
    rule = ChargeForTheWayHome(DOCK, reserve)
    margin = rule.margin(at(place, charge))
    exact = charge - DOCK.home_m(*place) * COST_PER_M - reserve
    least = charge - DOCK.longest_m * COST_PER_M - reserve
    assert DOCK.home_m(*place) >= math.dist(place, DOCK.place) - 2e-4, "to a tenth of a millimetre"
    if DOCK.home_m(*place) <= DOCK.longest_m:
        # Where there is plenty, the longest way home is taken for every way.
        assert margin == pytest.approx(least if least >= COMFORT else exact)
        assert margin <= exact + 1e-6
        assert rule.edge_margin(Charged(0.85)) <= rule.margin(at(place, 0.85)) + 1e-9


def test_a_charge_that_is_not_known_is_no_charge() -> None:
    for rule in (ChargeForTheWayHome(DOCK, 0.0), Charged(0.5)):
        assert math.isnan(rule.margin(at((1.0, 1.0), None)))


def test_the_margin_does_not_fall_while_driving_home() -> None:
    """What is used up on the way, the way gets shorter by."""
    rule = ChargeForTheWayHome(DOCK, 0.05)
    assert rule.margin(at((1.0, 1.0), 0.09)) < COMFORT
    place, charge = (4.0, 0.5), 0.09
    margins = []
    for corner in DOCK.way(*place):
        steps = max(1, round(math.dist(place, corner) / 0.05))
        for step in range(1, steps + 1):
            there = (
                place[0] + (corner[0] - place[0]) * step / steps,
                place[1] + (corner[1] - place[1]) * step / steps,
            )
            used = math.dist(place, corner) * step / steps * COST_PER_M
            margins.append(rule.margin(at(there, charge - used)))
        charge -= math.dist(place, corner) * COST_PER_M
        place = corner
    assert place == DOCK.place
    assert min(margins) == pytest.approx(max(margins), abs=1e-6)


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


def test_a_detour_keeps_away_from_peers_but_not_from_one_on_the_station() -> None:
    peer = (2.5, 1.4)
    way = [(4.0, 0.5), *DOCK.detour(4.0, 0.5, [peer])]
    assert way[-1] == DOCK.place
    for a, b in pairwise(way):
        for k in range(101):
            x, y = a[0] + (b[0] - a[0]) * k / 100, a[1] + (b[1] - a[1]) * k / 100
            assert max(abs(x - peer[0]), abs(y - peer[1])) >= 0.5 - 1e-9
    assert DOCK.detour(1.5, 1.0, [(1.0, 1.1)]) == [DOCK.place]
