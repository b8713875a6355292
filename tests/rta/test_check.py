"""Ill-formed modules are refused with the condition, the numbers, and a value that passes when it is taken."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from soter.errors import IllFormedModule
from soter.rta import DecisionModule, RTAModule, Situation, Timing
from soter.rta.module import no_answer
from soter.sdk import Controller
from soter.stack.collision import Separation
from soter.stack.static_rules import Fence
from tests.rta.doubles import PAIR, SPEED, TICK_S, Above, At, FakeNode, Unspeakable, module

TIMING = Timing(latency_s=0.05)


def refusal(made: RTAModule, timing: Timing = TIMING, base_tick_s: float = TICK_S) -> IllFormedModule:
    with pytest.raises(IllFormedModule) as caught:
        made.check(timing, base_tick_s)
    assert f"module '{made.name}' is ill-formed ({caught.value.condition})" in str(caught.value)
    return caught.value


def number(pattern: str, error: IllFormedModule) -> float:
    found = re.search(pattern, str(error))
    assert found is not None, str(error)
    return float(found.group(1))


def test_a_unit_that_is_no_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Above, "unit", 5)
    assert "the unit of phi_safe is 5, allowed: a text" in str(refusal(module()))


@pytest.mark.parametrize("answer", [None, "5", [1.0, 2.0], Unspeakable(), SystemExit(0)])
@pytest.mark.parametrize("asked", ["edge_margin", "noise"])
def test_a_rule_that_cannot_be_asked(asked: str, answer: object, monkeypatch: pytest.MonkeyPatch) -> None:
    def answers(*_: object) -> object:
        if isinstance(answer, BaseException):
            raise answer
        return answer

    monkeypatch.setattr(Above, asked, answers)
    assert "it fails when it is evaluated" in str(refusal(module()))


def test_p3_an_edge_margin_that_is_no_number_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Above, "edge_margin", lambda *_: math.nan)
    error = refusal(module())
    assert error.condition == "P3"
    assert "edge_margin of Above returns nan" in error.why
    assert "only nan" not in error.why


def test_what_fails_is_named_with_the_line_of_foreign_code(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> float:
        return float(json.loads("{"))

    line = fails.__code__.co_firstlineno + 1
    monkeypatch.setattr(Above, "edge_margin", fails)
    assert refusal(module()).why.endswith(f" (test_check.py, line {line})")
    monkeypatch.setattr(Above, "margin", fails)
    assert no_answer(Above(1.0), Situation(1, At(0.0), 0.0)).endswith(f" (test_check.py, line {line})")


@pytest.mark.parametrize("delta_s", [0.0, -0.1, math.nan, math.inf])
def test_p1a_a_delta_that_is_no_period(delta_s: float) -> None:
    assert refusal(module(delta_s=delta_s)).condition == "P1a"


@pytest.mark.parametrize("dwell_s", [-0.1, math.nan, math.inf])
def test_a_dwell_that_is_no_time(dwell_s: float) -> None:
    assert "dwell_s" in str(refusal(module(dwell_s=dwell_s)))


@pytest.mark.parametrize("role", ["ac", "sc"])
@pytest.mark.parametrize("period_s", [0.15, 0.17, 0.11])
def test_p1a_a_controller_slower_than_delta(role: str, period_s: float) -> None:
    slow = FakeNode("slow", period_s=period_s)
    made = module(delta_s=0.1, ac=slow) if role == "ac" else module(delta_s=0.1, sc=slow)
    error = refusal(made)
    assert error.condition == "P1a"
    assert f"the {role.upper()} 'slow' has a period of {period_s:g} s" in str(error)
    replace(made, delta_s=number(r"a Delta of ([\d.]+) s would do", error)).check(TIMING, TICK_S)
    slow.period_s = number(r"a period of ([\d.]+) s or", error)
    made.check(TIMING, TICK_S)


@pytest.mark.parametrize("delta_s", [0.12, 0.13, 0.051, 0.049, 0.01])
def test_p1a_a_delta_that_is_no_multiple_of_the_tick(delta_s: float) -> None:
    made = module(delta_s=delta_s, ac=FakeNode("ac", period_s=0.01), sc=FakeNode("sc", period_s=0.01))
    error = refusal(made)
    assert error.condition == "P1a"
    assert "base tick" in str(error)
    replace(made, delta_s=number(r"; ([\d.]+) s would do", error)).check(TIMING, TICK_S)


@pytest.mark.parametrize("delta_s", [0.05, 0.1, 0.15, 0.3, 0.35, 0.7])
def test_decimal_multiples_of_the_tick_are_multiples(delta_s: float) -> None:
    module(delta_s=delta_s).check(TIMING, TICK_S)


def test_p1b_controllers_that_publish_different_topics() -> None:
    other, silent = FakeNode("other"), FakeNode("silent")
    other.publishes = ("path",)
    silent.publishes = ()
    error = refusal(module(sc=other))
    assert error.condition == "P1b"
    assert "['waypoint']" in str(error)
    assert "['path']" in str(error)
    assert refusal(module(ac=silent, sc=silent)).condition == "P1b"


@pytest.mark.parametrize(
    "values",
    [
        {"phi_safe": None, "model": None},
        {"model": None},
        {"phi_safe": None},
        {"ttf_2delta": lambda situation: False},
    ],
)
def test_a_rule_is_given_by_margins_or_by_predicates_and_not_both(values: dict[str, Any]) -> None:
    assert "not both" in str(refusal(module(**values)))


def test_predicates_alone_are_an_assumption_and_accepted() -> None:
    module(
        phi_safe=None, model=None, phi_safer=lambda s: True, ttf_2delta=lambda s: False
    ).check(TIMING, TICK_S)  # fmt: skip


def test_p3_names_the_numbers_and_a_value_that_would_do() -> None:
    made = module(delta_s=0.5, phi_safer=Above(0.2))
    error = refusal(made)
    reach = 0.22 * 1.05 + 0.22**2 / 2.0
    assert error.condition == "P3"
    assert "1.050 s" in str(error)
    assert f"{reach:.3f} m" in str(error)
    assert "only 0.200 m" in str(error)
    fits_s = number(r"Delta = ([\d.]+) s, would do", error)
    assert fits_s == 0.35
    replace(made, delta_s=fits_s).check(TIMING, TICK_S)
    assert refusal(replace(made, delta_s=fits_s + TICK_S)).condition == "P3", "it is the largest"
    replace(made, phi_safer=Above(number(r"a margin of ([\d.]+) m", error))).check(TIMING, TICK_S)


def test_p3_is_refused_where_no_phi_safer_would_do() -> None:
    made = module(model=type(SPEED)(1e300, 1.0), phi_safer=Above(0.2))
    assert "it is only 0.200 m; no phi_safer would do" in str(refusal(made))


@given(
    st.integers(1, 40), st.floats(0.0, 1.0), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 0.1),
    st.floats(0.0, 0.2), st.floats(0.0, 1.0), st.integers(1, 4),
)  # fmt: skip
def test_p3_whatever_it_suggests_passes(
    ticks: int,
    edge: float,
    latency_s: float,
    age_s: float,
    jitter_s: float,
    noise_m: float,
    lease_s: float,
    period: int,
) -> None:
    node = FakeNode("node", period_s=min(period, ticks) * TICK_S)
    timing = Timing(latency_s, age_s, jitter_s, noise_m, lease_s, TICK_S)
    made = module(delta_s=ticks * TICK_S, phi_safer=Above(edge), ac=node, sc=node)
    assume(SPEED.bound(made.horizon_s(timing)) + noise_m > edge + 1e-6)
    error = refusal(made, timing)
    assert error.condition == "P3"
    replace(made, phi_safer=Above(number(r"a margin of ([\d.]+) m", error))).check(timing, TICK_S)
    if "or Delta" in str(error):
        replace(made, delta_s=number(r"Delta = ([\d.]+) s", error)).check(timing, TICK_S)
    else:
        for shorter in range(round(node.period_s / TICK_S), ticks):
            assert refusal(replace(made, delta_s=shorter * TICK_S), timing).condition == "P3"


@given(st.integers(1, 20), st.floats(0.0, 1.5), st.floats(0.0, 0.3), st.floats(0.0, 0.3))
def test_p3_is_what_the_first_lemma_starts_from(ticks: int, edge: float, own_m: float, peers_m: float) -> None:
    """At the edge of phi_safer the AC may go on driving if and only if P3 holds, noise of both robots included."""
    apart = Separation(0.3, 0.22, peers_m)
    made = module(delta_s=ticks * TICK_S, phi_safe=apart, phi_safer=replace(apart, least_m=0.3 + edge), model=PAIR)
    timing = replace(TIMING, noise_m=own_m)
    spare = edge - own_m - peers_m - PAIR.bound(made.horizon_s(timing))
    assume(abs(spare) > 1e-6)
    decision = DecisionModule(made, timing, TICK_S)
    decision.mode = Controller.AC
    situation = Situation(1, At(), 0.0)
    situation.peers = (At(0.3 + edge, robot_id=2),)
    fires = decision.decide(situation)
    if spare < 0.0:
        assert fires
        error = refusal(made, timing)
        wider = 0.3 + number(r"a margin of ([\d.]+) m", error)
        replace(made, phi_safer=replace(apart, least_m=wider)).check(timing, TICK_S)
    else:
        assert not fires
        made.check(timing, TICK_S)


@pytest.mark.parametrize("name", ["latency_s", "sample_age_s", "jitter_s"])
def test_p3_pays_for_latency_age_and_jitter(name: str) -> None:
    made = module(delta_s=0.1, phi_safer=Above(SPEED.bound(0.2)))
    made.check(Timing(), TICK_S)
    assert refusal(made, Timing(**{name: 0.01})).condition == "P3"


def test_p3_pays_for_noise_and_says_so() -> None:
    made = module(delta_s=0.1, phi_safer=Above(SPEED.bound(0.2) + 0.05))
    made.check(Timing(noise_m=0.05), TICK_S)
    error = refusal(made, Timing(noise_m=0.06))
    assert error.condition == "P3"
    assert "and be wrong by 0.060 m" in str(error)


def test_p3_pays_for_a_lease_that_outlives_two_delta() -> None:
    made = module(delta_s=0.1, phi_safer=Above(SPEED.bound(0.2)))
    # Renewed for the last time one tick before the next look would have been.
    last_s = 0.1 - TICK_S
    made.check(Timing(lease_s=0.2 - last_s, tick_s=TICK_S), TICK_S)
    error = refusal(made, Timing(lease_s=0.3, tick_s=TICK_S))
    assert "the lease" in str(error)
    assert "Delta =" not in str(error), "no Delta helps against a lease"
    replace(made, phi_safer=Above(SPEED.bound(last_s + 0.3))).check(Timing(lease_s=0.3, tick_s=TICK_S), TICK_S)


def test_the_thesiss_own_collision_module_is_ill_formed() -> None:
    made = module("collision", delta_s=0.5, phi_safe=Separation(0.3, 0.22), phi_safer=Separation(0.5, 0.22), model=PAIR)
    error = refusal(made)
    # 2 x (0.22 x 1.05 + 0.22^2 / 2) m, where phi_safer leaves 0.2 m.
    assert "by 0.510 m" in str(error)
    assert "only 0.200 m" in str(error)
    assert "Delta = 0.1 s" in str(error)
    assert refusal(made, Timing()).condition == "P3", "even with a robot that does everything at once"
    replace(made, delta_s=0.1).check(TIMING, TICK_S)


def test_the_other_modules_of_the_surveillance_case_are_well_formed() -> None:
    fence = Fence(0.0, 5.0, 0.0, 5.0)
    module("geofence", delta_s=0.5, phi_safe=fence, phi_safer=fence.inset(0.5)).check(TIMING, TICK_S)
    module("obstacle", delta_s=0.05, phi_safer=Above(0.1)).check(TIMING, TICK_S)


def test_nodes_without_a_common_unit_of_regions_are_refused() -> None:
    made = module(phi_safe=Separation(0.3, 0.2), phi_safer=Fence(0, 1, 0, 1))
    assert "TypeError('phi_safer of a separation" in str(refusal(made))
