from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.onboard.velocity import Velocity, VelocityGate
from soter.onboard.wire import AC, SC, SEQ_MOST, GateReport, Order

FORWARDS = Velocity(0.2, 0.0)


def gate(lease_s: float = 0.13, command_s: float = 0.25) -> VelocityGate:
    return VelocityGate(lease_s, command_s, 0.22, 2.84)


def order(seq: int, controller: str = SC, renewed_s: float | None = 0.0, session: str = "one") -> Order:
    return Order(session, seq, controller, renewed_s)


def test_nothing_passes_before_the_first_order() -> None:
    mux = gate()
    assert mux.give(SC, FORWARDS, 0.0)
    assert mux.passing(0.0) is None
    assert mux.report(0.0) == GateReport("", 0, SC, False)


def test_the_controller_in_charge_passes_while_the_lease_lives() -> None:
    mux = gate()
    assert mux.take(order(1, AC), 0.0, 10.0)
    assert mux.give(AC, FORWARDS, 10.0)
    assert not mux.give(SC, Velocity(-0.1), 10.0)
    assert mux.passing(10.12) == FORWARDS
    assert mux.passing(10.13) is None
    assert not mux.report(10.13).alive


def test_a_change_of_hands_drops_what_the_other_asked_for() -> None:
    mux = gate()
    mux.take(order(1, AC), 0.0, 0.0)
    mux.give(AC, FORWARDS, 0.0)
    mux.take(order(2, SC), 0.0, 0.01)
    assert mux.passing(0.01) is None
    mux.take(order(3, AC), 0.0, 0.02)
    assert mux.passing(0.02) is None, "nothing is revived"


def test_a_renewal_counts_from_when_it_was_sent() -> None:
    mux = gate()
    mux.take(order(1), 0.1, 5.0)
    mux.give(SC, FORWARDS, 5.0)
    assert mux.passing(5.02) == FORWARDS
    assert mux.passing(5.04) is None


def test_a_sender_ahead_of_the_robots_clock_gets_no_longer_lease() -> None:
    mux = gate()
    mux.take(order(1), -100.0, 5.0)
    mux.give(SC, FORWARDS, 5.0)
    assert mux.passing(5.12) is not None
    assert mux.passing(5.13) is None


def test_without_a_clock_nothing_is_renewed() -> None:
    mux = gate()
    assert mux.take(order(1), None, 5.0)
    mux.give(SC, FORWARDS, 5.0)
    assert mux.passing(5.0) is None


def test_what_comes_twice_or_late_changes_nothing() -> None:
    mux = gate()
    mux.take(order(2, AC), 0.0, 0.0)
    assert not mux.take(order(2, SC), 0.0, 0.0)
    assert not mux.take(order(1, SC), 0.0, 0.0)
    assert mux.report(0.0).controller == AC


@pytest.mark.parametrize("forged", [1002, SEQ_MOST])
def test_a_forged_number_shuts_nobody_out(forged: int) -> None:
    mux = gate()
    assert mux.take(order(1, AC), 0.0, 0.0)
    # While the lease lives so many cannot have been missed;
    assert not mux.take(order(forged), 0.0, 0.1)
    assert mux.take(order(2), 0.0, 0.1)
    # after it, such a number is taken, and that of the program that gives the orders counts again after a second.
    assert mux.take(order(forged), 0.0, 0.3)
    assert not mux.take(order(3), 0.0, 0.35)
    assert not mux.take(order(4), 0.0, 1.29)
    assert not mux.take(order(forged), 0.0, 1.3), "the last one again is no new beginning"
    assert mux.take(order(5, AC), 0.0, 1.3)
    assert mux.report(1.3) == GateReport("one", 5, AC, True)


def test_orders_that_come_late_after_the_end_change_nothing() -> None:
    mux = gate()
    mux.take(order(8, AC), 0.0, 0.0)
    mux.take(order(9, SC, renewed_s=None), None, 0.05)
    assert not mux.take(order(8, AC), 0.05, 0.1)
    assert mux.report(0.1) == GateReport("one", 9, SC, False)


def test_an_older_renewal_does_not_shorten_a_lease() -> None:
    mux = gate()
    mux.take(order(1), 0.0, 1.0)
    mux.take(order(2), 0.1, 1.01)
    mux.give(SC, FORWARDS, 1.1)
    assert mux.passing(1.12) is not None


def test_another_program_is_followed_only_when_the_lease_is_dead() -> None:
    mux = gate()
    mux.take(order(7, AC), 0.0, 0.0)
    assert not mux.take(order(1, SC, session="two"), 0.0, 0.1)
    assert mux.take(order(1, SC, session="two"), 0.0, 0.2)
    assert mux.report(0.2) == GateReport("two", 1, SC, True)


def test_another_program_does_not_revive_what_the_one_before_asked_for() -> None:
    mux = gate()
    mux.take(order(1, SC), 0.0, 0.0)
    mux.give(SC, FORWARDS, 0.1)
    assert mux.take(order(1, SC, session="two"), 0.0, 0.14)
    assert mux.report(0.14).alive
    assert mux.passing(0.14) is None, "whoever renews now has not judged that"
    mux.give(SC, FORWARDS, 0.15)
    assert mux.passing(0.15) == FORWARDS


def test_an_order_can_end_the_lease() -> None:
    mux = gate()
    mux.take(order(1), 0.0, 0.0)
    mux.give(SC, FORWARDS, 0.0)
    mux.take(order(2, renewed_s=None), None, 0.01)
    assert mux.passing(0.01) is None
    assert not mux.report(0.01).alive


def test_a_controller_that_falls_silent_stops_the_robot() -> None:
    mux = gate(lease_s=10.0, command_s=0.25)
    mux.take(order(1), 0.0, 0.0)
    mux.give(SC, FORWARDS, 0.0)
    assert mux.passing(0.24) is not None
    assert mux.passing(0.25) is None


@given(st.floats(), st.floats())
def test_whatever_is_asked_for_what_passes_is_within_the_limits(forward_m_s: float, turn_rad_s: float) -> None:
    mux = gate()
    mux.take(order(1, AC), 0.0, 0.0)
    mux.give(AC, Velocity(forward_m_s, turn_rad_s), 0.0)
    passed = mux.passing(0.0)
    assert passed is not None
    assert abs(passed.forward_m_s) <= 0.22
    assert abs(passed.turn_rad_s) <= 2.84
    if not math.isfinite(forward_m_s) or not math.isfinite(turn_rad_s):
        assert passed == Velocity(0.0, 0.0)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_must_be_limits(value: float) -> None:
    with pytest.raises(ValueError, match=r"v_max_m_s is .*, allowed: finite and above 0"):
        VelocityGate(0.1, 0.1, value, 1.0)
    with pytest.raises(ValueError, match=r"yaw_rate_max_rad_s is .*, allowed: finite and above 0"):
        VelocityGate(0.1, 0.1, 1.0, value)
