"""Simulated vehicles with slipping wheels, worn brakes, or no life in them."""

from __future__ import annotations

import math

import pytest

from soter.faults.vehicle import TUBE_PER_GRIP_M
from soter.geometry.workspace import Workspace
from soter.onboard.drive import TUBE_M, Drive
from soter.sdk import RobotSpec, Waypoint
from soter_sim import LIMITS, Impairment, World

PERIOD_S = 0.05
EMPTY = Workspace(20.0, 20.0, (), ())
ENGINES = ["kinematic", pytest.param("pybullet", marks=pytest.mark.pybullet)]


def alone(engine: str = "kinematic", heading_rad: float = 0.0) -> World:
    return World(EMPTY, [RobotSpec(1, 10.0, 10.0, heading_rad)], engine)


@pytest.mark.parametrize("engine", ENGINES)
def test_slipping_wheels_make_a_robot_slower_and_turn_it(engine: str) -> None:
    with alone(engine) as world:
        world.set_control(1, lambda *_: (0.2, 0.0))
        world.impair(1, Impairment(left=0.5, right=0.5))
        world.advance(4.0)
        assert world.bodies.x[0] - 10.0 == pytest.approx(0.4, rel=0.05)
        assert world.bodies.heading[0] == pytest.approx(0.0, abs=0.02)
    with alone(engine) as world:
        world.set_control(1, lambda *_: (0.2, 0.0))
        world.impair(1, Impairment(left=0.9))
        world.advance(4.0)
        assert world.bodies.heading[0] == pytest.approx(0.02 / 0.14 * 4.0, rel=0.1), (
            "to the side of the wheel that slips"
        )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("brake", [1.0, 0.5, 0.2])
def test_worn_brakes_need_a_longer_way(engine: str, brake: float) -> None:
    with alone(engine) as world:
        world.set_control(1, lambda now_s, *_: (LIMITS.v_max_m_s if now_s < 1.99 else 0.0, 0.0))
        world.impair(1, Impairment(brake=brake))
        world.advance(2.0)
        began_m, speed = world.bodies.x[0], world.bodies.v[0]
        world.advance(6.0)
        assert world.bodies.v[0] == pytest.approx(0.0, abs=1e-3)
        way_m = speed * speed / (2.0 * brake * LIMITS.brake_m_s2)
        assert way_m * 0.85 <= world.bodies.x[0] - began_m <= way_m * 1.001 + 0.001


def test_the_dead_stand_still_and_the_living_obey_again() -> None:
    with alone() as world:
        world.set_control(1, lambda *_: (0.2, 0.0))
        world.advance(1.0)
        world.impair(1, Impairment(alive=False))
        world.advance(2.0)
        assert world.bodies.v[0] == 0.0
        world.impair(1, Impairment())
        world.advance(3.0)
        assert world.bodies.v[0] == 0.2


def test_a_command_that_is_no_number_is_rest_as_it_is_without_an_impairment() -> None:
    with alone() as world:
        world.set_control(1, lambda *_: (math.nan, math.inf))
        world.impair(1, Impairment(left=0.9))
        world.advance(1.0)
        assert (world.bodies.x[0], world.bodies.heading[0]) == (10.0, 0.0)


@pytest.mark.parametrize("wrong", [Impairment(left=1.5), Impairment(right=-0.1), Impairment(brake=math.nan)])
def test_parts_are_between_0_and_1(wrong: Impairment) -> None:
    with alone() as world, pytest.raises(ValueError, match="allowed: 0 to 1"):
        world.impair(1, wrong)


@pytest.mark.parametrize("grips", [(0.95, 1.0), (1.0, 0.97), (0.8, 0.85), (0.6, 0.6), (0.5, 0.45)])
@pytest.mark.parametrize("bearing", [0.0, 0.5, 1.5, 3.0, -2.5])
def test_the_promised_tube_holds_for_the_legs_of_safe_controllers(grips: tuple[float, float], bearing: float) -> None:
    with alone() as world:
        drive = Drive(LIMITS, PERIOD_S)
        target = Waypoint(10.0 + 0.5 * math.cos(bearing), 10.0 + 0.5 * math.sin(bearing))
        world.set_control(1, lambda _, x, y, heading, v, w: drive.command(x, y, heading, v, w, target))
        world.impair(1, Impairment(*grips))
        furthest_m = 0.0
        for period in range(1, 300):
            world.advance(period * PERIOD_S)
            dx, dy = world.bodies.x[0] - 10.0, world.bodies.y[0] - 10.0
            along = min(max(dx * math.cos(bearing) + dy * math.sin(bearing), 0.0), 0.5)
            furthest_m = max(furthest_m, math.hypot(dx - along * math.cos(bearing), dy - along * math.sin(bearing)))
        assert math.hypot(world.bodies.x[0] - target.x_m, world.bodies.y[0] - target.y_m) < 0.02
    assert furthest_m <= TUBE_M + TUBE_PER_GRIP_M * abs(grips[0] - grips[1])
