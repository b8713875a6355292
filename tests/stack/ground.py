"""Workspaces, situations and geometry by brute force, for the tests of the stack."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hypothesis import strategies as st

from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.rta import Sample, Situation
from soter.stack.battery import Dock
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.return_path import ReturnPath
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.sdk.fake import CAPABILITIES

RADIUS_M = 0.105
TICK_S = 0.05

CASE = Workspace(
    5.0,
    5.0,
    (Box(2.0, 0.0, 3.0, 1.0), Box(2.0, 3.0, 3.0, 4.0), Box(1.0, 2.0, 1.9, 3.0)),
    (
        RobotPlace(1, 1.0, 1.0, Box(0.8, 0.8, 1.2, 1.2)),
        RobotPlace(2, 2.5, 2.0, Box(2.3, 1.8, 2.7, 2.2)),
    ),
)
TERRAIN = Terrain(CASE, RADIUS_M)
EMPTY = Terrain(Workspace(5.0, 5.0, (), ()), RADIUS_M)

COST_PER_M = 0.0025

inside = st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0))


def boxes(count: int = 4) -> st.SearchStrategy[tuple[Box, ...]]:
    """Boxes in a room of 5 x 5 m, overlapping as they like."""
    box = st.tuples(st.floats(0.0, 4.5), st.floats(0.0, 4.5), st.floats(0.05, 1.5), st.floats(0.05, 1.5))
    return st.lists(box.map(lambda b: Box(b[0], b[1], b[0] + b[2], b[1] + b[3])), max_size=count).map(tuple)


def planner(terrain: Terrain = TERRAIN, rules: RecoveryRules | None = None) -> RecoveryPlanner:
    return RecoveryPlanner(terrain, CAPABILITIES, rules or RecoveryRules(), TICK_S)


def dock(
    recovery: RecoveryPlanner | None = None,
    station: Box = CASE.robots[0].charger,
    occupied: Sequence[Rectangle] = (),
    clearance_m: float = 0.15,
    inset_m: float = 0.25,
) -> Dock:
    """A robot's station and its return path, which the test has to track."""
    recovery = recovery or planner()
    path = ReturnPath(recovery.terrain, recovery, station.centre, clearance_m, inset_m, occupied)
    return Dock(station, path, COST_PER_M)


def seen(own: Sample, peers: Sequence[Sample] = (), now_s: float = 0.0) -> Situation:
    """What one robot sees at a time."""
    made = Situation(own.robot_id, own, now_s)
    made.peers = [peer for peer in peers if peer is not own]
    return made


def robots(places: Sequence[Point], stamp_s: float = 0.0) -> list[At]:
    return [At(x, y, stamp_s, number) for number, (x, y) in enumerate(places, start=1)]


def between(a: Point, b: Point, count: int = 200) -> list[Point]:
    """Points along a segment, its ends included."""
    return [(a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count) for k in range(count + 1)]


def to_box_m(box: Box, x: float, y: float) -> float:
    """Distance from a point to a box; 0 inside."""
    return math.hypot(max(box.low_x_m - x, x - box.high_x_m, 0.0), max(box.low_y_m - y, y - box.high_y_m, 0.0))


def clear_m(terrain: Terrain, x: float, y: float) -> float:
    """Distance of a body to the nearest box; at least minus its radius."""
    return min((to_box_m(box, x, y) for box in terrain.boxes), default=math.inf) - RADIUS_M


def fence_m(x: float, y: float) -> float:
    return min(x, 5.0 - x, y, 5.0 - y)
