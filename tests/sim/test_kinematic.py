"""The kinematic engine: closed forms, contact, and independence of how many robots there are."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.sdk.values import RobotSpec, RuleLimits, Waypoint
from soter_sim import BODY_RADIUS_M, LIMITS, World
from soter_sim.kinematic import KinematicEngine
from tests.sim.worlds import CASE, constant, driven, empty, positions, scripted, specs, touring

V, A, YAW_A = LIMITS.v_max_m_s, LIMITS.accel_m_s2, LIMITS.yaw_accel_rad_s2


def test_speed_ramps_and_distance_is_its_integral() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0)))
    world.set_control(1, constant(V))
    for period in range(1, 60):
        t = period * 0.05
        world.advance(t)
        assert world.bodies.v[0] == pytest.approx(min(A * t, V))
        expected = A * t * t / 2 if t <= V / A else V * t - V * V / (2 * A)
        assert world.bodies.x[0] - 5.0 == pytest.approx(expected)
        assert world.bodies.y[0] == 5.0


def test_it_stops_in_the_promised_distance() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0)))
    world.set_control(1, constant(V))
    world.advance(2.0)
    before = world.bodies.x[0]
    world.set_control(1, None)
    world.advance(3.0)
    assert world.bodies.v[0] == 0.0
    assert world.bodies.x[0] - before == pytest.approx(V * V / (2 * LIMITS.brake_m_s2))


def test_a_turn_in_place_is_the_integral_of_the_turn_rate() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.3)))
    world.set_control(1, constant(0.0, 1.0))
    world.advance(2.0)
    assert world.bodies.heading[0] == pytest.approx(0.3 + 2.0 - 1.0 / (2 * YAW_A))
    assert positions(world) == [(5.0, 5.0)]


def test_steady_speed_and_turn_rate_trace_a_circle() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0)))
    world.set_control(1, constant(0.2, 0.5))
    world.advance(2.0)
    bodies = world.bodies
    x, y, heading = bodies.x[0], bodies.y[0], bodies.heading[0]
    radius = 0.2 / 0.5
    centre = (x - radius * math.sin(heading), y + radius * math.cos(heading))
    for period in range(41, 200):
        world.advance(period * 0.05)
        assert math.dist((bodies.x[0], bodies.y[0]), centre) == pytest.approx(radius)
        assert -math.pi < bodies.heading[0] <= math.pi


@pytest.mark.parametrize("command", [(9.0, 9.0), (-9.0, -9.0), (math.inf, -math.inf), (math.nan, math.nan)])
def test_what_is_commanded_never_breaks_the_limits(command: tuple[float, float]) -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0)))
    world.set_control(1, constant(*command))
    for period in range(1, 60):
        before = positions(world)[0]
        world.advance(period * 0.05)
        assert abs(world.bodies.v[0]) <= V
        assert abs(world.bodies.yaw_rate[0]) <= LIMITS.yaw_rate_max_rad_s
        assert math.dist(before, positions(world)[0]) <= V * 0.05 + 1e-12


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    commands=st.lists(st.tuples(st.floats(-1, 1), st.floats(-4, 4)), min_size=1, max_size=40),
    brake_from=st.integers(0, 40),
)
def test_the_reach_bound_holds_under_any_controller(commands: list[tuple[float, float]], brake_from: int) -> None:
    world = World(empty(), specs((10.0, 10.0, 0.0)))
    queue = iter(commands)
    world.set_control(1, lambda *_: next(queue, (0.0, 0.0)))
    horizon = len(commands) * 0.05
    world.advance(brake_from * 0.05)
    remaining = max(horizon - world.now_s, 0.0)
    start = positions(world)[0]
    world.advance(horizon + 5.0)
    bound = V * remaining + V * V / (2 * LIMITS.brake_m_s2)
    assert math.dist(start, positions(world)[0]) <= bound + 1e-9


def test_two_robots_that_meet_stop_at_contact_and_may_part_again() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), (6.0, 5.05, math.pi)))
    world.set_control(1, constant(V))
    world.set_control(2, constant(V))
    world.advance(6.0)
    assert math.dist(*positions(world)) == pytest.approx(2 * BODY_RADIUS_M, abs=1e-12)
    assert world.bodies.v == pytest.approx([0.0, 0.0], abs=0.06)
    assert world.truth.report().contacts == 1
    # In contact it may turn.
    held = positions(world)
    world.set_control(1, constant(0.0, 1.0))
    world.set_control(2, None)
    world.advance(7.0)
    assert positions(world) == held
    assert world.bodies.heading[0] > 0.8
    world.set_control(1, constant(-V))
    world.advance(8.0)
    assert math.dist(*positions(world)) > 0.3


def test_a_robot_that_catches_up_stops_and_the_other_drives_on() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), (5.4, 5.0, 0.0)))
    world.set_control(1, constant(V))
    world.set_control(2, constant(0.05))
    world.advance(10.0)
    assert world.bodies.x[1] == pytest.approx(5.4 + 0.05 * 10.0 - 0.05**2 / 2)
    assert world.bodies.x[1] - world.bodies.x[0] >= 2 * BODY_RADIUS_M - 1e-12


def test_a_box_is_met_at_the_bodys_radius_even_at_its_corner() -> None:
    walls = Workspace(9.0, 9.0, (Box(4, 4, 5, 5),), ())
    world = World(walls, specs((3.5, 4.5, 0.0), (3.6, 3.6, math.pi / 4), (4.5, 3.5, math.pi / 2)))
    for robot in (1, 2, 3):
        world.set_control(robot, constant(V))
    world.advance(8.0)
    clearances = [walls.clearance_m(x, y, BODY_RADIUS_M) for x, y in positions(world)]
    assert clearances == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    world.set_control(1, constant(-V))
    world.advance(9.0)
    assert walls.clearance_m(*positions(world)[0], BODY_RADIUS_M) > 0.1


def test_a_robot_that_starts_inside_a_box_can_only_leave_it() -> None:
    walls = Workspace(9.0, 9.0, (Box(4, 4, 5, 5),), ())
    world = World(walls, specs((3.95, 4.5, 0.0)))
    world.set_control(1, constant(V))
    world.advance(1.0)
    assert positions(world) == [(3.95, 4.5)]
    world.set_control(1, constant(-V))
    world.advance(3.0)
    assert world.bodies.x[0] < 3.7


def test_a_robot_squeezed_between_others_and_a_wall_never_overlaps() -> None:
    rng = random.Random(5)
    walls = Workspace(9.0, 9.0, (Box(4, 4, 5, 5), Box(5.3, 4, 6, 5)), ())
    poses = [(3.5 + 0.25 * (k % 8), 3.2 + 0.25 * (k // 8), rng.uniform(-3, 3)) for k in range(24)]
    world = World(walls, specs(*poses))
    for robot in world.bodies.ids:
        pushes = [(rng.uniform(-V, V), rng.uniform(-2.8, 2.8)) for _ in range(40)]
        world.set_control(robot, scripted(pushes, 0.5))
    for period in range(1, 400):
        world.advance(period * 0.05)
        places = positions(world)
        assert min(walls.clearance_m(x, y, BODY_RADIUS_M) for x, y in places) >= -1e-9
        gaps = (math.dist(a, b) for k, a in enumerate(places) for b in places[:k])
        assert min(gaps) >= 2 * BODY_RADIUS_M - 1e-9
    assert world.truth.report().contacts > 10


def test_a_robot_moves_the_same_bit_for_bit_whoever_else_is_far_away() -> None:
    def track(others: int) -> list[tuple[float, float]]:
        rng = random.Random(1)
        crowd = [(60.0 + 2.0 * (k % 8), 60.0 + 2.0 * (k // 8), rng.uniform(-3, 3)) for k in range(others)]
        world = World(CASE, specs((0.5, 0.5, 0.0), (1.4, 0.5, math.pi), *crowd))
        for robot in world.bodies.ids[:2]:
            steps = random.Random(robot)
            targets = [Waypoint(steps.uniform(0, 5), steps.uniform(0, 5)) for _ in range(20)]
            world.set_control(robot, touring(world, targets))
        for robot in world.bodies.ids[2:]:
            world.set_control(robot, constant(0.1, 0.4))
        found = []
        for period in range(1, 1900):
            world.advance(period * 0.05)
            found += positions(world)[:2]
        return found

    alone = track(0)
    assert alone == track(6)
    assert alone == track(62)


def test_how_time_is_cut_into_calls_changes_nothing() -> None:
    def end(*times: float) -> list[tuple[float, float]]:
        world = World(CASE, specs((0.5, 0.5, 0.0), (1.4, 0.5, math.pi)))
        world.set_control(1, driven(lambda: Waypoint(1.5, 1.9)))
        world.set_control(2, constant(0.2, 0.3))
        for time_s in times:
            world.advance(time_s)
        return positions(world)

    assert end(10.0) == end(*(k * 0.013 for k in range(1, 770)), 10.0)


def test_a_finer_step_is_the_same_motion() -> None:
    def engine(workspace: Workspace, robots: Sequence[RobotSpec], limits: RuleLimits) -> KinematicEngine:
        return KinematicEngine(workspace, robots, limits, 1 / 60)

    coarse = World(empty(), specs((5.0, 5.0, 0.3)))
    fine = World(empty(), specs((5.0, 5.0, 0.3)), engine)
    for world in (coarse, fine):
        world.set_control(1, constant(0.2, 0.5))
        world.advance(6.0)
    assert fine.period_s == 1 / 60
    assert math.dist(coarse.truth.pose(1), fine.truth.pose(1)) < 1e-3
