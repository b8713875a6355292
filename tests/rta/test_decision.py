"""The synthesised decision module: to the SC at once, back to the AC only when that is provably fine."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from soter.rta import BEGINS_S, DecisionModule, Situation, SpeedBound, Timing
from soter.sdk import Controller
from tests.rta.doubles import NAN, SPEED, TICK_S, Above, At, module, situation

TIMING = Timing(latency_s=0.05)
REACH = SPEED.bound(0.25)
"""R(2 Delta + L) of the module that `decision` makes."""


class Say:
    """An arbiter that answers what the test says."""

    def __init__(self, answer: bool = True) -> None:
        self.answer = answer
        self.asked: list[str] = []

    def permits(self, module: str, situation: Situation, since_s: float) -> bool:
        self.asked.append(module)
        return self.answer


def decision(permission: Say | None = None, timing: Timing = TIMING, **values: Any) -> DecisionModule:
    return DecisionModule(module(**{"delta_s": 0.1, **values}), timing, TICK_S, permission)


def engaged(permission: Say | None = None, **values: Any) -> DecisionModule:
    """Make one that has given control to the AC at time 0.3."""
    made = decision(permission, **values)
    made.decide(situation(10.0, 0.0))
    made.decide(situation(10.0, 0.3))
    assert made.mode is Controller.AC
    return made


def disengaged(**values: Any) -> DecisionModule:
    """Make one that has just taken control back, at time 0.4."""
    made = engaged(**values)
    assert made.decide(situation(0.0, 0.4))
    return made


@pytest.mark.parametrize("clock_s", [0.0, 1e6])
def test_time_in_sc_counts_from_the_first_look_whatever_the_clock_says(clock_s: float) -> None:
    made = decision()
    assert made.since_s == math.inf
    for now_s in (clock_s, clock_s + 0.1):
        made.decide(situation(0.0, now_s))
        assert (made.mode, made.since_s) == (Controller.SC, clock_s)


# --- AC -> SC ----------------------------------------------------------------------------------------------


@given(st.floats(-1.0, 1.0))
def test_control_is_taken_at_the_very_look_at_which_the_margin_may_be_used_up(x_m: float) -> None:
    made = engaged()
    changed = made.decide(situation(x_m, 0.4))
    assert changed is (x_m < REACH)
    assert (made.mode is Controller.SC) is changed
    assert made.since_s == (0.4 if changed else 0.3)


def test_the_cause_has_the_numbers() -> None:
    made = engaged()
    made.decide(situation(0.05, 0.4))
    assert made.cause == f"margin 0.050 m < reach {REACH:.3f} m"


@given(st.floats(0.0, 0.6), st.sampled_from([0.0, 0.05]))
@example(math.nextafter(REACH, 0.0), 0.0)
@example(REACH + 0.0499999, 0.05)
@example(REACH, 0.05)
def test_the_numbers_of_the_cause_show_that_the_margin_is_too_small(x_m: float, keep: float) -> None:
    made = engaged(keep=keep)
    if made.decide(situation(x_m, 0.4)) and REACH + keep - x_m >= 1e-7:
        has, needs, *parts = (float(each) for each in re.findall(r"[\d.]+(?= m)", made.cause))
        assert has < needs, made.cause
        assert needs == pytest.approx(sum(parts) if parts else REACH, abs=2e-3)


def test_taking_control_asks_nobody_and_waits_for_nothing() -> None:
    say = Say()
    made = engaged(say, dwell_s=0.3)
    say.answer = False
    say.asked.clear()
    assert made.decide(situation(0.0, 0.3001))
    assert say.asked == []


@pytest.mark.parametrize("x_m", [NAN, -math.inf])
def test_a_margin_that_is_no_number_is_danger(x_m: float) -> None:
    made = engaged()
    assert made.decide(situation(x_m, 0.4))
    assert made.mode is Controller.SC


class Answers(Above):
    """A rule that answers whatever the test says."""

    answer: Any = 10.0

    def margin(self, situation: Situation) -> float:
        answer: float = self.answer
        return answer


@pytest.mark.parametrize("answer", [None, "10", [10.0], 10**400, 1j])
def test_a_margin_that_is_of_no_use_as_a_number_fails_and_is_not_kept(answer: object) -> None:
    rule = Answers(0.0)
    made = engaged(phi_safe=rule)
    margin = made.margin
    object.__setattr__(rule, "answer", answer)
    with pytest.raises((TypeError, OverflowError)):
        made.decide(situation(10.0, 0.4))
    assert made.margin == margin
    made.force(0.4, "it failed")
    with pytest.raises((TypeError, OverflowError)):
        made.observe(situation(10.0, 0.45))
    assert made.margin == margin


@pytest.mark.parametrize("answer", [None, "0.1", 10**400])
def test_a_reach_that_is_of_no_use_as_a_number_fails_and_is_not_kept(answer: object) -> None:
    class Odd(SpeedBound):
        def reach(self, situation: Situation, time_s: float) -> float:
            if situation.now_s > 0.35:
                return answer  # type: ignore[return-value]
            return self.bound(time_s)

    made = engaged(model=Odd(0.22, 1.0))
    with pytest.raises((TypeError, OverflowError)):
        made.decide(situation(10.0, 0.4))
    assert isinstance(made.reach, float)


@given(st.floats(0.0, 10.0), st.floats(-0.5, 3.0))
def test_the_age_of_the_sample_is_paid_for(age_s: float, x_m: float) -> None:
    made = engaged()
    assert made.decide(situation(x_m, 0.4, age_s)) is (x_m < SPEED.bound(0.25 + age_s))


def test_latency_jitter_noise_and_the_lease_are_paid_for() -> None:
    for timing, reach in (
        (Timing(latency_s=0.1, jitter_s=0.2), SPEED.bound(0.5)),
        (Timing(noise_m=0.1), SPEED.bound(0.2) + 0.1),
        (Timing(lease_s=0.6, tick_s=0.1), SPEED.bound(0.6)),
        (Timing(lease_s=0.6, tick_s=0.05), SPEED.bound(0.65)),
        (Timing(lease_s=0.6), SPEED.bound(0.7)),
        (Timing(lease_s=0.1, tick_s=0.05), SPEED.bound(0.2)),
        (Timing(sample_age_s=0.5), SPEED.bound(0.2)),
    ):
        for x_m, kept in ((reach + 1e-6, True), (reach - 1e-6, False)):
            made = engaged(timing=timing)
            assert made.decide(situation(x_m, 0.4)) is not kept


def test_a_model_that_looks_at_the_state_is_asked() -> None:
    class Standing(type(SPEED)):  # type: ignore[misc]
        def reach(self, situation: Situation, time_s: float) -> float:
            return 0.0 if situation.own.vx_m_s == 0.0 else self.bound(time_s)

    made = engaged(model=Standing(0.22, 1.0))
    still = Situation(1, At(0.01, stamp_s=0.4), 0.4)
    assert not made.decide(still)
    still.own = At(0.01, stamp_s=0.5, vx_m_s=0.1)
    assert made.decide(still)


# --- SC -> AC ----------------------------------------------------------------------------------------------


def test_it_starts_in_sc_and_gives_control_after_the_dwell() -> None:
    made = decision(dwell_s=0.3)
    assert (made.mode, made.cause) == (Controller.SC, "start")
    times = [0.0, 0.1, 0.2, 0.29]
    assert not any(made.decide(situation(10.0, now_s)) for now_s in times)
    assert made.decide(situation(10.0, 0.3))
    assert (made.mode, made.cause, made.since_s) == (Controller.AC, "", 0.3)


def test_for_a_while_its_first_time_in_sc_means_nothing() -> None:
    made = decision()
    assert made.begins(0.0)
    made.decide(situation(0.0, 0.1))
    assert made.begins(0.1 + BEGINS_S)
    assert not made.begins(0.2 + BEGINS_S)
    assert not engaged().begins(0.3)
    assert not disengaged().begins(0.4)


def test_at_the_start_the_horizon_is_enough_and_phi_safer_not_needed() -> None:
    inside = SPEED.bound(0.25)
    assert inside < 0.5
    made = decision(dwell_s=0.0)
    assert not made.decide(situation(inside - 1e-6, 0.0))
    assert made.decide(situation(inside + 1e-6, 0.1))


@given(st.floats(0.0, 1.0))
def test_after_a_disengagement_phi_safer_is_needed(x_m: float) -> None:
    made = disengaged(dwell_s=0.0)
    assert made.decide(situation(x_m, 0.5)) is (x_m >= 0.5)


def test_the_age_and_the_noise_are_taken_off_phi_safer() -> None:
    for timing, age_s, needed in ((TIMING, 1.0, 0.5 + 0.22), (Timing(noise_m=0.1), 0.0, 0.6)):
        for x_m, given_back in ((needed + 1e-6, True), (needed - 1e-6, False)):
            made = disengaged(dwell_s=0.0, timing=timing)
            assert made.decide(situation(x_m, 2.0, age_s)) is given_back


def test_control_is_never_given_where_it_would_be_taken_at_once() -> None:
    made = disengaged(dwell_s=0.0)
    # Well inside phi_safer, but so old that the margin may be used up.
    assert not made.decide(situation(0.7, 10.0, age_s=5.0))


@pytest.mark.parametrize("lapse", ["margin", "nan", "force"])
def test_the_dwell_begins_anew_after_every_lapse(lapse: str) -> None:
    made = disengaged(dwell_s=0.3)
    made.decide(situation(10.0, 0.5))
    made.decide(situation(10.0, 0.7))
    if lapse == "force":
        made.force(0.75, "test")
    else:
        made.observe(situation(0.4 if lapse == "margin" else NAN, 0.75))
    assert not made.decide(situation(10.0, 0.8))
    assert not made.decide(situation(10.0, 1.0))
    assert made.decide(situation(10.0, 1.1))


def test_a_dwell_shorter_than_delta_is_followed_between_looks() -> None:
    made = decision(dwell_s=0.1)
    made.observe(situation(10.0, 0.0))
    assert made.decide(situation(10.0, 0.1))


def test_observing_never_gives_control() -> None:
    made = decision(dwell_s=0.0)
    for tick in range(100):
        made.observe(situation(10.0, tick * TICK_S))
    assert made.mode is Controller.SC


def test_the_arbiter_is_asked_last_and_its_no_costs_no_dwell() -> None:
    say = Say(answer=False)
    made = decision(say, dwell_s=0.3)
    made.decide(situation(10.0, 0.0))
    assert say.asked == []
    assert not made.decide(situation(10.0, 0.3))
    assert say.asked == ["line"]
    say.answer = True
    assert made.decide(situation(10.0, 0.4))


@given(st.lists(st.floats(-0.2, 1.2), min_size=20, max_size=60))
def test_whatever_the_margins_control_changes_only_as_declared(margins: list[float]) -> None:
    made = engaged(dwell_s=0.2)
    fine_since_s = math.nan
    for tick, x_m in enumerate(margins):
        now_s = 0.4 + tick * 0.1
        before = made.mode
        made.decide(situation(x_m, now_s))
        if before is Controller.AC:
            assert (made.mode is Controller.SC) is (x_m < REACH)
            fine_since_s = math.nan
        else:
            fine_since_s = math.nan if x_m < 0.5 else now_s if math.isnan(fine_since_s) else fine_since_s
            assert (made.mode is Controller.AC) is (now_s - fine_since_s >= 0.2 - 1e-9)


# --- predicates --------------------------------------------------------------------------------------------


def by_predicates(safer: Callable[[Situation], Any], fails: Callable[[Situation], Any]) -> DecisionModule:
    return decision(phi_safe=None, model=None, phi_safer=safer, ttf_2delta=fails, dwell_s=0.0)


def test_predicates_decide() -> None:
    made = by_predicates(lambda s: s.own.x_m >= 0.5, lambda s: s.own.x_m < 0.2)
    assert not made.decide(situation(0.4, 0.0))
    assert made.decide(situation(0.6, 0.1))
    assert not made.decide(situation(0.3, 0.2))
    assert made.decide(situation(0.1, 0.3))
    assert made.cause == "may fail within 2 Delta"


@pytest.mark.parametrize("answer", [True, 1, None, "no", NAN])
def test_only_a_plain_no_from_ttf_keeps_the_ac_in_control(answer: object) -> None:
    made = by_predicates(lambda s: True, lambda s: answer if s.now_s > 0.0 else False)
    assert made.decide(situation(1.0, 0.0))
    assert made.decide(situation(1.0, 0.1))


@pytest.mark.parametrize("answer", [False, 1, None, "yes", NAN])
def test_only_a_plain_yes_from_phi_safer_gives_control(answer: object) -> None:
    assert not by_predicates(lambda s: answer, lambda s: False).decide(situation(1.0, 0.0))


def test_a_region_may_be_joined_by_a_predicate_for_phi_safer() -> None:
    made = disengaged(phi_safer=lambda s: s.own.x_m > 0.9, dwell_s=0.0)
    assert not made.decide(situation(0.8, 0.5))
    assert made.decide(situation(1.0, 0.6))


def test_a_region_may_be_phi_safer_of_predicates() -> None:
    made = by_predicates(lambda s: True, lambda s: False)
    assert made.decide(situation(1.0, 0.0))
    made = decision(phi_safe=None, model=None, phi_safer=Above(0.5), ttf_2delta=lambda s: False, dwell_s=0.0)
    assert not made.decide(situation(NAN, 0.0))
    assert not made.decide(situation(0.4, 0.1))
    assert made.decide(situation(0.6, 0.2))


@pytest.mark.parametrize("foreign", [False, True])
def test_only_shipped_models_are_held_to_grow_with_time(foreign: bool) -> None:
    made = DecisionModule(module(delta_s=0.1), TIMING, TICK_S, foreign=foreign)
    assert made.monitor.grows is not foreign
