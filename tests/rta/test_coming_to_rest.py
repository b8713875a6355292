"""A robot that does not come to rest as its model says is found out by number, and loses its AC."""

from __future__ import annotations

import pytest

from soter.errors import Intruder, Uncontrolled
from soter.rta import (
    Assumption,
    Timing,
)
from soter.sdk import Controller
from tests.rta.alarms import V_MAX, fleet, put, recovers, report, started
from tests.rta.doubles import SPEED, TICK_S, Rig

WITHIN_M = SPEED.bound(0.05)


def rolling(rig: Rig, speed: float, x_m: float) -> None:
    """Tick with the robot at a place, at a speed."""
    put(rig, x_m, vx_m_s=speed)
    rig.tick()


def disengaged_at_speed(timing: Timing | None = None) -> Rig:
    """Return a rig whose robot has just been told to stop, at top speed, by a safe controller that holds."""
    rig = started(timing=timing)
    rig.scs["a"].silent = True
    rig.rules["a"].value = 0.0
    rolling(rig, V_MAX, 10.0)
    assert rig.robot.mode is Controller.SC
    rig.robot.log.breaches.clear()
    return rig


def test_a2_a_robot_that_brakes_too_weakly() -> None:
    """Of a speed of which nothing is promised a tenth is taken for noise: brakes that are 20 % too good are seen."""
    rig = disengaged_at_speed()
    speed, x_m, looks = V_MAX, 10.0, 0
    while not rig.robot.log.breaches:
        x_m += speed * TICK_S
        speed = max(0.0, speed - TICK_S / 1.2)
        rolling(rig, speed, x_m)
        looks += 1
    (breach,) = rig.robot.log.breaches.items()
    assert breach[0] is Assumption.BRAKING
    assert (breach[1].worst[0].unit, looks <= V_MAX / TICK_S + 1) == ("m/s", True)


def test_a2_a_robot_that_gets_farther_than_braking_takes() -> None:
    rig = disengaged_at_speed()
    speed, x_m = V_MAX, 10.0
    while x_m - 10.0 <= WITHIN_M:
        assert rig.robot.log.breaches == {}
        x_m += V_MAX * TICK_S
        speed = max(0.01, speed - TICK_S)
        rolling(rig, speed, x_m)
    (assumption,) = rig.robot.log.breaches
    assert assumption is Assumption.BRAKING
    cause = rig.robot.log.breaches[assumption].cause
    assert f"at most {WITHIN_M:.3f} m" in cause
    assert cause.startswith("told to stop")


def test_a2_a_robot_that_brakes_as_promised_is_no_breach() -> None:
    rig = disengaged_at_speed()
    # One period of latency, then 1.0 m/s2.
    x_m, speed = 10.0 + V_MAX * TICK_S, V_MAX
    rolling(rig, speed, x_m)
    while speed > 0.0:
        slower = max(0.0, speed - TICK_S)
        x_m += (speed * speed - slower * slower) / 2.0
        speed = slower
        rolling(rig, speed, x_m)
    rig.tick(100)
    assert rig.robot.log.breaches == {}


def test_a3_a_robot_that_does_not_act_on_a_command() -> None:
    rig = disengaged_at_speed()
    for step in range(1, 10):
        rolling(rig, V_MAX, 10.0 + V_MAX * step * TICK_S)
    (assumption,) = rig.robot.log.breaches
    assert assumption is Assumption.LATENCY
    assert rig.robot.log.breaches[assumption].times == 2, "it is judged anew from where it was found"


def test_a3_a_robot_that_may_move_again_is_not_watched() -> None:
    rig = disengaged_at_speed()
    rig.scs["a"].silent = False
    for step in range(1, 50):
        rolling(rig, V_MAX, 10.0 + V_MAX * step * TICK_S)
    assert rig.robot.log.breaches == {}


@pytest.mark.parametrize("call", ["drive", "renew", "hand_over"])
def test_a3_an_interface_that_raises(call: str) -> None:
    rig = started()
    rig.actuator.failing.add(call)
    if call == "hand_over":
        rig.rules["a"].value = 0.0
    rig.tick(2)
    assert "OSError" in rig.robot.log.breaches[Assumption.LATENCY].cause
    assert rig.robot.mode is Controller.SC


def test_a10_a_robot_that_drives_on_without_a_lease() -> None:
    timing = Timing(latency_s=0.05, lease_s=0.1)
    rig = started(timing=timing)
    rig.actuator.failing.add("drive")
    within_m = SPEED.bound(0.15)
    for step in range(40):
        rolling(rig, V_MAX, 10.0 + V_MAX * step * TICK_S)
        if Assumption.LEASE in rig.robot.log.breaches:
            break
    assert "its lease was withheld" in rig.robot.log.breaches[Assumption.LEASE].cause
    assert V_MAX * (step - 1) * TICK_S <= within_m < V_MAX * step * TICK_S


def test_a12_somebody_else_moves_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = started()

    def renew() -> None:
        raise Intruder("it is driven past the mux")

    with monkeypatch.context() as intruded:
        intruded.setattr(rig.actuator, "renew", renew)
        rig.tick(3)
    assert list(rig.robot.log.breaches) == [Assumption.AUTHORITY]
    assert rig.robot.mode is Controller.SC
    # It was found in acting, and so is the cause of the next decision.
    assert rig.watch.records[0].cause == "A12: intruder: it is driven past the mux"
    recovers(rig)


def test_a12_a_robot_that_does_not_do_what_it_is_told_is_nobodys_and_its_peers_hear_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    supervisor, rigs = fleet()

    def renew() -> None:
        raise Uncontrolled("its pilot has it")

    with monkeypatch.context() as taken:
        taken.setattr(rigs[1].actuator, "renew", renew)
        for tick in range(20, 24):
            report(rigs, tick)
            supervisor.tick(tick * TICK_S)
    assert rigs[1].robot.uncontrolled == "not under control: its pilot has it"
    assert [rig.robot.mode for rig in rigs] == [Controller.SC] * 3
    assert list(rigs[1].robot.log.breaches) == [Assumption.AUTHORITY]
    peers = rigs[0].robot.log.breaches[Assumption.PEERS]
    assert (peers.cause, peers.first_s) == ("robot 2: not under control: its pilot has it", 21 * TICK_S)
    for tick in range(24, 50):
        report(rigs, tick)
        supervisor.tick(tick * TICK_S)
    assert rigs[1].robot.uncontrolled == ""
    assert [rig.driver() for rig in rigs] == [None] * 3


def test_a10_a_robot_that_stops_without_a_lease_is_no_breach() -> None:
    rig = started(timing=Timing(latency_s=0.05, lease_s=0.1))
    rig.actuator.failing.add("drive")
    for _ in range(40):
        rolling(rig, 0.0, 10.0)
    assert list(rig.robot.log.breaches) == [Assumption.LATENCY]
