"""Copters without physics: limits, the ground, batteries, and the rules seen from above."""

from __future__ import annotations

import math
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.sdk.values import RobotSpec
from soter_sim import World
from soter_sim.copter import (
    ACCEL_M_S2,
    CLIMB_MAX_M_S,
    SINK_M_S,
    STEP_S,
    V_MAX_M_S,
    YAW_RATE_MAX_RAD_S,
    CopterEngine,
    Flight,
    Pilot,
    Wanted,
)
from tests.sim.worlds import empty, specs

UP = (0.0, 0.0, 0.5, 0.0)


def steady(*wanted: float) -> Pilot:
    """A pilot who always wants the same."""
    east, north, up, turn = wanted

    def pilot(_now_s: float, _flight: Flight) -> Wanted:
        return east, north, up, turn

    return pilot


def copters(
    *poses: tuple[float, float, float], workspace: Workspace | None = None, battery: float | None = None
) -> tuple[World, CopterEngine]:
    """A world of copters on the ground."""
    world = World(workspace or empty(), specs(*poses, battery=battery), CopterEngine)
    engine = world.engine
    assert isinstance(engine, CopterEngine)
    return world, engine


def fly(world: World, engine: CopterEngine, pilot: Pilot, duration_s: float, index: int = 0) -> None:
    """Let one pilot fly for a while."""
    engine.pilots[index] = pilot
    world.advance(world.now_s + duration_s)


finite = st.floats(-2.0, 2.0, allow_nan=False)


@given(st.lists(st.tuples(finite, finite, finite, finite), min_size=1, max_size=30))
@settings(max_examples=60)
def test_no_pilot_can_make_it_do_more_than_it_can(script: list[tuple[float, float, float, float]]) -> None:
    world, engine = copters((10.0, 10.0, 0.3))
    fly(world, engine, steady(*UP), 1.0)
    before = engine.flight(0)
    for wanted in script:
        fly(world, engine, steady(*wanted), STEP_S)
        now = engine.flight(0)
        speed_m_s = math.hypot(now.east_m_s, now.north_m_s)
        change_m_s = math.dist((now.east_m_s, now.north_m_s), (before.east_m_s, before.north_m_s))
        assert speed_m_s <= V_MAX_M_S + 1e-9
        assert change_m_s <= ACCEL_M_S2 * STEP_S + 1e-9
        assert abs(now.up_m_s) <= CLIMB_MAX_M_S + 1e-9
        assert abs(now.yaw_rate_rad_s) <= YAW_RATE_MAX_RAD_S
        assert now.z_m >= 0.0
        assert math.dist((now.x_m, now.y_m), (before.x_m, before.y_m)) <= V_MAX_M_S * STEP_S + 1e-9
        before = now


def test_it_accelerates_at_its_rate_and_stops_within_the_distance_that_follows() -> None:
    world, engine = copters((10.0, 10.0, 0.0))
    fly(world, engine, steady(*UP), 1.0)
    fly(world, engine, steady(0.4, 0.0, 0.0, 0.0), 0.1)
    assert engine.flight(0).east_m_s == pytest.approx(0.2)
    fly(world, engine, steady(0.4, 0.0, 0.0, 0.0), 1.0)
    assert engine.velocity(0) == pytest.approx((0.4, 0.0))
    before_m = engine.flight(0).x_m
    fly(world, engine, steady(0.0, 0.0, 0.0, 0.0), 1.0)
    assert engine.flight(0).x_m - before_m == pytest.approx(0.4**2 / (2.0 * ACCEL_M_S2))


def test_on_the_ground_it_neither_slides_nor_turns_nor_sinks() -> None:
    world, engine = copters((10.0, 10.0, 0.5))
    fly(world, engine, steady(0.5, 0.5, -0.5, 1.0), 2.0)
    assert tuple(engine.flight(0)) == pytest.approx((10.0, 10.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0))


def test_it_turns_and_its_heading_stays_in_range() -> None:
    world, engine = copters((10.0, 10.0, 3.0))
    fly(world, engine, steady(*UP), 1.0)
    fly(world, engine, steady(0.0, 0.0, 0.0, 1.0), 1.0)
    assert engine.flight(0).heading_rad == pytest.approx(4.0 - 2.0 * math.pi)


def test_what_is_no_number_is_rest() -> None:
    world, engine = copters((10.0, 10.0, 0.0))
    fly(world, engine, steady(*UP), 1.0)
    fly(world, engine, steady(math.nan, 0.0, math.inf, 0.0), 1.0)
    assert engine.flight(0)[4:] == (0.0, 0.0, 0.0, 0.0)


def test_flying_costs_as_much_as_driving_and_the_ground_as_little_as_standing() -> None:
    world, engine = copters((10.0, 10.0, 0.0))
    spec = RobotSpec(1, 0.0, 0.0, 0.0)
    fly(world, engine, steady(0.0, 0.0, 0.0, 0.0), 36.0)
    assert world.bodies.charge[0] == pytest.approx(1.0 - 36.0 / spec.idle_s)
    fly(world, engine, steady(*UP), 18.0)
    assert world.bodies.charge[0] == pytest.approx(1.0 - 36.0 / spec.idle_s - 18.0 / spec.drive_s, abs=1e-4)


def test_it_charges_when_it_has_landed_on_a_station_and_not_above_it() -> None:
    world, engine = copters((1.0, 1.0, 0.0), workspace=empty(20.0, 20.0, Box(0.5, 0.5, 1.5, 1.5)), battery=0.5)
    fly(world, engine, steady(*UP), 2.0)
    assert world.bodies.charge[0] < 0.5
    fly(world, engine, steady(0.0, 0.0, -0.5, 0.0), 3.0)
    assert world.bodies.charge[0] > 0.5


def test_an_empty_battery_brings_it_down_where_it_is() -> None:
    world, engine = copters((10.0, 10.0, 0.0))
    fly(world, engine, steady(*UP), 4.0)
    high_m = engine.flight(0).z_m
    world.bodies.charge[0] = 1e-6
    fly(world, engine, steady(0.5, 0.0, 0.5, 0.0), 2.0)
    # It was on its way up: first that is braked.
    rise_m, turn_s = 0.5 * 0.5**2 / ACCEL_M_S2, (0.5 + SINK_M_S) / ACCEL_M_S2
    sunk_m = 0.5 * SINK_M_S**2 / ACCEL_M_S2 + SINK_M_S * (2.0 - turn_s)
    assert engine.flight(0).z_m == pytest.approx(high_m + rise_m - sunk_m, abs=0.05)
    assert engine.flight(0).east_m_s == 0.0
    assert world.truth.report().count("battery") == 1


def test_the_fence_is_a_rule_at_every_height() -> None:
    world, engine = copters((19.0, 10.0, 0.0))
    fly(world, engine, steady(*UP), 4.0)
    fly(world, engine, steady(0.5, 0.0, 0.0, 0.0), 4.0)
    (violation,) = world.truth.report().violations
    assert violation.rule == "geofence"
    crossed_s = 4.0 + 1.0 / 0.5 + 0.5 / (2.0 * ACCEL_M_S2)
    assert violation.start_s == pytest.approx(crossed_s, abs=0.01)


def test_boxes_have_no_top_and_stop_it() -> None:
    room = Workspace(20.0, 20.0, (Box(11.0, 9.0, 12.0, 11.0),), ())
    world, engine = copters((10.0, 10.0, 0.0), workspace=room)
    fly(world, engine, steady(*UP), 6.0)
    fly(world, engine, steady(0.5, 0.0, 0.0, 0.0), 4.0)
    assert engine.flight(0).x_m == pytest.approx(11.0 - 0.105, abs=1e-6)
    assert engine.velocity(0)[0] <= ACCEL_M_S2 * STEP_S
    report = world.truth.report()
    assert (report.count("obstacle"), report.contacts) == (1, 1)


def test_two_copters_collide_as_robots_do() -> None:
    world, engine = copters((10.0, 10.0, 0.0), (11.0, 10.0, 0.0))
    for index in (0, 1):
        engine.pilots[index] = steady(*UP)
    world.advance(2.0)
    engine.pilots[0], engine.pilots[1] = steady(0.3, 0.0, 0.0, 0.0), steady(0.0, 0.0, 0.0, 0.0)
    world.advance(8.0)
    report = world.truth.report()
    assert report.count("collision") == 1
    assert math.dist(world.truth.pose(1)[:2], world.truth.pose(2)[:2]) >= 0.21 - 1e-6


def test_a_finer_step_is_the_same_flight() -> None:
    ends = []
    for step_s in (0.05, 0.01):
        world = World(empty(), specs((10.0, 10.0, 0.0)), partial(CopterEngine, step_s=step_s))
        engine = world.engine
        assert isinstance(engine, CopterEngine)
        fly(world, engine, steady(*UP), 2.0)
        fly(world, engine, steady(0.3, -0.2, 0.0, 0.0), 2.0)
        ends.append(tuple(engine.flight(0)))
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)
