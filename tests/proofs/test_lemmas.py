"""The lemmas of docs/assurance.md hold of the code's own arithmetic for all numbers, and of no mutation of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from soter.rta import PairBound, Region, RTAModule, SpeedBound, Timing
from soter.rta.decision import DecisionModule
from soter.stack import recovery, return_path
from soter.stack.collision import Separation, check_halves
from soter.stack.modules import obstacle
from soter.stack.recovery import RecoveryPlanner
from soter.stack.static_rules import Clearance
from tests.proofs import lemmas, robots
from tests.proofs.robots import on_reals
from tests.proofs.symbolic import counterexample, greatest

Mutation = Callable[[pytest.MonkeyPatch], None]


@pytest.mark.parametrize("name", lemmas.LEMMAS)
def test_lemma_holds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    symbolic, checked = on_reals(monkeypatch), 0
    for each in lemmas.LEMMAS[name](symbolic, monkeypatch):
        found = counterexample(each.claim, [*each.given, *symbolic.known()])
        assert found is None, f"{each.name}: {found}"
        checked += 1
    assert checked


def attribute(owner: object, name: str, value: object) -> Mutation:
    """Something else stands where the code reads an attribute."""
    return lambda patch: patch.setattr(owner, name, value, raising=False)


def checked_with(change: Callable[[RTAModule, Timing], tuple[RTAModule, Timing]]) -> Mutation:
    """P3 is checked with other figures than the decision module uses."""
    check = RTAModule._check_reach

    def checks(module: RTAModule, phi_safe: Region, model: Any, timing: Timing, tick_s: float) -> None:
        other, other_timing = change(module, timing)
        check(other, phi_safe, model, other_timing, tick_s)

    return attribute(RTAModule, "_check_reach", checks)


def planner_with(change: Callable[[RecoveryPlanner], None]) -> Mutation:
    """The recovery planner is made with other figures."""
    make = RecoveryPlanner.__init__

    def makes(self: RecoveryPlanner, *arguments: Any) -> None:
        make(self, *arguments)
        change(self)

    return attribute(RecoveryPlanner, "__init__", makes)


def leaves_out(*names: str) -> Mutation:
    """The recovery planner leaves figures of its own out."""

    def change(planner: RecoveryPlanner) -> None:
        for name in names:
            setattr(planner, name, 0)

    return planner_with(change)


def nearer(shorter: Callable[[RecoveryPlanner], Any]) -> Mutation:
    """Paths may come nearer to fence and boxes."""
    return planner_with(lambda planner: setattr(planner, "path_m", planner.path_m - shorter(planner)))


def keeps(planner: Any, timing: Timing, delta_s: float) -> Any:
    """What the obstacle module would keep if all of the horizon were left when it fires."""
    return greatest(0, planner.path_m - planner.v_max_m_s * timing.ahead_s(delta_s))


def apart(planner: RecoveryPlanner, age_s: float) -> Any:
    """How far apart robots would be whose legs are not counted."""
    blind_m = planner._peer_v_max * (planner._blind_s + 2 * age_s)
    return planner.rules.separation_m + planner._pair_noise + 2 * (blind_m + planner._tracking_m)


def slow_peer(module: RTAModule, *rest: Any) -> None:
    """What is checked when the peer is taken to be as fast as the robot itself."""
    assert isinstance(module.phi_safe, Separation)
    assert isinstance(module.model, PairBound)
    own = module.model.own
    check_halves(replace(module, phi_safe=replace(module.phi_safe, peer_v_max_m_s=own.v_max_m_s)), *rest)


apart_m = RecoveryPlanner.apart_m

MUTATIONS: dict[tuple[str, str], Mutation] = {
    ("lemma_1", "noise left out"): attribute(Region, "noise", lambda *_: 0),
    ("lemma_1", "one Delta instead of two"): attribute(
        Timing, "ahead_s", lambda timing, delta_s: greatest(delta_s, timing.silent_s(delta_s))
    ),
    ("lemma_1", "lease left out"): attribute(Timing, "silent_s", lambda *_: 0),
    ("lemma_1", "latency left out"): attribute(
        Timing, "look_s", lambda timing, delta_s: timing.ahead_s(delta_s) + timing.jitter_s
    ),
    ("lemma_1", "jitter left out"): attribute(
        Timing, "look_s", lambda timing, delta_s: timing.ahead_s(delta_s) + timing.latency_s
    ),
    ("lemma_1", "stopping left out"): attribute(SpeedBound, "bound", lambda bound, time_s: bound.v_max_m_s * time_s),
    ("lemma_1", "keep left out"): attribute(DecisionModule, "_leaves_room", lambda *_: True),
    ("kept_for_paths", "keep left out"): attribute(DecisionModule, "_leaves_room", lambda *_: True),
    ("kept_for_paths", "more counted as unused than is"): attribute(
        obstacle, "keep_m", lambda table, planner, timing: keeps(planner, timing, table.delta_s)
    ),
    ("beside_one_box", "nobody looks for other boxes"): attribute(Clearance, "leaves_room", lambda *_: True),
    ("p3", "not checked"): attribute(RTAModule, "_check_reach", lambda *_: None),
    ("p3", "noise left out"): checked_with(lambda module, timing: (module, replace(timing, noise_m=0))),
    ("p3", "keep left out"): checked_with(lambda module, timing: (replace(module, keep=0), timing)),
    ("p3", "age left out"): checked_with(lambda module, timing: (module, replace(timing, sample_age_s=0))),
    ("p3", "one Delta instead of two"): checked_with(lambda module, timing: (module, replace(timing, deltas=1))),
    ("legs", "stopping left out"): leaves_out("_stop_m"),
    ("legs", "latency left out"): leaves_out("_blind_s"),
    ("legs", "shorter than what counts as arrived"): attribute(recovery, "LEAST_LEG_M", 0),
    ("paths", "one tube instead of two"): nearer(lambda planner: planner._tracking_m),
    ("paths", "noise counted once"): nearer(lambda planner: planner._tube - planner._tracking_m),
    ("paths", "corners left out"): nearer(lambda _: recovery.CORNER_M),
    ("paths", "drift left out"): attribute(recovery, "_ALIGNED_SIN", 0),
    ("lemma_3_boxes", "a leg that leads along"): attribute(lemmas, "lead_away", lambda _: 0),
    ("lemma_3_boxes", "a leg that leads nearer"): attribute(lemmas, "lead_away", lambda sin: -sin),
    ("lemma_3_pieces", "a leg that leads along"): attribute(lemmas, "lead_away", lambda _: 0),
    ("lemma_3_pieces", "a leg that leads nearer"): attribute(lemmas, "lead_away", lambda sin: -sin),
    ("lemma_3_fence", "a leg that leads along"): attribute(lemmas, "lead_away", lambda sin: sin / 2),
    ("lemma_4_ac", "the peer's noise left out"): attribute(Separation, "noise", Region.noise),
    ("lemma_4_ac", "the peer's share left out"): attribute(
        PairBound, "bound", lambda pair, time_s: pair.own.bound(time_s)
    ),
    ("lemma_4_ac", "one Delta instead of two"): attribute(Timing, "ahead_s", lambda timing, delta_s: delta_s / 2),
    ("lemma_4_sc", "tube left out"): leaves_out("_tracking_m"),
    ("lemma_4_sc", "the peer's approach left out"): leaves_out("_peer_v_max"),
    ("lemma_4_sc", "noise left out"): leaves_out("_pair_noise"),
    ("lemma_4_sc", "a leg that leads along"): attribute(lemmas, "lead_away", lambda _: 0),
    ("lemma_4_sc", "far peers not far enough"): planner_with(
        lambda planner: setattr(planner, "_pair_near_m", planner.rules.separation_m)
    ),
    ("lemma_4_hand_over", "not checked"): attribute(lemmas, "check_halves", lambda *_: None),
    ("lemma_4_hand_over", "the peer no faster than the robot"): attribute(
        lemmas, "check_halves", lambda module, *rest: slow_peer(module, *rest)
    ),
    ("lemma_4_hand_over", "the peer's latency as long as the robot's"): attribute(
        lemmas, "check_halves", lambda module, timing, leg_m, _: check_halves(module, timing, leg_m)
    ),
    ("lemma_4_sc", "the peer's leg no longer than the robot's"): attribute(robots, "extent_m", lambda *_: 0),
    ("apart_m", "legs left out"): attribute(RecoveryPlanner, "apart_m", apart),
    ("apart_m", "one age instead of two"): attribute(
        RecoveryPlanner, "apart_m", lambda planner, age_s: apart_m(planner, age_s / 2)
    ),
    ("return_path", "jump left out"): attribute(lemmas, "JUMPS", 0),
    ("return_path", "half of the jump"): attribute(lemmas, "JUMPS", 1),
    ("return_path", "a detour accounted for only where it is found"): attribute(
        return_path, "min", lambda *values: values[0]
    ),
    ("return_path", "the detour left out"): attribute(return_path, "DETOUR_M", -1),
}


@pytest.mark.parametrize(("name", "how"), MUTATIONS, ids=[f"{name}: {how}" for name, how in MUTATIONS])
def test_mutation_has_a_counterexample(name: str, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    symbolic = on_reals(monkeypatch)
    MUTATIONS[name, how](monkeypatch)
    obligations = lemmas.LEMMAS[name](symbolic, monkeypatch)
    assert any(counterexample(each.claim, [*each.given, *symbolic.known()]) is not None for each in obligations)


def test_every_lemma_has_a_mutation() -> None:
    assert {name for name, _ in MUTATIONS} == set(lemmas.LEMMAS)
