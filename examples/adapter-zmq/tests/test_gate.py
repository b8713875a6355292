from __future__ import annotations

from soter_zmq.gate import Gate
from soter_zmq.wire import LEASE_S, Command, GoalMessage

SC_GOAL = GoalMessage(1, "SC", 1.0, 1.0, None, None)
AC_GOAL = GoalMessage(2, "AC", 2.0, 2.0, None, None)


def driven(now_s: float = 10.0) -> Gate:
    """A gate that passes the AC's goal, renewed just now."""
    gate = Gate()
    assert gate.take(Command("me", 1, now_s, "AC", AC_GOAL), now_s)
    return gate


def test_nothing_passes_without_a_lease() -> None:
    gate = Gate()
    assert gate.take(Command("me", 1, None, "SC", SC_GOAL), 0.0)
    assert gate.passing(0.0) is None


def test_a_goal_passes_until_the_lease_is_dead_and_again_when_it_is_renewed() -> None:
    gate = driven()
    assert gate.passing(10.0 + 0.9 * LEASE_S) == AC_GOAL
    assert gate.passing(10.0 + LEASE_S) is None
    gate.take(Command("me", 2, 11.0, "AC", AC_GOAL), 11.0)
    assert gate.passing(11.0) == AC_GOAL


def test_a_lease_counts_from_when_it_was_sent_and_never_from_the_future() -> None:
    gate = driven()
    gate.take(Command("me", 2, 10.0, "AC", AC_GOAL), 10.0 + LEASE_S)
    assert gate.passing(10.0 + LEASE_S) is None
    gate.take(Command("me", 3, 99.0, "AC", AC_GOAL), 11.0)
    assert gate.passing(11.0 + LEASE_S) is None


def test_an_old_renewal_does_not_shorten_the_lease() -> None:
    gate = driven()
    gate.take(Command("me", 2, 9.0, "AC", AC_GOAL), 10.0)
    assert gate.passing(10.0 + 0.9 * LEASE_S) == AC_GOAL


def test_who_is_not_in_charge_moves_nothing() -> None:
    gate = driven()
    gate.take(Command("me", 2, 10.0, "AC", SC_GOAL), 10.0)
    assert gate.passing(10.0) == AC_GOAL


def test_a_change_of_hands_flushes_what_was_in_flight() -> None:
    gate = driven()
    gate.take(Command("me", 2, 10.0, "SC", AC_GOAL), 10.0)
    assert (gate.controller, gate.goal) == ("SC", None)


def test_a_change_there_and_back_that_was_never_seen_flushes_too() -> None:
    gate = driven()
    gate.take(Command("me", 4, 10.0, "AC", None), 10.0)
    assert gate.goal is None


def test_what_comes_twice_or_too_late_changes_nothing() -> None:
    gate = driven()
    gate.take(Command("me", 3, 10.0, "SC", None), 10.0)
    assert not gate.take(Command("me", 2, 10.0, "AC", AC_GOAL), 10.0)
    assert not gate.take(Command("me", 3, 10.0, "AC", AC_GOAL), 10.0)
    assert gate.passing(10.0) is None


def test_somebody_else_is_heard_only_when_the_lease_is_dead() -> None:
    gate = driven()
    other = Command("other", 1, None, "SC", None)
    assert not gate.take(other, 10.0 + 0.5 * LEASE_S)
    assert gate.take(other, 10.0 + LEASE_S)
    assert (gate.session, gate.controller, gate.goal) == ("other", "SC", None)


def test_another_session_inherits_no_lease() -> None:
    gate = driven()
    assert gate.take(Command("other", 1, None, "AC", AC_GOAL), 10.0 + LEASE_S)
    assert gate.passing(10.0 + LEASE_S) is None
