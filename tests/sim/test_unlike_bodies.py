"""A world builds the robot that was asked for: its radius, speed, brakes and turn rate, in both engines."""

from __future__ import annotations

import math

import pytest

from soter.adapters.pybullet import PyBulletBackend
from soter.sdk.values import RobotSpec
from soter_sim import World
from tests.sim.worlds import constant, empty, promising

ENGINES = ["kinematic", pytest.param("pybullet", marks=pytest.mark.pybullet)]
LIMITS = {"v_max_m_s": 1.0, "brake_m_s2": 1.5, "accel_m_s2": 0.8, "yaw_rate_max_rad_s": 1.0}
FAST = promising(RobotSpec(1, 5.0, 5.0, 0.0), 0.35, **LIMITS)


@pytest.mark.parametrize("engine", ENGINES)
def test_speed_acceleration_brakes_and_turn_rate_are_those_that_were_asked_for(engine: str) -> None:
    with World(empty(), [FAST], engine) as world:
        world.set_control(1, constant(9.0))
        world.advance(1.0)
        assert world.bodies.v[0] == pytest.approx(0.8, rel=0.05)
        world.advance(2.0)
        assert 0.98 < math.hypot(*world.engine.velocity(0)) <= 1.0
        before = world.bodies.x[0]
        world.set_control(1, None)
        world.advance(4.0)
        assert 0.9 / 3.0 < world.bodies.x[0] - before <= 1.0 / 3.0 + 1e-9
        world.set_control(1, constant(0.0, 9.0))
        world.advance(6.0)
        assert world.bodies.yaw_rate[0] == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("engine", ENGINES)
def test_bodies_touch_where_their_own_radii_meet(engine: str) -> None:
    robots = [promising(RobotSpec(1, 5.0, 5.0, 0.0), 0.35), promising(RobotSpec(2, 6.0, 5.0, 0.0), 0.2)]
    with World(empty(), robots, engine) as world:
        world.set_control(1, constant(0.22))
        world.advance(2.0)
        assert world.truth.report().contacts == 0
        world.advance(4.0)
        assert world.truth.report().contacts == 1
        assert world.truth.report().min_margin["collision"] == pytest.approx(0.0, abs=3e-3)


def test_a_robot_that_turns_back_brakes_at_one_rate_and_speeds_up_at_the_other() -> None:
    with World(empty(), [FAST]) as world:
        world.set_control(1, constant(1.0))
        world.advance(3.0)
        world.set_control(1, constant(-1.0))
        speeds = []
        for step in range(1, 40):
            world.advance(3.0 + 0.05 * step)
            speeds.append(world.bodies.v[0])
    falls = [before - after for before, after in zip([1.0, *speeds], speeds, strict=False)]
    assert all(fall <= 1.5 * 0.05 + 1e-9 for fall, after in zip(falls, speeds, strict=True) if after >= 0.0)
    assert all(fall <= 0.8 * 0.05 + 1e-9 for fall, after in zip(falls, speeds, strict=True) if after < 0.0)


@pytest.mark.pybullet
@pytest.mark.parametrize("radius_m", [0.05, 0.105, 0.3, 0.5, 1.0])
@pytest.mark.parametrize(("v_m_s", "brake_m_s2"), [(0.22, 1.0), (0.22, 4.0), (1.0, 1.0), (1.0, 4.0), (3.0, 4.0)])
@pytest.mark.parametrize("turn_rad_s", [0.0, 1.0])
def test_rigid_bodies_of_every_size_brake_and_speed_up_as_promised(
    radius_m: float, v_m_s: float, brake_m_s2: float, turn_rad_s: float
) -> None:
    figures = {"v_max_m_s": v_m_s, "brake_m_s2": brake_m_s2, "accel_m_s2": 4.0, "yaw_rate_max_rad_s": 6.0}
    noise_m_s = PyBulletBackend.robot_class.declared.speed_noise_m_s or 0.0
    with World(empty(), [promising(RobotSpec(1, 5.0, 5.0, 0.3), radius_m, **figures)], "pybullet") as world:

        def speed_m_s(at_s: float) -> float:
            world.advance(at_s)
            return math.hypot(*world.engine.velocity(0))

        world.set_control(1, constant(v_m_s))
        for period in range(1, 31):
            assert speed_m_s(0.05 * period) <= 4.0 * 0.05 * period + noise_m_s
        world.set_control(1, constant(v_m_s, turn_rad_s))
        began_m_s, before = speed_m_s(1.6), (world.bodies.x[0], world.bodies.y[0])
        assert began_m_s <= v_m_s + noise_m_s
        world.set_control(1, None)
        for period in range(1, 21):
            most_m_s = max(began_m_s - brake_m_s2 * 0.05 * period, 0.0)
            assert speed_m_s(1.6 + 0.05 * period) <= most_m_s + noise_m_s
        assert math.dist(before, (world.bodies.x[0], world.bodies.y[0])) <= v_m_s**2 / (2.0 * brake_m_s2)
