"""Safe controllers of the rules before the battery's let go where it has to drive, and where they cannot help."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.stack.kit import RobotPort
from soter.stack.terrain import Point, Terrain
from tests.stack.follower import CLEAR_M, FENCE_M, Controllers, Follower
from tests.stack.ground import RADIUS_M
from tests.stack.loop import STARTED_S, Loop, goto, where

Ports = Mapping[int, RobotPort]


def one_robot(width_m: float, depth_m: float, start: Point, station: Point, *boxes: Box) -> Workspace:
    x, y = station
    charger = Box(x - 0.1, y - 0.1, x + 0.1, y + 0.1)
    return Workspace(width_m, depth_m, boxes, (RobotPlace(1, *start, charger),))


CORRIDOR = one_robot(
    7.0, 3.0, (1.0, 1.5), (1.0, 1.5), Box(2.5, 1.725, 6.5, 3.0), Box(2.5, 0.0, 6.5, 1.275)
)  # fmt: skip
"""0.45 m wide: no place in it is a refuge."""

ROUND_A_CORNER = one_robot(
    5.0, 5.0, (1.0, 1.0), (1.0, 1.0),
    Box(2.0, 0.0, 5.0, 0.77), Box(2.0, 1.24, 3.5, 5.0), Box(3.97, 0.77, 5.0, 5.0),
)  # fmt: skip
"""0.47 m wide, round a corner."""

NARROW_ROOM = one_robot(5.0, 1.06, (0.6, 0.53), (0.6, 0.53))
"""Geofence and obstacle let go along its middle only."""


class Patrol:
    """An AC that goes from place to place, the last of them for ever."""

    def __init__(self, *places: Point) -> None:
        self.places = list(places)

    def __call__(self, now_s: float, ports: Ports) -> None:
        if ports[1].state is None:
            return
        if len(self.places) > 1 and math.dist(where(ports[1]), self.places[0]) < 0.05:
            self.places.pop(0)
        goto(ports[1], *self.places[0])


CASES = {
    "straight at the wall of a corridor": (CORRIDOR, Patrol((4.5, 1.5), (4.6, 3.0))),
    "standing in a corridor": (CORRIDOR, Patrol((5.5, 1.5))),
    "round a corner": (ROUND_A_CORNER, Patrol((3.735, 1.005), (3.735, 3.0), (3.735, 4.0))),
    "round a corner, at the wall": (ROUND_A_CORNER, Patrol((3.735, 1.005), (3.735, 3.0), (4.5, 3.0))),
    "a narrow room": (NARROW_ROOM, Patrol((4.2, 0.55))),
    "a station that the geofence sends robots away from": (
        one_robot(5.0, 5.0, (1.0, 1.0), (4.9, 4.9)), Patrol((1.0, 4.0)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_robot_whose_charge_runs_low_gets_home_from_under_every_module(case: str) -> None:
    workspace, ac = CASES[case]
    made = Loop(ac, (0.6,), workspace, battery__drive_s=300.0, battery__idle_s=300.0)
    made.run(STARTED_S)
    away_m = 0.0
    while not made.in_sc(1, "battery"):
        made.run(1.0)
        assert made.charge(1) > 0.0
        away_m = max(away_m, math.dist(where(made.ports[1]), workspace.robots[0].charger.centre))
    made.until_charged(150.0)
    assert made.run(1.0).violations == ()
    assert away_m > 1.5, "it was where it is hard to get home from"


def test_a_robot_in_a_narrow_place_with_no_refuge_in_sight_gets_to_one_by_its_return_path() -> None:
    boxes = (Box(2.5, 1.69, 11.5, 3.0), Box(2.5, 0.0, 11.5, 1.31))
    terrain = Terrain(Workspace(12.0, 3.0, boxes, ()), RADIUS_M)
    made = Controllers(terrain, station=Box(0.8, 1.3, 1.2, 1.7))
    robot = Follower(made, made.retreat, (11.0, 1.52))
    assert made.refuges.way(robot.look(), 0.5) == []
    robot.run(60.0)
    assert terrain.clearance_m(*robot.place) >= CLEAR_M - 0.03
    assert terrain.fence_m(*robot.place) >= FENCE_M - 0.03
    assert robot.home_m() > 0.3, "there it stays: home is nothing that it was asked for"


def test_a_robot_that_must_charge_is_driven_home_by_whichever_module_has_it() -> None:
    made = Controllers()
    robot = Follower(made, made.retreat, (4.9, 2.5))
    made.dock.wants_charge = True
    robot.run(20.0)
    assert robot.home_m() < 0.03
