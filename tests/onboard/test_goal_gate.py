from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from soter.onboard.command import Command, GoalMessage
from soter.onboard.goal_gate import GoalGate

LEASE_S = 0.15
SC_GOAL = GoalMessage(1, "SC", 1.0, 1.0)
AC_GOAL = GoalMessage(2, "AC", 2.0, 2.0)
APART_S = 1000.0
"""The robot's clock is so much ahead of its steady time."""


def say(
    gate: GoalGate, seq: int, goal: GoalMessage | None, now_s: float, renewed_s: float | None = None,
    controller: str = "AC", session: str = "me", clock: str | None = None, ahead_s: float = APART_S,
) -> bool:  # fmt: skip
    """Tell a gate to drive to a goal; `renewed_s` is steady time, too."""
    name = gate.clock(now_s + ahead_s, now_s) if clock is None else clock
    renewed_s = None if renewed_s is None else renewed_s + ahead_s
    return gate.obey(Command(session, seq, controller, name, renewed_s, goal), now_s + ahead_s, now_s)


def driven(now_s: float = 10.0) -> GoalGate:
    """A gate that passes the AC's goal, renewed just now."""
    gate = GoalGate(LEASE_S)
    assert say(gate, 1, AC_GOAL, now_s, now_s)
    return gate


def test_nothing_passes_without_a_lease() -> None:
    gate = GoalGate(LEASE_S)
    assert say(gate, 1, SC_GOAL, 0.0, controller="SC")
    assert gate.passing(0.0) is None


def test_a_goal_passes_until_the_lease_is_dead_and_again_when_it_is_renewed() -> None:
    gate = driven()
    assert gate.passing(10.0 + 0.9 * LEASE_S) is AC_GOAL
    assert gate.passing(10.0 + LEASE_S) is None
    say(gate, 2, AC_GOAL, 11.0, 11.0)
    assert gate.passing(11.0) == AC_GOAL


def test_a_lease_counts_from_when_it_was_sent_and_never_from_the_future() -> None:
    gate = driven()
    say(gate, 2, AC_GOAL, 10.0 + LEASE_S, 10.0)
    assert gate.passing(10.0 + LEASE_S) is None
    say(gate, 3, AC_GOAL, 11.0, 99.0)
    assert gate.passing(11.0 + LEASE_S) is None


def test_an_old_renewal_does_not_shorten_the_lease() -> None:
    gate = driven()
    say(gate, 2, AC_GOAL, 10.0, 9.0)
    assert gate.passing(10.0 + 0.9 * LEASE_S) == AC_GOAL


def test_a_goal_a_cancel_and_a_switch_renew_nothing() -> None:
    gate = driven()
    for seq, (goal, controller) in enumerate([(None, "AC"), (AC_GOAL, "AC"), (SC_GOAL, "SC")], 2):
        assert say(gate, seq, goal, 10.0 + 0.9 * LEASE_S, 10.0, controller)
    assert gate.passing(10.0 + LEASE_S) is None


def test_who_is_not_in_charge_moves_nothing() -> None:
    gate = driven()
    say(gate, 2, SC_GOAL, 10.0, 10.0)
    assert gate.passing(10.0) == AC_GOAL


def test_a_change_of_hands_flushes_what_was_in_flight() -> None:
    gate = driven()
    say(gate, 2, AC_GOAL, 10.0, 10.0, "SC")
    assert (gate.report(10.0).controller, gate.command) == ("SC", None)


def test_a_change_there_and_back_that_was_never_seen_flushes_too() -> None:
    gate = driven()
    say(gate, 4, None, 10.0, 10.0)
    assert gate.command is None


def test_a_goal_that_is_said_again_stays_the_same_one() -> None:
    gate = driven()
    say(gate, 2, AC_GOAL._replace(), 10.0, 10.0)
    assert gate.passing(10.0) is AC_GOAL, "whoever drives there would begin anew"


def test_what_comes_twice_or_too_late_changes_nothing() -> None:
    gate = driven()
    say(gate, 3, None, 10.0, 10.0, "SC")
    assert not say(gate, 2, AC_GOAL, 10.0, 10.0)
    assert not say(gate, 3, AC_GOAL, 10.0, 10.0)
    assert gate.passing(10.0) is None


def test_somebody_else_is_heard_only_when_the_lease_is_dead() -> None:
    gate = driven()
    assert not say(gate, 1, None, 10.0 + 0.5 * LEASE_S, None, "SC", "other")
    assert say(gate, 1, None, 10.0 + LEASE_S, None, "SC", "other")
    assert (gate.report(10.0).session, gate.report(10.0).controller, gate.command) == ("other", "SC", None)


def test_another_session_inherits_no_lease() -> None:
    gate = driven()
    assert say(gate, 1, AC_GOAL, 10.0 + LEASE_S, None, "AC", "other")
    assert gate.passing(10.0 + LEASE_S) is None


def test_a_renewal_by_a_clock_before_renews_nothing() -> None:
    """A robot that was switched off and on, or whose clock was set back: stamps from before mean nothing any more."""
    gate = driven()
    before = gate.clock(10.0 + APART_S, 10.0)
    for seq, ahead_s in enumerate([APART_S - 30.0, APART_S - 30.1], 2):
        assert say(gate, seq, AC_GOAL, 40.0, 40.0 + 30.0, clock=before, ahead_s=ahead_s)
        assert gate.passing(40.0) is None
    name = gate.clock(40.1 + APART_S - 30.1, 40.1)
    assert name != before
    assert say(gate, 4, AC_GOAL, 40.1, 40.1, ahead_s=APART_S - 30.1)
    assert gate.passing(40.1) == AC_GOAL


steps = st.tuples(
    st.integers(0, 200),  # milliseconds until it arrives
    st.integers(0, 400),  # how long it was on its way
    st.sampled_from(["me", "other"]),
    st.integers(0, 12),  # its number
    st.booleans(),  # whether it renews
    st.sampled_from([0.0, 0.0, 0.0, -0.5, -30.0, 30.0]),  # a step of the robot's clock before
)


@given(st.lists(steps, max_size=25))
def test_whatever_comes_nothing_passes_longer_than_a_lease_after_a_renewal_was_made(taken: list[tuple]) -> None:  # type: ignore[type-arg]
    gate, now_s, ahead_s, last_s = GoalGate(LEASE_S), 100.0, APART_S, -1.0
    # What the robot's clock showed, and was called, at every millisecond that a renewal may have been made at.
    shown = {0: (gate.clock(now_s + ahead_s, now_s), ahead_s)}
    at_ms = 0
    for later_ms, way_ms, session, seq, renews, step_s in taken:
        for each in range(at_ms + 1, at_ms + later_ms + 1):
            shown[each] = shown[at_ms]
        at_ms += later_ms
        now_s, ahead_s = 100.0 + at_ms / 1000.0, ahead_s + step_s
        assert gate.passing(now_s) is None or now_s - last_s < LEASE_S
        made_ms = max(at_ms - way_ms, 0)
        name, was_ahead_s = shown[made_ms]
        shown[at_ms] = gate.clock(now_s + ahead_s, now_s), ahead_s
        made_s = 100.0 + made_ms / 1000.0
        renewed_s = made_s + was_ahead_s if renews else None
        if gate.obey(Command(session, seq, "AC", name, renewed_s, AC_GOAL), now_s + ahead_s, now_s) and renews:
            last_s = max(last_s, made_s)
        assert gate.passing(now_s) is None or now_s - last_s < LEASE_S
