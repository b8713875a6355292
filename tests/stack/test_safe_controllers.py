"""Safe controllers publish certified legs or a hold, and refuges are what they are called."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.stack.battery import BLOCKED_S
from soter.stack.collision import RETREAT_M
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.stack.follower import CLEAR_M, FENCE_M, PEER_M, Controllers, Follower, Says
from tests.stack.ground import RADIUS_M, TERRAIN, clear_m, fence_m, inside, planner, seen


@settings(max_examples=60)
@given(inside, st.lists(inside, max_size=3), st.floats(-math.pi, math.pi))
def test_a_refuge_is_safer_for_every_static_rule_and_far_from_peers(
    place: Point, others: list[Point], heading: float
) -> None:
    assume(clear_m(TERRAIN, *place) >= 0.0)
    peers = [At(*other, robot_id=number) for number, other in enumerate(others, start=2)]
    way = Controllers().refuges.way(seen(At(*place, heading_rad=heading), peers), PEER_M)
    if not way:
        return
    x, y = way[-1]
    assert fence_m(x, y) >= FENCE_M - 1e-9
    assert clear_m(TERRAIN, x, y) >= CLEAR_M - 1e-9
    assert all(math.dist((x, y), other) >= PEER_M - 1e-9 for other in others)


@pytest.mark.parametrize("place", [(0.1, 2.5), (4.95, 4.95), (0.05, 0.05), (3.2, 2.0), (2.5, 2.0), (1.45, 3.2)])
def test_a_robot_that_retreats_gets_to_a_refuge_and_holds_there(place: Point) -> None:
    made = Controllers()
    robot = Follower(made, made.retreat, place, (2.5, 2.6))
    robot.run(60.0)
    assert fence_m(*robot.place) >= FENCE_M - 0.05
    assert clear_m(TERRAIN, *robot.place) >= CLEAR_M - 0.05
    assert math.dist(robot.place, (2.5, 2.6)) >= PEER_M - 0.05
    before = robot.place
    robot.published = 0
    robot.run(5.0)
    assert math.dist(robot.place, before) < 0.05
    assert robot.published <= 3, "a hold is published once, not every tick"


def test_a_refuge_that_a_peer_comes_near_is_left() -> None:
    made = Controllers()
    robot = Follower(made, made.retreat, (3.8, 2.0), (0.6, 0.6))
    robot.run(5.0)
    robot.peers = ((robot.place[0] + 0.32, robot.place[1]),)
    robot.run(20.0)
    assert math.dist(robot.place, robot.peers[0]) >= PEER_M - 0.05


def test_engaging_forgets_and_publishes_a_hold_anew() -> None:
    made = Controllers()
    robot = Follower(made, made.retreat, (3.8, 2.0))
    robot.run(10.0)
    count = made.out.count
    robot.step()
    assert made.out.count == count
    made.retreat.engage(robot.look())
    robot.run(2.0)
    assert made.out.count > count


@pytest.mark.parametrize("first", [True, False])
def test_the_first_in_the_order_holds_and_the_others_back_away(first: bool) -> None:
    made = Controllers()
    robot = Follower(made, made.back_away(Says(first)), (3.8, 2.0), (4.2, 2.0))
    robot.run(20.0)
    if first:
        assert robot.place == (3.8, 2.0)
        assert (made.out.count, made.out.value) == (1, None)
    else:
        assert math.dist(robot.place, (4.2, 2.0)) >= RETREAT_M - 0.05


def test_a_robot_that_charges_holds_whatever_the_order() -> None:
    made = Controllers()
    made.dock.wants_charge = True
    robot = Follower(made, made.back_away(Says(False)), (1.0, 1.0), (1.4, 1.0))
    robot.run(5.0)
    assert robot.place == (1.0, 1.0)


def test_a_robot_that_is_surrounded_stays_apart_from_all() -> None:
    made = Controllers()
    ring = [(3.8 + 0.33 * math.cos(k * math.pi / 3), 2.0 + 0.33 * math.sin(k * math.pi / 3)) for k in range(6)]
    robot = Follower(made, made.back_away(Says(False)), (3.8, 2.0), *ring)
    robot.run(20.0)
    assert min(math.dist(robot.place, peer) for peer in ring) >= 0.3


def test_a_robot_whose_way_home_is_blocked_too_tries_again_to_get_away() -> None:
    made = Controllers(fence_m=9.0)
    towards_home, *others = [
        (3.8 + 0.33 * x, 2.0 + 0.33 * y) for x, y in ((-0.94, -0.34), (1, 0), (0, 1), (0, -1), (-0.7, 0.7))
    ]
    robot = Follower(made, made.back_away(Says(False)), (3.8, 2.0), towards_home, *others)
    robot.run(20.0)
    assert math.dist(robot.place, (3.8, 2.0)) < 0.1
    robot.peers = (towards_home,)
    robot.run(20.0)
    assert math.dist(robot.place, towards_home) > 0.5


def test_a_robot_does_not_flee_into_a_gap_that_no_path_leads_out_of() -> None:
    half_m = RADIUS_M + planner().path_m - 0.015
    boxes = (Box(2.0, 0.0, 2.6, 2.0 - half_m), Box(2.0, 2.0 + half_m, 2.6, 4.0))
    made = Controllers(Terrain(Workspace(6.0, 4.0, boxes, ()), RADIUS_M), station=Box(4.8, 1.8, 5.2, 2.2), fence_m=9.0)
    path = made.dock.path
    assert path.leads_back(2.9, 2.0)
    assert not path.leads_back(2.3, 2.0)
    robot = Follower(made, made.back_away(Says(False)), (2.9, 2.0), (3.25, 2.0))
    for _ in range(100):
        robot.run(0.2)
        assert path.leads_back(*robot.place)


@pytest.mark.parametrize("place", [(4.5, 0.5), (4.5, 4.5), (0.5, 4.5), (1.45, 3.3), (0.05, 2.5), (2.5, 1.2)])
def test_home_is_found_from_anywhere(place: Point) -> None:
    made = Controllers()
    robot = Follower(made, made.home, place)
    robot.run(60.0)
    assert robot.home_m() < 0.04
    robot.published = 0
    robot.run(5.0)
    assert robot.published <= 1


def test_the_static_way_home_is_kept_until_it_has_been_blocked_for_long() -> None:
    made = Controllers()
    # In the passage between two boxes, on the very way home.
    robot = Follower(made, made.home, (4.0, 1.5), (2.5, 1.4))
    robot.run(BLOCKED_S - 1.0)
    stuck = robot.place
    assert math.dist(stuck, (2.5, 1.4)) < 0.6, "it waits before the peer"
    robot.run(60.0)
    assert robot.home_m() < 0.04, "then it goes around"


def test_a_robot_that_is_driven_back_again_and_again_is_blocked_too() -> None:
    made = Controllers()
    robot = Follower(made, made.home, (4.0, 1.5), (2.5, 1.4))
    robot.run(5.0)
    waits = robot.place
    for _ in range(20):
        # Another safe controller backs away for a moment.
        robot.place = (waits[0] + 0.3, waits[1])
        made.home.engage(robot.look())
        robot.run(2.0)
        if math.dist(robot.place, waits) > 0.5:
            break
    else:
        pytest.fail(f"it still waits at {robot.place}")
    robot.run(60.0)
    assert robot.home_m() < 0.04


@pytest.mark.parametrize("held", [False, True])
def test_the_first_robot_holds_unless_another_has_waited_long_for_it_to_get_away(held: bool) -> None:
    made = Controllers()
    robot = Follower(made, made.back_away(Says(True, held)), (3.8, 2.0), (3.8, 2.6))
    robot.run(20.0)
    assert (math.dist(robot.place, (3.8, 2.6)) >= RETREAT_M) is held
