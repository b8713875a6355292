"""The protected planner: whose paths are used, and that those of the safe side keep their clearance."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.errors import IllFormedModule
from soter.geometry.workspace import Box, Workspace
from soter.rta import Situation
from soter.sdk import Controller
from soter.stack.path_guard import PathClearance, PathGuard, PathSituation, StandsStill
from soter.stack.planners import PlanRequest, PlanResult
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import Above, At
from tests.sim.worlds import CASE

RADIUS_M = 0.105
SAFE_M, SAFER_M, CERTIFIED_M = 0.06, 0.1, 0.15
TERRAIN = Terrain(CASE, RADIUS_M)
START, GOAL = (1.0, 1.0), (4.0, 1.5)
CLEAR = ((1.5, 1.5), (4.0, 1.5))
THROUGH = ((4.0, 0.5), (4.0, 1.5))
"""Through the box from (2, 0) to (3, 1)."""


def guard(**values: float) -> PathGuard:
    given = {"delta_s": 0.05, "phi_safe_m": SAFE_M, "phi_safer_m": SAFER_M, "clearance_m": CERTIFIED_M}
    return PathGuard(TERRAIN, **{**given, **values})


def request(start: Point = START, goal: Point = GOAL, number: int = 1) -> PlanRequest:
    return PlanRequest(number, 1, start, goal)


def judged(
    made: PathGuard, path: tuple[Point, ...], asked: PlanRequest | None = None, now_s: float = 0.0
) -> PlanResult:
    asked = asked or request()
    return made.judge(At(*asked.start, stamp_s=now_s), now_s, asked, PlanResult(asked.request_id, path, 7, None, True))


def mode(made: PathGuard) -> Controller:
    return made.mode


def least_m(start: Point, path: tuple[Point, ...]) -> float:
    return min(TERRAIN.segment_clearance_m(*a, *b) for a, b in pairwise([start, *path]))


def test_a_path_that_keeps_its_clearance_is_used_as_it_is() -> None:
    made = guard()
    result = judged(made, CLEAR)
    assert result.path == CLEAR
    assert (mode(made), made.replaced) == (Controller.AC, 0)


def test_a_path_through_a_box_is_replaced_by_a_certified_way() -> None:
    made = guard()
    judged(made, CLEAR)
    result = judged(made, THROUGH)
    assert result.ok
    assert result.path[-1] == GOAL
    assert least_m(START, result.path) >= CERTIFIED_M - 1e-9
    assert (result.request_id, result.checks, result.reaches_goal) == (1, 7, True)
    assert (mode(made), made.replaced) == (Controller.SC, 1)


def test_the_planner_is_trusted_again_once_it_keeps_more_than_it_must() -> None:
    made = guard()
    judged(made, CLEAR)
    judged(made, THROUGH)
    assert mode(made) is Controller.SC
    # Past the corner (3, 1): enough for phi_safe, not for phi_safer.
    corner = RADIUS_M + 0.5 * (SAFE_M + SAFER_M)
    scraping = ((1.5, 1.5), (2.0, 1.0 + corner), (3.0, 1.0 + corner), (4.0, 1.5))
    assert SAFE_M < least_m(START, scraping) < SAFER_M
    assert judged(made, scraping).path != scraping
    assert mode(made) is Controller.SC
    assert judged(made, CLEAR).path == CLEAR
    assert mode(made) is Controller.AC
    assert judged(made, scraping).path == scraping, "while it is trusted phi_safe is enough"
    assert made.replaced == 2


def test_a_plan_that_failed_is_replaced() -> None:
    made = guard()
    asked = request()
    result = made.judge(At(*START), 0.0, asked, PlanResult.failed(1, "it gave up", 3))
    assert result.ok
    assert result.path[-1] == GOAL


def test_a_path_whose_first_leg_from_the_robot_is_blocked_is_replaced() -> None:
    made = guard()
    start, goal = (1.5, 1.5), (1.5, 3.5)
    straight = (goal,)
    result = judged(made, straight, request(start, goal))
    assert result.path != straight
    assert least_m(start, result.path) >= CERTIFIED_M - 1e-9


def test_a_start_near_a_box_asks_no_more_than_that_the_path_is_no_nearer() -> None:
    made = guard()
    start = (1.0, 2.0 - RADIUS_M - 0.02)
    away = ((1.0, 1.0),)
    assert judged(made, away, request(start, away[0])).path == away
    along = ((1.5, start[1] + 0.01), (1.5, 1.0))
    assert judged(made, along, request(start, along[-1])).path != along


def test_a_goal_on_which_no_body_can_stand_becomes_the_nearest_place() -> None:
    made = guard()
    goal = (2.5, 0.9)
    result = judged(made, (goal,), request(goal=goal))
    assert result.ok
    assert not result.reaches_goal
    end = result.path[-1]
    assert TERRAIN.clearance_m(*end) >= CERTIFIED_M
    assert math.dist(end, goal) <= 0.1 + RADIUS_M + CERTIFIED_M + 0.1


def test_where_there_is_no_certified_way_the_plan_has_failed() -> None:
    walls = (Box(2, 2, 4, 2.2), Box(2, 3.8, 4, 4), Box(2, 2, 2.2, 4), Box(3.8, 2, 4, 4))
    made = PathGuard(Terrain(Workspace(5.0, 5.0, walls, ()), RADIUS_M), 0.05, SAFE_M, SAFER_M, CERTIFIED_M)
    goal = (3.0, 3.0)
    result = judged(made, (goal,), request(goal=goal))
    assert not result.ok
    assert result.reason == "there is no certified way"
    assert result.path == ()


@given(
    path=st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)), min_size=1, max_size=6),
    start=st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)).filter(
        lambda at: TERRAIN.clearance_m(*at) >= CERTIFIED_M
    ),
    goal=st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)),
)
def test_whatever_is_offered_what_is_used_keeps_phi_safe(path: list[Point], start: Point, goal: Point) -> None:
    made = guard()
    result = judged(made, tuple(path), request(start, goal))
    if result.ok:
        assert least_m(start, result.path) >= SAFE_M - 1e-9
    else:
        assert mode(made) is Controller.SC


@pytest.mark.parametrize("path", [((math.nan, 1.0),), ((1.5, 1.5), (math.inf, 1.0)), ()])
def test_a_path_that_is_none_is_replaced(path: tuple[Point, ...]) -> None:
    made = guard()
    judged(made, CLEAR)
    result = judged(made, path)
    assert mode(made) is Controller.SC
    assert all(math.isfinite(x + y) for x, y in result.path)
    assert result.path


def test_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(IllFormedModule, match="path"):
        guard(phi_safer_m=SAFE_M - 0.01)


def test_nothing_else_is_judged() -> None:
    clearance = PathClearance(TERRAIN, SAFE_M)
    assert clearance.margin(Situation(1, At(), 0.0)) == -math.inf
    with pytest.raises(TypeError, match="phi_safer of a path's clearance has to be one too"):
        clearance.edge_margin(Above())
    made = guard()
    for node in (made.module.ac, made.module.sc):
        node.step(Situation(1, At(), 0.0))
    assert made.replaced == 0


def test_a_path_stands_still() -> None:
    assert StandsStill().bound(1e9) == 0.0
    assert StandsStill().admits(At(), At(100.0), 0.0)
    situation = PathSituation(1, At(), 0.0, request(), PlanResult(1, CLEAR, 0, None, True))
    assert PathClearance(TERRAIN, 0.0).margin(situation) > 0.0
