"""Charge: what uses it, what gains it, and what happens at 0."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from soter.geometry.workspace import Box
from soter_sim import LIMITS, World
from tests.sim.worlds import constant, empty, specs

ENGINES = [pytest.param("kinematic"), pytest.param("pybullet", marks=pytest.mark.pybullet)]
PATCH = Box(4.5, 4.5, 5.5, 5.5)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("v", "yaw_rate", "per_s"),
    [
        (0.0, 0.0, 1 / 7200),
        (LIMITS.v_max_m_s, 0.0, 1 / 1800),
        (-LIMITS.v_max_m_s, 0.0, 1 / 1800),
        (0.0, LIMITS.yaw_rate_max_rad_s, 1 / 1800),
        (LIMITS.v_max_m_s / 2, 0.3, (1 / 7200 + 1 / 1800) / 2),
    ],
)
def test_charge_falls_with_what_the_motors_do(engine: str, v: float, yaw_rate: float, per_s: float) -> None:
    with World(empty(), specs((10.0, 10.0, 0.0)), engine) as world:
        world.set_control(1, constant(v, yaw_rate))
        world.advance(2.0)
        before = world.bodies.charge[0]
        world.advance(12.0)
        assert before - world.bodies.charge[0] == pytest.approx(10 * per_s, rel=1e-3)


def test_two_hours_idle_empty_it_and_a_minute_fills_it() -> None:
    world = World(empty(20, 20, PATCH), specs((10.0, 10.0, 0.0), (5.0, 5.0, 0.0), battery=0.0))
    world.advance(59.0)
    assert world.bodies.charge == [0.0, pytest.approx(59 / 60)]
    world.advance(61.0)
    assert world.bodies.charge[1] == 1.0
    world = World(empty(), specs((10.0, 10.0, 0.0)))
    world.advance(7199.0)
    assert world.bodies.charge[0] > 0.0
    world.advance(7201.0)
    assert world.bodies.charge[0] == 0.0
    (only,) = world.truth.report().violations
    assert (only.rule, only.robots, only.end_s) == ("battery", (1,), None)
    assert only.start_s == pytest.approx(7200.0, abs=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_without_charge_the_motors_are_off(engine: str) -> None:
    with World(empty(), specs((10.0, 10.0, 0.0), battery=1e-3), engine) as world:
        world.set_control(1, constant(LIMITS.v_max_m_s))
        world.advance(4.0)
        start_s = world.truth.report().violations[0].start_s
        assert 1.8 <= start_s <= 2.1
        assert world.bodies.v[0] == pytest.approx(0.0, abs=1e-3)
        stopped = world.bodies.x[0]
        world.advance(5.0)
        assert world.bodies.x[0] == pytest.approx(stopped, abs=1e-4)
        assert world.truth.report().min_margin["battery"] == 0.0


def test_it_charges_on_any_charger_and_only_there() -> None:
    far = Box(9.9, 9.9, 10.1, 10.1)
    world = World(empty(20, 20, PATCH, far), specs((10.0, 10.0, 0.0), (5.0, 5.5, 0.0), (5.0, 5.6, 0.0), battery=0.5))
    world.advance(6.0)
    gained = 0.5 + 6 / 60
    assert world.bodies.charge == pytest.approx([gained, gained, 0.5 - 6 / 7200])


@pytest.mark.parametrize("engine", ENGINES)
def test_it_does_not_charge_while_it_drives_across_a_charger(engine: str) -> None:
    with World(empty(20, 20, PATCH), specs((4.0, 5.0, 0.0), battery=0.5), engine) as world:
        world.set_control(1, constant(LIMITS.v_max_m_s))
        world.advance(3.0)
        before = world.bodies.charge[0]
        while world.bodies.x[0] < 5.4:
            world.advance(world.now_s + 0.05)
            assert world.bodies.charge[0] < before
            before = world.bodies.charge[0]
        world.set_control(1, None)
        world.advance(world.now_s + 0.5)
        resting = world.bodies.charge[0]
        world.advance(world.now_s + 6.0)
        assert world.bodies.x[0] < 5.5
        assert world.bodies.charge[0] == pytest.approx(resting + 6 / 60)


@pytest.mark.parametrize("engine", ENGINES)
def test_it_is_flat_if_it_rolls_off_a_charger_with_its_last_charge(engine: str) -> None:
    with World(empty(20, 20, PATCH), specs((5.45, 5.0, 0.0), battery=1.2e-4), engine) as world:
        world.set_control(1, constant(LIMITS.v_max_m_s))
        world.advance(3.0)
        assert world.bodies.x[0] > 5.5
        (only,) = world.truth.report().violations
        assert (only.rule, only.end_s) == ("battery", None)
        assert only.start_s > 0.1


def test_each_robot_has_a_battery_of_its_own() -> None:
    fast, slow = specs((5.0, 5.0, 0.0), (10.0, 10.0, 0.0), battery=0.5)
    world = World(empty(), [replace(fast, drive_s=60.0, idle_s=100.0), replace(slow, idle_s=3600.0)])
    world.advance(10.0)
    assert world.bodies.charge == pytest.approx([0.4, 0.5 - 10 / 3600])


@pytest.mark.parametrize("wrong", [{"drive_s": 0.0}, {"idle_s": 60.0}, {"charge_s": float("inf")}])
def test_a_battery_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    (spec,) = specs((5.0, 5.0, 0.0))
    with pytest.raises(ValueError, match="robot 1 has a battery of"):
        World(empty(), [replace(spec, **wrong)])


def test_flat_on_a_charger_is_no_violation() -> None:
    world = World(empty(20, 20, PATCH), specs((5.0, 5.0, 0.0), battery=0.0))
    world.advance(1.0)
    assert world.truth.report().violations == ()


def test_flat_elsewhere_counts_from_time_0() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), battery=0.0))
    (only,) = world.truth.report().violations
    assert (only.rule, only.start_s) == ("battery", 0.0)
