"""Charge: what uses it, what gains it, and what happens at 0."""

from __future__ import annotations

import pytest

from soter.workspace import Box
from soter_sim import CHARGE_PER_S, LIMITS, World
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
    gained = 0.5 + 6 * CHARGE_PER_S
    assert world.bodies.charge == pytest.approx([gained, gained, 0.5 - 6 / 7200])


@pytest.mark.parametrize("engine", ENGINES)
def test_it_starts_and_stops_charging_when_its_centre_crosses_the_edge(engine: str) -> None:
    with World(empty(20, 20, PATCH), specs((4.0, 5.0, 0.0), battery=0.5), engine) as world:
        world.set_control(1, constant(LIMITS.v_max_m_s))
        charging = []
        before = 0.5
        while world.bodies.x[0] < 6.0:
            x = world.bodies.x[0]
            world.advance(world.now_s + 0.05)
            charge = world.bodies.charge[0]
            if abs(x - 4.5) > 1e-3 and abs(x - 5.5) > 1e-3:
                assert (charge > before) == (4.5 <= x <= 5.5)
            charging.append(charge > before)
            before = charge
        assert any(charging)
        assert not all(charging)


def test_flat_on_a_charger_is_no_violation() -> None:
    world = World(empty(20, 20, PATCH), specs((5.0, 5.0, 0.0), battery=0.0))
    world.advance(1.0)
    assert world.truth.report().violations == ()


def test_flat_elsewhere_counts_from_time_0() -> None:
    world = World(empty(), specs((5.0, 5.0, 0.0), battery=0.0))
    (only,) = world.truth.report().violations
    assert (only.rule, only.start_s) == ("battery", 0.0)
