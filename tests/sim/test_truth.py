"""What the world says about itself: intervals, margins, contacts."""

from __future__ import annotations

import math
import random

import pytest

from soter.geometry.draft import Draft, Outline, Spot, site_of
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk.backend import RULES, Violation
from soter.sdk.values import RuleLimits
from soter_sim import BODY_RADIUS_M, LIMITS, World
from tests.sim.worlds import CASE, constant, empty, positions, promising, scripted, specs

V = LIMITS.v_max_m_s
RAMP_M = V * V / (2 * LIMITS.accel_m_s2)
"""What a robot that speeds up from rest falls behind one at full speed."""


def reached_after(distance_m: float) -> float:
    """When a robot that starts at rest has come so far."""
    return (distance_m + RAMP_M) / V


def test_a_quiet_world_has_only_margins() -> None:
    world = World(CASE, specs((1.0, 1.0, 0.0), (2.5, 2.0, 0.0), battery=0.7))
    world.advance(1.0)
    report = world.truth.report()
    assert report.violations == ()
    assert report.contacts == 0
    assert list(report.min_margin) == list(RULES)
    assert report.min_margin["battery"] == 0.7
    assert report.min_margin["geofence"] == 1.0
    assert report.min_margin["collision"] == pytest.approx(math.hypot(1.5, 1.0) - 0.3)
    assert report.min_margin["obstacle"] == pytest.approx(0.6 - BODY_RADIUS_M)


def test_margins_of_rules_that_cannot_break_are_left_out() -> None:
    world = World(empty(), specs((1.0, 1.0, 0.0)))
    assert set(world.truth.report().min_margin) == {"battery", "geofence"}


def test_a_world_without_a_fence_judges_all_other_rules() -> None:
    post = Outline("post", [(2.0, -0.1), (2.2, -0.1), (2.2, 0.1), (2.0, 0.1)])
    open_ground = site_of(
        Draft("open ground", keep_outs=[post], stations=[Spot("station", -1.0, 0.0)]), phi_safer_m=0.5, spacing_m=0.5
    )
    world = World(open_ground, specs((0.0, 0.0, 0.0), (-9.0, 0.0, math.pi)))
    world.set_control(1, constant(V))
    world.set_control(2, constant(V))
    world.advance(30.0)
    report = world.truth.report()
    assert set(report.min_margin) == {"battery", "collision", "obstacle"}
    assert [violation.rule for violation in report.violations] == ["obstacle"]


def test_the_fence_is_crossed_at_an_exact_time_both_ways() -> None:
    world = World(empty(5.0, 5.0), specs((4.5, 2.0, 0.0)))
    world.set_control(1, constant(V))
    world.advance(4.0)
    (open_one,) = world.truth.report().violations
    assert open_one == Violation("geofence", (1,), open_one.start_s, None)
    assert open_one.start_s == pytest.approx(reached_after(0.5 + 1e-6), abs=1e-6)
    world.set_control(1, constant(-V))
    world.advance(12.0)
    (closed,) = world.truth.report().violations
    assert closed.start_s == open_one.start_s
    assert closed.end_s is not None
    assert 4.0 < closed.end_s < 12.0
    assert world.truth.report().min_margin["geofence"] < -0.3


def test_standing_on_the_fence_is_inside_and_a_hair_beyond_is_not() -> None:
    world = World(empty(5.0, 5.0), specs((5.0, 2.0, 0.0), (0.0, 5.0 + 2e-6, 0.0), (2.0, 5.0 + 5e-7, 0.0)))
    world.advance(1.0)
    assert world.truth.report().violations == (Violation("geofence", (2,), 0.0, None),)


def test_a_violation_at_time_0_counts_even_if_it_ends_at_once() -> None:
    world = World(empty(5.0, 5.0), specs((5.0 + 2e-6, 2.0, math.pi)))
    assert world.truth.report().count("geofence") == 1
    world.set_control(1, constant(V))
    world.advance(1.0)
    (only,) = world.truth.report().violations
    assert only.start_s == 0.0
    assert only.end_s == pytest.approx(0.05 * math.sqrt(1e-6 / (0.5 * 0.05**2)), abs=0.05)


def test_a_pair_is_in_collision_for_one_interval_with_exact_ends() -> None:
    # Robot 1 passes robot 2 at 0.2 m and 0.25 m, but never touches it.
    world = World(empty(), specs((5.0, 5.0, 0.0), (6.0, 5.25, 0.0)))
    world.set_control(1, constant(V))
    world.advance(9.0)
    (only,) = world.truth.report().violations
    half = math.sqrt(0.3**2 - 0.25**2)
    assert (only.rule, only.robots) == ("collision", (1, 2))
    assert only.start_s == pytest.approx(reached_after(1.0 - half), abs=1e-9)
    assert only.end_s == pytest.approx(reached_after(1.0 + half), abs=1e-9)
    assert world.truth.report().min_margin["collision"] == pytest.approx(-0.05)
    assert world.truth.report().contacts == 0


def test_a_pass_beyond_the_missions_separation_is_none() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), (6.0, 5.25, 0.0)), limits=RuleLimits(0.236))
    world.set_control(1, constant(V))
    world.advance(9.0)
    assert world.truth.report().violations == ()
    assert world.truth.report().min_margin["collision"] == pytest.approx(0.25 - 0.236)


@pytest.mark.parametrize("engine", ["kinematic", pytest.param("pybullet", marks=pytest.mark.pybullet)])
def test_bodies_that_lean_on_each_other_collide_whatever_the_mission_says(engine: str) -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), (5.5, 5.0, 0.0)), engine, RuleLimits(0.1))
    with world:
        world.set_control(1, constant(V))
        world.advance(4.0)
        assert [(each.rule, each.end_s) for each in world.truth.report().violations] == [("collision", None)]
        world.set_control(1, constant(-V))
        world.advance(8.0)
        assert all(each.end_s is not None for each in world.truth.report().violations)


def test_a_body_nearer_to_a_box_than_the_mission_allows_breaks_the_rule_and_touches_nothing() -> None:
    box = Workspace(9, 9, (Box(4, 4, 5, 5),), ())
    world = World(box, specs((3.5, 4.5, 0.0)), limits=RuleLimits(clearance_m=0.1))
    control = scripted([(V, 0.0), (-V, 0.0)], 1.5)
    world.set_control(1, control)
    world.advance(3.0)
    (only,) = world.truth.report().violations
    assert (only.rule, only.robots) == ("obstacle", (1,))
    assert only.start_s == pytest.approx(reached_after(0.5 - BODY_RADIUS_M - 0.1), abs=0.05)
    assert only.end_s is not None
    assert world.truth.report().contacts == 0
    assert world.truth.report().min_margin["obstacle"] < 0.0


def test_two_passes_are_two_violations_and_pairs_are_named_in_order() -> None:
    world = World(empty(), specs((6.0, 5.25, 0.0), (5.0, 5.0, 0.0)))
    world.set_control(2, constant(V))
    world.advance(9.0)
    world.set_control(2, constant(-V))
    world.advance(18.0)
    violations = world.truth.report().violations
    assert [each.robots for each in violations] == [(1, 2), (1, 2)]
    assert all(each.end_s is not None for each in violations)


def test_a_pair_that_starts_too_near_is_in_collision_from_0() -> None:
    world = World(empty(), specs((5.0, 5.0, math.pi), (5.25, 5.0, 0.0)))
    assert world.truth.report().violations == (Violation("collision", (1, 2), 0.0, None),)
    world.set_control(1, constant(V))
    world.advance(2.0)
    (only,) = world.truth.report().violations
    assert only.end_s == pytest.approx(reached_after(0.05), abs=1e-9)


def test_a_bump_into_a_box_is_a_violation_from_impact_until_it_is_clear() -> None:
    world = World(Workspace(9, 9, (Box(4, 4, 5, 5),), ()), specs((3.5, 4.5, 0.0)))
    world.set_control(1, constant(V))
    world.advance(4.0)
    (open_one,) = world.truth.report().violations
    assert (open_one.rule, open_one.end_s) == ("obstacle", None)
    assert open_one.start_s == pytest.approx(reached_after(0.5 - BODY_RADIUS_M), abs=1e-9)
    world.set_control(1, constant(-V))
    world.advance(5.0)
    (closed,) = world.truth.report().violations
    assert closed.end_s == pytest.approx(4.0 + reached_after(0.002), abs=0.1)
    assert world.truth.report().contacts == 1
    assert world.truth.robot_contacts == 0
    assert world.truth.report().min_margin["obstacle"] == pytest.approx(0.0, abs=1e-12)


def test_touching_without_moving_against_it_is_no_violation() -> None:
    world = World(Workspace(9, 9, (Box(4, 4, 5, 5),), ()), specs((4.0 - BODY_RADIUS_M, 4.5, math.pi / 2)))
    world.set_control(1, constant(V))
    world.advance(1.0)
    assert world.truth.report().violations == ()


def test_a_start_inside_a_box_is_a_violation_from_0() -> None:
    world = World(Workspace(9, 9, (Box(4, 4, 5, 5),), ()), specs((3.9 - 0.003, 4.5, math.pi), (3.9, 4.9, 0.0)))
    violations = world.truth.report().violations
    assert [(each.robots, each.start_s) for each in violations] == [((1,), 0.0), ((2,), 0.0)]
    assert world.truth.report().min_margin["obstacle"] == pytest.approx(-0.005)


def test_contacts_of_robots_are_counted_apart() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), (5.5, 5.0, 0.0)))
    world.set_control(1, constant(V))
    world.advance(3.0)
    assert (world.truth.report().contacts, world.truth.robot_contacts) == (1, 1)
    assert world.truth.report().count("obstacle") == 0


@pytest.mark.parametrize(
    ("limits", "radii", "periods"),
    [
        (RuleLimits(), (BODY_RADIUS_M,) * 4, 4000),
        (RuleLimits(0.236), (BODY_RADIUS_M,) * 4, 1500),
        (RuleLimits(0.7, 0.05), (BODY_RADIUS_M,) * 4, 1500),
        (RuleLimits(0.1, 0.2), (0.3,) * 4, 1500),
        (RuleLimits(0.1), (0.05, 0.2, 0.35, 0.105), 1500),
    ],
)
def test_margins_are_those_of_a_judge_who_looks_at_every_step(
    limits: RuleLimits, radii: tuple[float, ...], periods: int
) -> None:
    rng = random.Random(2)
    chargers = tuple(RobotPlace(k, 0, 0, Box(k, k, k + 0.4, k + 0.4)) for k in range(1, 4))
    workspace = Workspace(5.0, 5.0, CASE.boxes, chargers)
    places = specs((1.0, 1.0, 0.0), (2.5, 2.0, 1.0), (4.0, 1.0, 2.0), (4.0, 4.5, 3.0))
    world = World(workspace, [promising(*each) for each in zip(places, radii, strict=True)], limits=limits)
    for robot in world.bodies.ids:
        moves = [(rng.uniform(-V, V), rng.uniform(-2, 2)) for _ in range(200)]
        world.set_control(robot, scripted(moves, 1.0))
    least = {"geofence": math.inf, "collision": math.inf, "obstacle": math.inf}
    for period in range(periods):
        world.advance(period * 0.05)
        poses = positions(world)
        seen: dict[tuple[str, tuple[int, ...]], float] = {}
        for robot, (x, y) in zip(world.bodies.ids, poses, strict=True):
            seen["geofence", (robot,)] = min(x, 5 - x, y, 5 - y)
            seen["obstacle", (robot,)] = workspace.clearance_m(x, y, radii[robot - 1]) - limits.clearance_m
            for other in range(1, robot):
                apart_m = max(limits.separation_m, radii[robot - 1] + radii[other - 1])
                seen["collision", (other, robot)] = math.dist((x, y), poses[other - 1]) - apart_m
        for (rule, robots), margin in seen.items():
            least[rule] = min(least[rule], margin)
            open_now = any(
                each.rule == rule and each.robots == robots and each.end_s is None
                for each in (world.truth.report().violations if period % 7 == 0 else ())
            )
            # A body that leaned on a box, or on another, is in contact until it is 2 mm away.
            leans = abs(margin) < 3e-3 and (rule == "obstacle" or limits.separation_m < 0.22)
            if period % 7 == 0 and not leans and abs(margin) > 1e-5:
                assert open_now == (margin < 0.0)
    report = world.truth.report()
    for rule, margin in least.items():
        # Between two steps it may have been a little less.
        assert margin - 0.011 <= report.min_margin[rule] <= margin + 1e-12
    assert report.count("collision") > 0 or limits != RuleLimits()
    assert report.count("geofence") > 0


def test_pose_is_where_the_robot_is() -> None:
    world = World(empty(), specs((1.0, 2.0, 0.5)))
    assert world.truth.pose(1) == (1.0, 2.0, 0.5)
