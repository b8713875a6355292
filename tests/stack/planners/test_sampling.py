"""OMPL's planners: paths that keep clear and depend on the request alone."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soter.errors import ConfigError
from soter.geometry.workspace import Box, Workspace
from soter.stack.planners import Planner, PlannerSpec, PlanRequest, PlanResult
from soter.stack.planners.base import Point
from tests.stack.planners.places import CASE, RADIUS_M, along, depth_m, length_m

pytestmark = pytest.mark.ompl

NAMES = ("ompl-bitstar", "ompl-rrtstar", "ompl-rrtconnect")

TOLERANCE_M = 1e-6

places = st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0))


def plan(planner: Planner, number: int, start: Point, goal: Point, *discs: tuple[float, float, float]) -> PlanResult:
    return planner.plan(PlanRequest(number, 1, start, goal, discs, seed=7))


@pytest.fixture(scope="module", params=NAMES)
def planner(request: pytest.FixtureRequest) -> Planner:
    return PlannerSpec(request.param, CASE, RADIUS_M).build()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(start=places, goal=places, number=st.integers(0, 10**9))
def test_path_keeps_clear_and_ends_at_the_goal(planner: Planner, start: Point, goal: Point, number: int) -> None:
    assume(depth_m(*start) < 0.0)
    assume(depth_m(*goal) < 0.0)
    result = plan(planner, number, start, goal)
    assert result.ok, result.reason
    assert result.path[-1] == goal
    assert result.reaches_goal
    assert max(depth_m(*point) for point in along((start, *result.path))) < TOLERANCE_M
    assert all(a != b for a, b in pairwise(result.path))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(start=places, goal=places, peer=places)
def test_path_keeps_clear_of_discs(planner: Planner, start: Point, goal: Point, peer: Point) -> None:
    assume(max(depth_m(*start), depth_m(*goal)) < 0.0)
    assume(min(math.dist(start, peer), math.dist(goal, peer)) > 0.6)
    result = plan(planner, 1, start, goal, (*peer, 0.6))
    if result.ok:  # a robot may well block the way
        assert result.path[-1] == goal
        assert min(math.dist(point, peer) for point in along((start, *result.path))) > 0.6 - TOLERANCE_M


@pytest.mark.parametrize(
    ("start", "goal", "shortest_m"),
    [((0.5, 0.5), (4.5, 0.5), 4.39), ((0.5, 2.5), (4.5, 4.5), 4.86), ((1.0, 1.0), (1.0, 4.0), 3.03)],
)
def test_optimising_planner_comes_near_the_shortest_path(start: Point, goal: Point, shortest_m: float) -> None:
    planner = PlannerSpec("ompl-bitstar", CASE, RADIUS_M).build()
    for number in range(5):
        found = length_m((start, *plan(planner, number, start, goal).path))
        assert shortest_m - 0.05 < found < shortest_m * 1.15


def test_free_straight_line_is_the_plan(planner: Planner) -> None:
    result = plan(planner, 1, (0.5, 0.5), (0.5, 4.5))
    assert (result.path, result.checks) == (((0.5, 4.5),), 3)
    assert plan(planner, 1, (0.5, 0.5), (0.5, 0.5)).path == ((0.5, 0.5),)


@pytest.mark.parametrize(
    ("goal", "last_free"),
    [
        ((5.8, 2.5), (5.0, 2.5)),
        ((-1.0, -1.0), (0.0, 0.0)),
        ((2.5, 0.7), (2.5, 1.255)),
        ((2.9, 3.5), (3.255, 3.5)),
        ((2.4, -0.5), (1.745, 0.0)),
    ],
)
def test_goal_that_is_not_free_gets_a_straight_last_leg(planner: Planner, goal: Point, last_free: Point) -> None:
    result = plan(planner, 1, (0.5, 1.0), goal)
    assert result.reaches_goal
    assert result.path[-1] == goal
    assert len(result.path) >= 2
    assert result.path[-2] == pytest.approx(last_free)
    assert max(depth_m(*point) for point in along(((0.5, 1.0), *result.path[:-1]))) < TOLERANCE_M


@pytest.mark.parametrize(
    ("start", "first"), [((2.1, 1.1), (2.1, 1.255)), ((-0.1, 2.0), (0.0, 2.0)), ((3.1, 0.5), (3.255, 0.5))]
)
def test_start_that_is_not_free_gets_a_first_leg_out(planner: Planner, start: Point, first: Point) -> None:
    result = plan(planner, 1, start, (4.9, 2.0))
    assert result.path[0] == pytest.approx(first)
    assert max(depth_m(*point) for point in along(result.path)) < TOLERANCE_M


def test_start_within_another_robots_disc_leads_straight_away_from_it(planner: Planner) -> None:
    result = plan(planner, 1, (4.0, 2.0), (0.5, 0.5), (4.3, 2.0, 0.6))
    assert result.path[0] == pytest.approx((3.7, 2.0))
    assert min(math.dist(point, (4.3, 2.0)) for point in along(result.path)) > 0.6 - TOLERANCE_M


def test_goal_within_another_robots_disc_ends_beside_it(planner: Planner) -> None:
    result = plan(planner, 1, (4.0, 0.5), (4.0, 4.0), (4.0, 4.0, 0.6))
    assert result.ok
    assert not result.reaches_goal
    assert math.dist(result.path[-1], (4.0, 4.0)) == pytest.approx(0.6)


def test_robots_in_the_only_way_are_a_failure_with_a_reason(planner: Planner) -> None:
    result = plan(planner, 1, (0.5, 0.5), (4.5, 0.5), (2.5, 2.0, 0.9), (2.5, 4.6, 0.9), (0.5, 2.5, 0.6))
    assert (result.ok, result.path, result.reason) == (False, (), "no path found within 2000 checks")
    assert 2000 <= result.checks < 2400


def test_nowhere_to_stand_is_a_failure(planner: Planner) -> None:
    assert plan(planner, 1, (1.0, 1.0), (4.0, 4.0), (2.5, 2.5, 9.0)).reason == "no free point near the start"


@pytest.mark.parametrize("checks", [1, 10, 200])
def test_budget_is_kept(checks: int) -> None:
    for name in NAMES:
        result = plan(PlannerSpec(name, CASE, RADIUS_M, {"checks": checks}).build(), 1, (0.5, 0.5), (4.5, 0.5))
        assert result.checks < checks + 150


def test_history_makes_no_difference(planner: Planner) -> None:
    asked = [((0.5, 0.5), (4.5, 0.5)), ((0.5, 2.5), (4.5, 4.5)), ((1.0, 1.0), (1.0, 4.0)), ((0.2, 4.8), (4.9, 0.2))]
    first = [plan(planner, number, *ends) for number, ends in enumerate(asked)]
    for number in (3, 1, 1, 2, 0, 3):
        assert plan(planner, number, *asked[number]) == first[number]
        plan(planner, 77, (1.0, 1.0), (4.0, 4.0), (3.0, 2.0, 0.5))
    fresh = PlannerSpec(f"soter.stack.planners.sampling:{type(planner).__name__}", CASE, RADIUS_M).build()
    assert plan(fresh, 2, *asked[2]) == first[2]


def test_seed_robot_and_request_make_a_difference() -> None:
    planner = PlannerSpec("ompl-rrtconnect", CASE, RADIUS_M).build()
    base = PlanRequest(1, 1, (0.5, 0.5), (4.5, 0.5), seed=1)
    asked = (base, replace(base, request_id=2), replace(base, robot_id=2), replace(base, seed=2))
    assert len({planner.plan(request).path for request in asked}) == 4


SCRIPT = """if True:
    import json, sys
    from soter.stack.planners import PlannerSpec, PlanRequest
    from soter.stack.planners.service import PlanService
    from tests.stack.planners.places import CASE, RADIUS_M
    with PlanService(PlannerSpec(sys.argv[1], CASE, RADIUS_M)) as service:
        for number in json.loads(sys.argv[2]):
            service.submit(PlanRequest(number, 2, (0.5, 0.5), (4.5, number / 10), seed=3), 0.0)
        print(json.dumps(sorted([r.request_id, r.path, r.checks] for r in service.due(2.0))))
"""


@pytest.mark.parametrize("name", NAMES)
def test_processes_agree_whatever_they_did_before(name: str) -> None:
    orders = (list(range(12)), list(range(11, -1, -1)))
    seen = []
    for hash_seed, order in enumerate(orders):
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONHASHSEED": str(hash_seed)}
        command = [sys.executable, "-c", SCRIPT, name, json.dumps(order)]
        seen.append(subprocess.run(command, capture_output=True, text=True, env=env, check=True).stdout)
    planner = PlannerSpec(name, CASE, RADIUS_M).build()
    here = [planner.plan(PlanRequest(n, 2, (0.5, 0.5), (4.5, n / 10), seed=3)) for n in range(12)]
    assert seen[0] == seen[1] == json.dumps([[r.request_id, r.path, r.checks] for r in here]) + "\n"


def test_way_out_does_not_lead_through_a_wall() -> None:
    # The free point nearest to a robot that stands in the disc of another one is behind a thin wall.
    walled = Workspace(4.0, 4.0, (Box(0.0, 2.0, 3.0, 2.05),), ())
    planner = PlannerSpec("ompl-bitstar", walled, 0.1, {"clearance_m": 0.0}).build()
    result = plan(planner, 1, (1.0, 1.8), (3.5, 0.5), (1.0, 1.7, 0.4))
    assert result.ok
    assert max(y for _, y in result.path) <= 1.9 + TOLERANCE_M


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("ompl-bitstar", {"check": 10}, "did you mean 'checks'"),
        ("ompl-bitstar", {"checks": 0}, "checks"),
        ("ompl-rrtstar", {"range_m": -1.0}, "range_m"),
        ("ompl-rrtconnect", {"settle_checks": 10}, "unknown"),
        ("ompl-rrtconnect", {"clearance_m": float("nan")}, "clearance_m"),
    ],
)
def test_bad_options_are_named(name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        PlannerSpec(name, CASE, RADIUS_M, options).build()
    assert str(caught.value).startswith(f"planners.{name}.")
