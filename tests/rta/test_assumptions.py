"""Every assumption is attacked: its monitor says so by number, and the robot goes to its safe controller."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import accumulate
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import (
    SUPERVISOR,
    Assumption,
    AssumptionLog,
    DischargeBound,
    PeerMonitor,
    RobotSupervisor,
    Timing,
    Worst,
)
from soter.rta.assumptions import SPELL_S
from soter.sdk import Controller
from soter.stack.battery import Dock
from soter.stack.monitors import ChargeMonitor, ContractMonitor
from tests.rta.alarms import ALARM_TICKS, SILENT_S, V_MAX, fleet, found, put, recovers, report, started
from tests.rta.doubles import SPEED, TICK_S, At, Rig

# --- the table ---------------------------------------------------------------------------------------------


def test_the_numbers_are_stable_and_every_assumption_says_what_it_is_and_what_watches_it() -> None:
    assert [each.id for each in Assumption] == [f"A{number}" for number in range(1, 17)]
    for assumption in Assumption:
        assert Assumption[assumption.name] is assumption
        assert str(assumption) == assumption.id
        for text in (assumption.statement, assumption.monitor):
            assert re.fullmatch(r"[A-Z].*[a-z0-9)]\.", text), text
            assert len(text) > 30


def test_a_log_counts_and_keeps_the_first_cause() -> None:
    log = AssumptionLog()
    log.note(Assumption.BRAKING, 3.0, "first")
    log.note(Assumption.MOTION, 4.0, "other")
    log.note(Assumption.BRAKING, 5.0, "second")
    assert list(log.breaches) == [Assumption.BRAKING, Assumption.MOTION]
    assert log.breaches[Assumption.BRAKING] == (2, 3.0, "first", 5.0, ())


LOOKS = st.lists(
    st.tuples(
        st.floats(0.05, 5.0),
        st.one_of(st.floats(-1.0, 10.0), st.just(math.nan), st.just(math.inf)),
        st.sampled_from(["m", "s"]),
    ),
    min_size=1,
    max_size=30,
)


@given(LOOKS)
def test_of_any_looks_the_log_keeps_number_first_last_and_the_worst_of_every_unit(
    looks: list[tuple[float, float, str]],
) -> None:
    log, times_s = AssumptionLog(), list(accumulate(gap_s for gap_s, _, _ in looks))
    for time_s, (_, excess, unit) in zip(times_s, looks, strict=True):
        log.note(Assumption.RECOVERY, time_s, f"at {time_s}", excess, unit)
    breach = log.breaches[Assumption.RECOVERY]
    assert breach[:4] == (len(looks), times_s[0], f"at {times_s[0]}", times_s[-1])
    measured = {unit: [each for _, each, its in looks if its == unit and math.isfinite(each)] for unit in ("m", "s")}
    assert {each.unit: each.excess for each in breach.worst} == {
        unit: max(found) for unit, found in measured.items() if found
    }
    assert all(each.cause == f"at {each.time_s}" for each in breach.worst)
    began = max((at for at in range(1, len(looks)) if times_s[at] - times_s[at - 1] > SPELL_S), default=0)
    spell = log.spells[Assumption.RECOVERY]
    assert (spell.times, spell.first_s, spell.last_s) == (len(looks) - began, times_s[began], times_s[-1])


# --- A1, A6: where the robot is ----------------------------------------------------------------------------


def test_a1_a_robot_that_is_faster_than_its_model() -> None:
    rig = started()
    for step in range(1, 4):
        put(rig, 10.0 + 0.3 * step * TICK_S, vx_m_s=0.3)
        rig.tick()
    cause = found(rig, Assumption.MOTION)
    assert "outside the reach set of SpeedBound: 0.015 m in 0.050 s at no more than 0.300 m/s" in cause
    breach = rig.robot.log.breaches[Assumption.MOTION]
    assert breach.times == 3
    assert breach.worst[0].unit == "m"
    assert breach.worst[0].excess == pytest.approx((0.3 - V_MAX) * TICK_S, abs=1e-6)
    recovers(rig)


def test_a6_a_robot_that_is_elsewhere_at_once() -> None:
    rig = started()
    put(rig, 10.5, vx_m_s=0.2)
    rig.tick()
    assert "0.500 m in 0.050 s at no more than 0.200 m/s" in found(rig, Assumption.POSITION_NOISE)
    recovers(rig)


def test_a6_noise_as_declared_is_no_breach() -> None:
    rig = started(noise_m=0.05)
    for sign in (1.0, -1.0) * 20:
        put(rig, 10.0 + sign * 0.05)
        rig.tick()
        assert rig.robot.mode is Controller.AC
    put(rig, 10.2)
    rig.tick()
    found(rig, Assumption.POSITION_NOISE)


# --- A4, A15: when it was ----------------------------------------------------------------------------------


def test_a4_a_sample_that_is_too_old() -> None:
    rig = started(timing=Timing(latency_s=0.05, sample_age_s=0.1))
    rig.fresh = False
    rig.tick(4)
    assert "sample is 0.150 s old, declared at most 0.100 s" in found(rig, Assumption.SAMPLE_AGE)
    rig.fresh = True
    recovers(rig)


@pytest.mark.parametrize("sample", [OSError("link lost"), At(math.nan), At(math.inf), At(10.0, stamp_s=math.nan)])
def test_a4_no_sample_or_one_that_is_not_finite(sample: At | Exception) -> None:
    rig = started()
    rig.fresh = False
    rig.actuator.sample = sample
    rig.tick()
    assert "no state" in found(rig, Assumption.SAMPLE_AGE)
    put(rig)
    rig.fresh = True
    recovers(rig)


def test_a15_a_clock_that_goes_back() -> None:
    rig = started("a", "b")
    rig.tick(40)
    rig.ticks -= 20
    rig.fresh = False
    rig.actuator.sample = At(10.0, stamp_s=rig.now_s)
    rig.tick()
    # The clock and, with it, the stamps of the samples.
    assert list(rig.robot.log.breaches) == [Assumption.CLOCK]
    assert rig.robot.log.breaches[Assumption.CLOCK].cause == "fleet time went back by 0.950 s"
    assert rig.robot.mode is Controller.SC
    rig.fresh = True
    recovers(rig)


def test_a15_after_a_clock_went_back_a_dwell_begins_anew_instead_of_lasting_for_ever() -> None:
    rig = started()
    rig.tick(400)
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.rules["a"].value = 10.0
    rig.ticks -= 300
    rig.tick(ALARM_TICKS + 3)
    assert rig.robot.mode is Controller.AC


def test_a15_a_sample_from_the_future() -> None:
    rig = started()
    rig.fresh = False
    put(rig, stamp_s=rig.now_s + 0.05)
    rig.tick()
    assert rig.robot.log.breaches == {}, "a clock that is a little fast is none that is wrong"
    put(rig, stamp_s=rig.now_s + 5.0)
    rig.tick()
    assert "stamped 5.000 s ahead of the clock" in found(rig, Assumption.CLOCK)


def test_a15_stamps_that_go_back() -> None:
    rig = started(timing=Timing(latency_s=0.05, sample_age_s=10.0))
    rig.fresh = False
    put(rig, x_m=12.0, stamp_s=rig.now_s - 0.3)
    rig.tick()
    assert "stamps went back by 0.250 s" in found(rig, Assumption.CLOCK)


def test_a16_a_safe_controller_that_does_not_let_go() -> None:
    own, dock = Rig("own", "battery"), SimpleNamespace(wants_charge=True, docked=lambda _: False)
    robot, monitor = own.robot, ContractMonitor({1: 0.02})
    assert robot.driver is not None
    robot.driver.module = replace(robot.driver.module, lets_go_s=30.0)  # type: ignore[misc]
    for now_s in (0.0, 30.0):
        monitor.look(now_s, {1: robot}, {1: cast("Dock", dock)})
    assert robot.log.breaches == {}
    monitor.look(31.0, {1: robot}, {1: cast("Dock", dock)})
    breach = robot.log.breaches[Assumption.CONTRACT]
    assert breach.cause == "'own' has kept the robot from charging for 31.0 s, at most 30 s"
    assert [(worst.excess, worst.unit) for worst in breach.worst] == [(1.0, "s")]
    # Once it need not charge any more, and wherever it moves, nothing is kept from it.
    dock.wants_charge = False
    monitor.look(32.0, {1: robot}, {1: cast("Dock", dock)})
    dock.wants_charge = True
    monitor.look(62.0, {1: robot}, {1: cast("Dock", dock)})
    assert robot.log.breaches[Assumption.CONTRACT].times == 1


def test_a16_a_safe_controller_that_fails() -> None:
    rig = Rig("own")

    def fails(situation: object) -> None:
        raise RuntimeError("no way out")

    rig.rules["own"].value = 0.0
    rig.scs["own"].step = fails  # type: ignore[method-assign]
    for _ in range(3):
        rig.tick()
    breach = rig.robot.log.breaches[Assumption.CONTRACT]
    assert breach.times == 3
    assert "'own' failed: RuntimeError('no way out') (test_assumptions.py, line " in breach.cause
    assert not rig.robot.ac_failure


@pytest.mark.parametrize(("missed", "assumption"), [(1, Assumption.JITTER), (5, Assumption.SCHEDULING)])
def test_a5_a11_a_look_that_comes_late(missed: int, assumption: Assumption) -> None:
    rig = started(timing=Timing(latency_s=0.05, jitter_s=0.02, lease_s=0.1))
    rig.ticks += missed
    rig.tick()
    assert f"'a' looked after {(missed + 1) * TICK_S:.3f} s, not 0.05 s" in found(rig, assumption)
    recovers(rig)


def test_a5_a_tick_that_is_as_late_as_declared_is_no_breach() -> None:
    rig = started(timing=Timing(latency_s=0.05, jitter_s=TICK_S))
    for _ in range(20):
        rig.ticks += 1
        rig.tick()
        assert rig.robot.mode is Controller.AC


# --- A7: peers ---------------------------------------------------------------------------------------------


def test_a7_a_peer_that_breaks_its_bound_costs_those_who_hear_it_control_and_is_named() -> None:
    supervisor, rigs = fleet()
    report(rigs, 20, r2=12.5)
    supervisor.tick(20 * TICK_S)
    for rig in (rigs[0], rigs[2]):
        assert rig.robot.mode is Controller.SC
        assert list(rig.robot.log.breaches) == [Assumption.PEERS]
        assert rig.robot.log.breaches[Assumption.PEERS].cause.startswith("robot 2: sample outside the reach set")
        assert rig.watch.records[-1].module == SUPERVISOR
        assert "A7: robot 2" in rig.watch.records[-1].cause
    assert list(rigs[1].robot.log.breaches) == [Assumption.POSITION_NOISE], "it is told apart by the robot itself"
    for tick in range(21, 40):
        report(rigs, tick, r2=12.5)
        supervisor.tick(tick * TICK_S)
    assert [rig.driver() for rig in rigs] == [None, None, None]


def test_a7_a_peer_that_falls_silent_is_named() -> None:
    supervisor, rigs = fleet()
    for tick in range(20, 40):
        report(rigs, tick)
        rigs[2].actuator.sample = At(13.0, stamp_s=19 * TICK_S, robot_id=3)
        supervisor.tick(tick * TICK_S)
        silent_s = (tick - 19) * TICK_S
        assert (rigs[0].robot.mode is Controller.SC) is (silent_s > SILENT_S + 1e-9)
    assert "robot 3: not heard of for 0.5" in rigs[0].robot.log.breaches[Assumption.PEERS].cause


def test_a7_peers_that_keep_to_their_bound_cost_nothing() -> None:
    supervisor, rigs = fleet()
    for tick in range(20, 100):
        report(rigs, tick, r2=12.0 + V_MAX * (tick - 19) * TICK_S)
        supervisor.tick(tick * TICK_S)
        assert [rig.driver() for rig in rigs] == [None, None, None]


def test_a7_a_robot_alone_distrusts_nobody() -> None:
    monitor = PeerMonitor({1: (SPEED, 0.0), 2: (SPEED, 0.0)}, SILENT_S)
    assert monitor.look(0.0, []) == {}
    assert monitor.look(0.0, [At()]) == {}
    assert set(monitor.look(1.0, [At(x_m=5.0, stamp_s=1.0)])) == {1}


# --- A8, A9, A13, A14: what margins are made of ------------------------------------------------------------


@pytest.mark.parametrize(("battery", "holds"), [(0.99999, True), (0.9, False), (None, False)])
def test_a8_a_charge_that_falls_faster_than_the_model(battery: float | None, holds: bool) -> None:
    rig = Rig("a", models=[SPEED, DischargeBound(1.0 / 1800.0, V_MAX, 0.002)])
    rig.start()
    put(rig, battery=battery)
    rig.tick()
    if holds:
        assert rig.robot.log.breaches == {}
    else:
        assert "reach set of DischargeBound" in found(rig, Assumption.DISCHARGE)


def test_a8_a_charge_that_stands_while_the_robot_drives() -> None:
    now_s, log, monitor = 0.0, AssumptionLog(), ChargeMonitor()
    docks = {1: cast("Dock", SimpleNamespace(cost_per_m=0.01))}

    def drives(metres: float, *, charge: float, speed_m_s: float = 0.2) -> bool:
        nonlocal now_s
        log.breaches.clear()
        for _ in range(10):
            now_s += metres / 0.2 / 10
            own = SimpleNamespace(battery=charge, vx_m_s=speed_m_s, vy_m_s=0.0, stamp_s=now_s)
            robot = SimpleNamespace(situation=SimpleNamespace(own=own), log=log)
            monitor.look(now_s, {1: cast("RobotSupervisor", robot)}, docks)
        return Assumption.DISCHARGE in log.breaches

    assert not drives(4.9, charge=0.6)
    assert drives(1.0, charge=0.6)
    assert "the charge has not fallen from 0.60 in" in log.breaches[Assumption.DISCHARGE].cause
    # In steps of whole percents it falls often enough, it may be charged, and a robot that stands proves nothing.
    assert not any(drives(4.0, charge=charge) for charge in (0.59, 0.58, 0.9))
    assert not drives(50.0, charge=0.9, speed_m_s=0.0)


def test_a9_a_margin_that_falls_although_the_robot_has_not_moved() -> None:
    rig = started()
    rig.rules["a"].value = 9.0
    rig.tick()
    assert "'a': the margin fell by 1.000 within 0.050 s" in found(rig, Assumption.WORKSPACE)
    recovers(rig)


def test_a9_a_margin_that_falls_as_fast_as_the_robot_moves_is_no_breach() -> None:
    rig = started()
    value = 10.0
    for _ in range(40):
        value -= SPEED.bound(TICK_S)
        rig.rules["a"].value = value
        rig.tick()
    assert rig.robot.log.breaches == {}


def test_a13_a_robot_that_starts_outside() -> None:
    rig = Rig("a")
    rig.rules["a"].value = -0.5
    rig.tick(5)
    assert rig.robot.mode is Controller.SC
    breach = rig.robot.log.breaches[Assumption.START]
    assert breach[:3] == (1, 0.0, "'a': margin -0.500")
    assert breach.worst == (Worst(0.5, "m", 0.0, "'a': margin -0.500"),)


def test_a14_a_margin_that_is_used_up_under_the_safe_controller() -> None:
    rig = started()
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.robot.log.breaches.clear()
    rig.rules["a"].value = -0.001
    rig.tick(3)
    assert list(rig.robot.log.breaches) == [Assumption.RECOVERY]
    assert rig.robot.log.breaches[Assumption.RECOVERY].times == 3
    assert rig.driver() == "a"
