"""What robots say about themselves when it is not so."""

from __future__ import annotations

import math

import pytest

from soter.sdk import Controller, GoalStatus, Link, Waypoint
from tests.faults.bench import TICK_S, Bench

V_MAX = 0.22
AGAIN = {"start_s": 1.0, "duration_s": 0.2, "every_s": 1.0}


def test_a_frozen_state_stands_still_with_its_stamp() -> None:
    bench = Bench({"kind": "freeze", **AGAIN})
    ages = [round(0.05 * k - state.stamp_s, 9) for k, state in enumerate(bench.seen(60), start=1)]
    assert ages[18:24] == [0.0, 0.05, 0.1, 0.15, 0.2, 0.0]
    assert max(ages) == pytest.approx(bench.robot.capabilities.sample_age_s)


def test_a_frozen_state_with_new_stamps_lies_about_the_place_only() -> None:
    bench = Bench({"kind": "freeze", "restamped": True, **AGAIN})
    for tick in range(1, 61):
        true_m = V_MAX * tick * TICK_S
        state = bench.look(tick * TICK_S, x_m=true_m, battery=1.0 - 0.001 * tick)
        assert state.stamp_s == bench.now_s
        assert state.battery == 1.0 - 0.001 * tick
        assert true_m - state.x_m <= bench.robot.capabilities.position_noise_m + 1e-9
    assert bench.robot.capabilities.position_noise_m == pytest.approx(V_MAX * 0.2)
    assert bench.robot.capabilities.sample_age_s == 0.0


def test_a_state_frozen_for_long_is_stale_and_then_down() -> None:
    bench = Bench({"kind": "freeze", "start_s": 1.0, "declared": False})
    links = {round(0.05 * k, 2): state.link for k, state in enumerate(bench.seen(120), start=1)}
    assert (links[1.0], links[1.6], links[5.0]) == (Link.UP, Link.STALE, Link.DOWN)


def test_a_biased_robot_is_wrong_about_itself_and_about_its_targets() -> None:
    bench = Bench({"kind": "bias", "x_m": 0.3, "y_m": -0.4, "heading_rad": 0.5})
    assert bench.robot.capabilities.position_noise_m == pytest.approx(0.5)
    state = bench.look(1.0, x_m=1.0, y_m=1.0, heading_rad=3.0)
    assert (state.x_m, state.y_m) == pytest.approx((1.3, 0.6))
    assert state.heading_rad == pytest.approx(3.5 - math.tau)
    goal = bench.robot.goto(Waypoint(2.0, 2.0, heading_rad=-3.0), Controller.SC)
    behind = bench.behind.sent[-1].target
    assert (behind.x_m, behind.y_m, behind.heading_rad) == pytest.approx((1.7, 2.4, math.tau - 3.5))
    bench.look(1.05, x_m=1.7, y_m=2.4)
    assert goal.status is GoalStatus.REACHED, "it believes that it is there"


@pytest.mark.parametrize(("step_s", "oldest_s"), [(-0.2, 0.2), (0.08, 0.1)])
def test_a_clock_step_is_paid_for_by_age_and_by_noise(step_s: float, oldest_s: float) -> None:
    bench = Bench({"kind": "clock_step", "step_s": step_s, **AGAIN})
    promised = bench.robot.capabilities
    assert promised.sample_age_s == pytest.approx(oldest_s)
    assert promised.position_noise_m == pytest.approx(V_MAX * abs(step_s))
    before_s = 0.0
    for tick in range(1, 80):
        state = bench.look(tick * TICK_S, x_m=V_MAX * tick * TICK_S)
        age_s = state.age_s(bench.now_s)
        assert age_s <= promised.sample_age_s + 1e-9
        assert state.stamp_s >= before_s, "a stamp never goes back"
        error_m = abs(state.x_m - V_MAX * state.stamp_s)
        assert error_m <= promised.position_noise_m + 1e-9
        before_s = state.stamp_s
    assert bench.robot.discarded > 0


def test_a_clock_far_ahead_is_not_believed() -> None:
    bench = Bench({"kind": "clock_step", "step_s": 5.0, "start_s": 1.0, "declared": False})
    assert bench.seen(100)[-1].link is Link.DOWN


def test_a_charge_is_misreported_within_its_range() -> None:
    bench = Bench({"kind": "battery", "offset": -0.3})
    assert bench.look(1.0, battery=0.8).battery == pytest.approx(0.5)
    assert bench.look(1.05, battery=0.1).battery == 0.0
    assert bench.look(1.1, battery=None).battery is None
    assert bench.robot.capabilities == bench.behind.capabilities


def test_faults_add_up() -> None:
    bench = Bench(
        {"kind": "bias", "x_m": 0.1}, {"kind": "delay", "samples_s": 0.05}, {"kind": "bias", "x_m": 0.1, "robot": 1}
    )
    assert bench.robot.capabilities.position_noise_m == pytest.approx(0.2)
    assert bench.robot.capabilities.sample_age_s == pytest.approx(0.05)
    state = bench.seen(10)[-1]
    assert state.x_m == pytest.approx(0.2 * 0.45 + 0.2)
    assert state.stamp_s == pytest.approx(0.45)
