"""The spec monitor of a module: what it counts, and when it says that the argument does not fit the robot."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import Assumption, ModuleMonitor, PairBound, ReachModel, SpeedBound, Timing
from soter.rta.monitors import BrokenAssumption, SampleMonitor, StopMonitor
from soter.sdk import Controller
from tests.rta.doubles import PAIR, SPEED, At

AC, SC = Controller.AC, Controller.SC


def monitor(model: ReachModel | None = SPEED, noise: float = 0.0, sample_age_s: float = 0.0) -> ModuleMonitor:
    return ModuleMonitor(model, noise, sample_age_s)


def test_looks_and_changes_are_counted() -> None:
    made = monitor()
    for now_s, before, after in ((0.0, SC, SC), (0.1, SC, AC), (0.2, AC, AC), (0.3, AC, SC), (0.4, SC, AC)):
        made.look(now_s, 1.0, before, after)
    assert (made.looks, made.to_sc, made.to_ac) == (5, 1, 2)


def test_time_in_sc_is_that_between_looks_that_began_in_sc() -> None:
    made = monitor()
    made.look(10.0, 1.0, SC, SC)
    made.look(10.5, 1.0, SC, AC)
    made.look(11.5, 1.0, AC, AC)
    made.look(12.0, 1.0, AC, SC)
    made.look(12.25, 1.0, SC, SC)
    assert made.sc_s == pytest.approx(0.75)
    made.look(12.0, 1.0, SC, SC)
    assert made.sc_s == pytest.approx(0.75), "a clock that goes back takes nothing away"


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=50))
def test_the_least_margin_and_broken_looks_are_those_of_the_margins(margins: list[float]) -> None:
    made = monitor()
    for step, margin in enumerate(margins):
        made.look(step * 0.1, margin, SC, SC)
    assert made.least_margin == min(margins)
    assert made.broken == sum(margin < 0.0 for margin in margins)


@given(st.lists(st.floats(0.0, 5.0), min_size=2, max_size=50))
def test_surprises_are_falls_by_more_than_the_model_allows(margins: list[float]) -> None:
    made, quick = monitor(), ModuleMonitor(SPEED, grows=True)
    times = [step * 0.1 for step in range(len(margins))]
    for now_s, margin in zip(times, margins, strict=True):
        made.look(now_s, margin, AC, AC)
        quick.look(now_s, margin, AC, AC)
    assert (quick.surprises, quick.found) == (made.surprises, made.found)
    expected = [
        before - after > SPEED.bound(late_s - early_s)
        for before, after, early_s, late_s in zip(margins, margins[1:], times, times[1:], strict=False)
    ]
    assert made.surprises == sum(expected)


@pytest.mark.parametrize("margin", [math.nan, -math.inf, -1.0])
def test_a_margin_that_is_no_number_is_broken(margin: float) -> None:
    made = monitor()
    made.look(1.0, 1.0, SC, SC)
    made.look(2.0, margin, SC, SC)
    made.look(3.0, margin, SC, SC)
    assert made.broken == 2


def test_a_rule_given_by_predicates_has_decisions_only() -> None:
    made = monitor(None)
    made.look(0.0, math.nan, SC, AC)
    made.look(1.0, -5.0, AC, SC)
    assert (made.looks, made.to_ac, made.to_sc, made.broken, made.sc_s) == (2, 1, 1, 0, 0.0)
    assert made.found is None


def test_the_first_margin_that_is_negative_is_one_of_the_start_and_later_ones_are_of_the_recovery() -> None:
    made = monitor()
    made.look(0.0, -1.0, SC, SC)
    assert made.found == BrokenAssumption(Assumption.START, "margin -1.000", 1.0, "m")
    made.look(0.1, -1.5, SC, SC)
    assert made.found == BrokenAssumption(Assumption.RECOVERY, "margin -1.500", 1.5, "m")


def test_a_rule_that_was_broken_by_a_leap_is_no_failure_of_the_recovery() -> None:
    made = monitor()
    made.look(0.0, 1.0, AC, AC)
    made.look(0.1, -1.0, AC, SC)
    assert made.found is not None
    assert (made.found.assumption, made.broken, made.surprises) == (Assumption.WORKSPACE, 1, 1)
    assert made.found.cause == "the margin fell by 2.000 within 0.100 s"
    made.look(0.2, -1.0, SC, SC)
    assert made.found.assumption is Assumption.RECOVERY


class Shrinks(SpeedBound):
    """A user's model that allows for any fall, but only at once."""

    def bound(self, time_s: float) -> float:
        return super().bound(time_s) if time_s > 0.0 else 1e6


def test_a_model_that_allows_for_more_at_once_than_later_hides_nothing() -> None:
    made = monitor(Shrinks(0.22, 1.0))
    made.look(0.0, 3.0, AC, AC)
    made.look(0.1, 1.0, AC, AC)
    assert made.surprises == 1


def test_noise_is_no_finding() -> None:
    made = monitor(noise=0.1)
    made.look(0.0, 0.3, AC, AC)
    made.look(0.0, 0.3 - SPEED.bound(0.0) - 0.19, AC, AC)
    made.look(1.0, -0.09, SC, SC)
    assert made.found is None
    assert (made.broken, made.surprises) == (1, 0)
    made.look(2.0, -0.11, SC, SC)
    assert made.found is not None


def test_samples_that_were_taken_farther_apart_than_looks_are_no_finding() -> None:
    for age_s, surprised in ((0.5, 0), (0.0, 1)):
        made = monitor(sample_age_s=age_s)
        made.look(0.0, 1.0, AC, AC)
        made.look(0.1, 1.0 - SPEED.bound(0.55), AC, AC)
        assert made.surprises == surprised


@pytest.mark.parametrize("margin", [math.inf, -math.inf])
def test_a_robot_that_comes_within_sight_is_no_surprise(margin: float) -> None:
    made = monitor()
    made.look(0.0, margin, SC, SC)
    made.look(0.1, 2.0, SC, SC)
    assert (made.surprises, made.found) == (0, None)


def test_a_margin_between_robots_says_nothing_of_the_workspace() -> None:
    for model, found in ((PAIR, False), (SPEED, True)):
        made = monitor(model)
        made.look(0.0, 5.0, AC, AC)
        made.look(0.1, 1.0, AC, AC)
        assert made.surprises == 1
        assert (made.found is not None) is found


def test_nothing_is_watched_for_stopping_where_no_model_bounds_the_motion() -> None:
    stop = StopMonitor([], Timing())
    stop.told(0.0, At(), stop=True)
    assert stop.look(10.0, At(100.0)) is None


def test_the_motion_that_is_watched_for_stopping_is_the_robots_own() -> None:
    fast = SpeedBound(1.0, 1.0)
    assert PairBound(fast, SPEED).of_own() is fast
    stop = StopMonitor([fast], Timing(latency_s=0.1))
    stop.told(0.0, At(), stop=True)
    assert stop.look(1.0, At(fast.bound(0.1), stamp_s=1.0)) is None
    assert stop.look(1.0, At(fast.bound(0.1) + 1e-5, stamp_s=1.0)) is not None


def test_an_order_to_stop_pays_for_the_age_of_the_sample_it_was_given_on() -> None:
    stop = StopMonitor([SPEED], Timing(latency_s=0.1))
    stop.told(0.4, At(stamp_s=0.0), stop=True)
    assert stop.look(1.0, At(SPEED.bound(0.5), stamp_s=1.0)) is None
    assert stop.look(1.0, At(SPEED.bound(0.5) + 1e-5, stamp_s=1.0)) is not None


def test_the_same_sample_is_tested_once_but_its_age_every_time() -> None:
    samples = SampleMonitor([SPEED], Timing(sample_age_s=1.0))
    before, after = At(), At(5.0, stamp_s=0.1)
    assert samples.look(0.1, before, after) is not None
    assert samples.look(0.1, after, after) is None
    finding = samples.look(1.2, after, after)
    assert finding is not None
    assert finding.assumption is Assumption.SAMPLE_AGE
