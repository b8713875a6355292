"""The AC is stopped where its robot can still drive away from fence and boxes, wherever it has been taken by then."""

from __future__ import annotations

import math

from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.static_rules import Clearance
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.stack.ground import RADIUS_M, boxes, inside, planner, seen

LEG_M = 0.02
DIRECTIONS = [(math.cos(k * math.pi / 24), math.sin(k * math.pi / 24)) for k in range(48)]


def open_m(recovery: RecoveryPlanner, x_m: float, y_m: float) -> float:
    """Return how far a place is from whatever is nearest, fence or box."""
    terrain = recovery.terrain
    fence_m = terrain.fence_m(x_m, y_m) if recovery.rules.fence else math.inf
    return min(fence_m, terrain.clearance_m(x_m, y_m))


def drives_away(recovery: RecoveryPlanner, start: Point) -> bool:
    """Whether short certified legs lead from a place to where paths are: climbing steeply, whichever way that is."""
    x, y = start
    for _ in range(40):
        best_m = open_m(recovery, x, y)
        if best_m >= recovery.path_m - 1e-6:
            return True
        best = None
        for ux, uy in DIRECTIONS:
            there = (x + LEG_M * ux, y + LEG_M * uy)
            if open_m(recovery, *there) > best_m + 1e-6 and recovery.certify(seen(At(x, y)), *there) >= 0.0:
                best_m, best = open_m(recovery, *there), there
        if best is None:
            return False
        x, y = best
    return False


@settings(max_examples=150)
@given(boxes(), inside, st.floats(0.0, 0.2), st.booleans(), st.integers(0, 47))
@example((Box(2.0, 2.0, 3.0, 3.0),), (1.8, 2.5), 0.05, True, 0)
@example((Box(2.0, 2.0, 3.0, 3.0), Box(1.0, 2.0, 1.6, 3.0)), (1.8, 2.5), 0.02, True, 0)
@example((Box(2.0, 2.0, 3.0, 3.0), Box(1.0, 2.0, 1.7, 3.0)), (1.85, 2.5), 0.02, True, 0)
@example((Box(1.0, 0.2, 4.0, 1.0),), (2.5, 0.03), 0.0, True, 12)
def test_from_wherever_a_robot_has_been_stopped_it_can_drive_away(
    some: tuple[Box, ...], at: Point, fall_m: float, fenced: bool, towards: int
) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    recovery = planner(terrain, RecoveryRules(fence=fenced))
    rule = Clearance(terrain, 0.0, recovery.path_m, fenced)
    look = seen(At(*at))
    margin = rule.margin(look)
    assume(margin >= fall_m)
    assume(rule.leaves_room(look, margin, recovery.path_m, fall_m))
    # Where the fall takes it: all around, and straight at whatever is nearest.
    ways = [DIRECTIONS[towards], *((ux, uy) for _, ux, uy in sorted(terrain.walls(*at))[:2])]
    for ux, uy in ways:
        for part in (0.5, 1.0):
            stopped = (at[0] + part * fall_m * ux, at[1] + part * fall_m * uy)
            # The geofence has a rule of its own: its module stops the robot inside.
            if terrain.clearance_m(*stopped) >= 0.0 and (not fenced or terrain.fence_m(*stopped) >= 0.0):
                assert drives_away(recovery, stopped), (stopped, open_m(recovery, *stopped))


def test_between_two_boxes_there_has_to_be_room_for_the_path_as_well() -> None:
    recovery = planner(Terrain(Workspace(5.0, 5.0, (Box(2.0, 2.0, 3.0, 3.0), Box(1.0, 2.0, 1.7, 3.0)), ()), RADIUS_M))
    rule = Clearance(recovery.terrain, 0.0, recovery.path_m, True)
    look = seen(At(1.85, 2.5))
    assert not rule.leaves_room(look, rule.margin(look), recovery.path_m, 0.0)
    # The same clearance from one box, with nothing behind the robot.
    look = seen(At(3.15, 2.5))
    assert rule.leaves_room(look, rule.margin(look), recovery.path_m, 0.0)


def test_between_a_box_and_the_fence_there_has_to_be_room_for_the_body_inside() -> None:
    recovery = planner(Terrain(Workspace(5.0, 5.0, (Box(1.0, 0.2, 4.0, 1.0),), ()), RADIUS_M))
    for fenced, room in ((True, False), (False, True)):
        rule = Clearance(recovery.terrain, 0.0, recovery.path_m, fenced)
        look = seen(At(2.5, -0.02) if not fenced else At(2.5, 0.03))
        assert rule.leaves_room(look, rule.margin(look), recovery.path_m, 0.0) is room
