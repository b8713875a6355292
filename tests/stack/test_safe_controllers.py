"""Safe controllers publish certified legs or a hold, and refuges are what they are called."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soter.rta import Topic
from soter.sdk import Waypoint
from soter.stack.battery import BLOCKED_S, Dock, GoHome
from soter.stack.collision import RETREAT_M, BackAway
from soter.stack.refuge import RefugeFinder
from soter.stack.right_of_way import RightOfWay
from soter.stack.safe_controller import Retreat, SafeController
from soter.stack.terrain import Point
from soter.workspace import Box
from tests.rta.doubles import At
from tests.stack.ground import TERRAIN, TICK_S, clear_m, fence_m, inside, planner, seen

FENCE_M, CLEAR_M, PEER_M = 0.52, 0.12, 0.5


def finder() -> RefugeFinder:
    return RefugeFinder(TERRAIN, planner(), FENCE_M, CLEAR_M)


def topic() -> Topic[Any]:
    return Topic("waypoint")


def dock() -> Dock:
    return Dock(TERRAIN, Box(0.8, 0.8, 1.2, 1.2), 0.15, 0.5, 0.0025)


class Follower:
    """A robot that goes to the end of every leg at once, driven by one safe controller, with peers that stand."""

    def __init__(self, controller: SafeController, out: Topic[Any], place: Point, *peers: Point) -> None:
        self.controller = controller
        self.out = out
        self.place = place
        self.peers = peers
        self.now_s = 0.0
        self.published = 0
        controller.engage(self.look())

    def look(self) -> Any:
        peers = [At(*place, self.now_s, number) for number, place in enumerate(self.peers, start=2)]
        return seen(At(*self.place, self.now_s, 1), peers, self.now_s)

    def step(self) -> Waypoint | None:
        count = self.out.count
        self.controller.step(self.look())
        self.now_s += TICK_S
        self.published += self.out.count - count
        leg: Waypoint | None = self.out.value if self.out.count > count else None
        if leg is not None:
            assert self.controller.recovery.certify(self.look(), leg.x_m, leg.y_m) >= 0.0
            self.place = (leg.x_m, leg.y_m)
        return leg

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.step()


@settings(max_examples=60)
@given(inside, st.lists(inside, max_size=3), st.floats(-math.pi, math.pi))
def test_a_refuge_is_safer_for_every_static_rule_and_far_from_peers(
    place: Point, others: list[Point], heading: float
) -> None:
    assume(clear_m(TERRAIN, *place) >= 0.0)
    peers = [At(*other, robot_id=number) for number, other in enumerate(others, start=2)]
    way = finder().way(seen(At(*place, heading_rad=heading), peers), PEER_M)
    if not way:
        return
    x, y = way[-1]
    assert fence_m(x, y) >= FENCE_M - 1e-9
    assert clear_m(TERRAIN, x, y) >= CLEAR_M - 1e-9
    assert all(math.dist((x, y), other) >= PEER_M - 1e-9 for other in others)


@pytest.mark.parametrize("place", [(0.1, 2.5), (4.95, 4.95), (0.05, 0.05), (3.2, 2.0), (2.5, 2.0), (1.45, 3.2)])
def test_a_robot_that_retreats_gets_to_a_refuge_and_holds_there(place: Point) -> None:
    out = topic()
    retreat = Retreat("retreat", TICK_S, out, planner(), finder(), PEER_M)
    robot = Follower(retreat, out, place, (2.5, 2.6))
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
    out = topic()
    robot = Follower(Retreat("retreat", TICK_S, out, planner(), finder(), PEER_M), out, (3.8, 2.0), (0.6, 0.6))
    robot.run(5.0)
    robot.peers = ((robot.place[0] + 0.32, robot.place[1]),)
    robot.run(20.0)
    assert math.dist(robot.place, robot.peers[0]) >= PEER_M - 0.05


def test_engaging_forgets_and_publishes_a_hold_anew() -> None:
    out = topic()
    retreat = Retreat("retreat", TICK_S, out, planner(), finder(), PEER_M)
    robot = Follower(retreat, out, (3.8, 2.0))
    robot.run(10.0)
    count = out.count
    robot.step()
    assert out.count == count
    retreat.engage(robot.look())
    robot.run(2.0)
    assert out.count > count


class Says(RightOfWay):
    """An order that the test sets."""

    def __init__(self, first: bool) -> None:
        super().__init__()
        self.answer = first

    def first(self, robot_id: int) -> bool:
        return self.answer


@pytest.mark.parametrize("first", [True, False])
def test_the_first_in_the_order_holds_and_the_others_back_away(first: bool) -> None:
    out = topic()
    controller = BackAway(TICK_S, out, planner(), finder(), Says(first), dock())
    robot = Follower(controller, out, (3.8, 2.0), (4.2, 2.0))
    robot.run(20.0)
    if first:
        assert robot.place == (3.8, 2.0)
        assert (out.count, out.value) == (1, None)
    else:
        assert math.dist(robot.place, (4.2, 2.0)) >= RETREAT_M - 0.05


def test_a_robot_that_charges_holds_whatever_the_order() -> None:
    out = topic()
    station = dock()
    station.wants_charge = True
    robot = Follower(BackAway(TICK_S, out, planner(), finder(), Says(False), station), out, (1.0, 1.0), (1.4, 1.0))
    robot.run(5.0)
    assert robot.place == (1.0, 1.0)


def test_a_robot_that_is_surrounded_stays_apart_from_all() -> None:
    out = topic()
    ring = [(3.8 + 0.33 * math.cos(k * math.pi / 3), 2.0 + 0.33 * math.sin(k * math.pi / 3)) for k in range(6)]
    robot = Follower(BackAway(TICK_S, out, planner(), finder(), Says(False), dock()), out, (3.8, 2.0), *ring)
    robot.run(20.0)
    assert min(math.dist(robot.place, peer) for peer in ring) >= 0.3


@pytest.mark.parametrize("place", [(4.5, 0.5), (4.5, 4.5), (0.5, 4.5), (1.45, 3.3), (0.05, 2.5), (2.5, 1.2)])
def test_home_is_found_from_anywhere(place: Point) -> None:
    out = topic()
    robot = Follower(GoHome(TICK_S, out, planner(), dock()), out, place)
    robot.run(60.0)
    assert math.dist(robot.place, (1.0, 1.0)) < 0.04
    robot.published = 0
    robot.run(5.0)
    assert robot.published <= 1


def test_the_static_way_home_is_kept_until_it_has_been_blocked_for_long() -> None:
    out = topic()
    controller = GoHome(TICK_S, out, planner(), dock())
    # In the passage between two boxes, on the very way home.
    robot = Follower(controller, out, (4.0, 1.5), (2.5, 1.4))
    robot.run(BLOCKED_S - 1.0)
    stuck = robot.place
    assert math.dist(stuck, (2.5, 1.4)) < 0.6, "it waits before the peer"
    robot.run(60.0)
    assert math.dist(robot.place, (1.0, 1.0)) < 0.04, "then it goes around"
