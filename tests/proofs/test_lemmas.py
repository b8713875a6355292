"""The lemmas of docs/assurance.md hold of the code's own arithmetic for all numbers, and of no mutation of it."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import pytest

from soter.rta import (
    DirectedReach,
    PairBound,
    Region,
    RTAModule,
    SpeedAccelerationBound,
    SpeedBound,
    Timing,
    UnicycleBound,
    decision,
)
from soter.rta.models import bounds
from soter.stack import recovery, return_path
from soter.stack.collision import Separation, check_halves
from soter.stack.modules import obstacle
from soter.stack.recovery import RecoveryPlanner
from soter.stack.static_rules import Clearance
from tests.proofs import certificate, lemmas, reach, robots
from tests.proofs.robots import on_reals
from tests.proofs.symbolic import counterexample, greatest
from tests.rta.doubles import At

Mutation = Callable[[pytest.MonkeyPatch], None]

LEMMAS = {**lemmas.LEMMAS, **certificate.LEMMAS, **reach.LEMMAS}


@pytest.mark.parametrize("name", LEMMAS)
def test_lemma_holds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    symbolic, checked = on_reals(monkeypatch), 0
    for each in LEMMAS[name](symbolic, monkeypatch):
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


def short(figure: Callable[[RecoveryPlanner], Any]) -> Mutation:
    """Legs are certified with a tube that is so much thinner."""
    return planner_with(lambda planner: setattr(planner, "_tube", planner._tube - figure(planner)))


def model_with(owner: type, **figures: Callable[[Any], Any]) -> Mutation:
    """A reach model is made with other figures."""
    make = owner.__init__  # type: ignore[misc]

    def makes(self: Any, *arguments: Any) -> None:
        make(self, *arguments)
        for name, figure in figures.items():
            setattr(self, name, figure(self))

    return attribute(owner, "__init__", makes)


def part_with(name: str, **figures: Callable[[Any], Any]) -> Mutation:
    """A part of the unicycle's bound is computed with other figures."""
    compute = getattr(UnicycleBound, name)

    def computes(self: Any, *arguments: Any) -> Any:
        other = copy(self)
        for figure, of in figures.items():
            setattr(other, figure, of(self))
        return compute(other, *arguments)

    return attribute(UnicycleBound, name, computes)


def half_the_rate(model: Any) -> Any:
    return model.yaw_rate_max_rad_s * 0.5


def the_other_way(model: Any) -> Any:
    return model.yaw_rate_max_rad_s * -1


def towards(turn: Callable[[Any, Any], tuple[Any, Any]]) -> Mutation:
    """The unicycle's bound is that of another direction: the heading is read as another one."""

    def extent(self: UnicycleBound, sample: Any, time_s: Any, ux: Any, uy: Any) -> Any:
        return self._along(sample, time_s, *turn(ux, uy), self.brake_m_s2)

    return attribute(UnicycleBound, "extent", extent)


def peer_with(change: Callable[..., tuple[Any, ...]]) -> Mutation:
    """A peer's extent is asked for with other arguments: sample, own stamp, time, direction."""
    asks = DirectedReach._extent_of
    return attribute(
        DirectedReach, "_extent_of", staticmethod(lambda other, *arguments: asks(other, *change(*arguments)))
    )


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
    ("lemma_1", "keep left out"): attribute(decision, "kept_by_margin", lambda _: 0),
    ("kept_for_paths", "keep left out"): attribute(decision, "kept_by_margin", lambda _: 0),
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
    ("certified_fence", "tube left out"): short(lambda planner: planner._tracking_m),
    ("certified_fence", "noise left out"): short(lambda planner: planner._tube - planner._tracking_m),
    ("certified_fence", "age left out"): leaves_out("_drift_m_s"),
    ("certified_fence", "a leg that leads along"): attribute(recovery, "_ALIGNED_SIN", 0),
    ("certified_boxes", "tube left out"): short(lambda planner: planner._tracking_m),
    ("certified_boxes", "noise left out"): short(lambda planner: planner._tube - planner._tracking_m),
    ("certified_boxes", "age left out"): leaves_out("_drift_m_s"),
    ("certified_boxes", "a leg that leads along"): attribute(recovery, "_ALIGNED_SIN", 0),
    ("speed_acceleration", "noise left out"): model_with(SpeedAccelerationBound, speed_noise_m_s=lambda _: 0),
    ("speed_acceleration", "half of the acceleration"): model_with(
        SpeedAccelerationBound, accel_m_s2=lambda model: model.accel_m_s2 / 2
    ),
    ("speed_acceleration", "factor 2 of braking left out"): model_with(
        SpeedAccelerationBound, brake_m_s2=lambda model: model.brake_m_s2 * 2
    ),
    ("heading", "heading noise left out"): model_with(UnicycleBound, heading_noise_rad=lambda _: 0),
    ("heading", "heading noise left out of the speed"): model_with(UnicycleBound, _aligned=lambda _: 1),
    ("heading", "speed noise left out"): model_with(UnicycleBound, speed_noise_m_s=lambda _: 0),
    ("heading", "no way backwards"): model_with(UnicycleBound, reverse_m_s=lambda _: 0),
    ("heading", "wrong heading: mirrored"): towards(lambda ux, uy: (ux, -uy)),
    ("heading", "wrong heading: backwards"): towards(lambda ux, uy: (-ux, -uy)),
    ("turning", "turn rate halved"): part_with("_swept", yaw_rate_max_rad_s=half_the_rate),
    ("turning", "it turns the other way"): part_with("_swept", yaw_rate_max_rad_s=the_other_way),
    ("turning", "half of the acceleration"): part_with("_swept", accel_m_s2=lambda model: model.accel_m_s2 / 2),
    ("turning", "the control period left out"): part_with("_swept", period_s=lambda _: 0),
    ("integral", "turn rate halved"): part_with("_piece", yaw_rate_max_rad_s=half_the_rate),
    ("integral", "it turns the other way"): part_with("_piece", yaw_rate_max_rad_s=the_other_way),
    ("pairs", "the peer's share left out"): attribute(DirectedReach, "_extent_of", staticmethod(lambda *_: 0)),
    ("pairs", "the peer's way counted once"): attribute(bounds, "abs", lambda _: 0),
    ("pairs", "the peer's age left out"): peer_with(lambda peer, _, *rest: (peer, peer.stamp_s, *rest)),
    ("pairs", "wrong heading: the robot's own for the peer's"): peer_with(
        lambda peer, *rest: (At(stamp_s=peer.stamp_s), *rest)
    ),
    ("pairs", "wrong heading: the peer on the other side"): peer_with(
        lambda peer, stamp_s, time_s, *towards: (peer, stamp_s, time_s, *(-each for each in towards))
    ),
}


@pytest.mark.parametrize(("name", "how"), MUTATIONS, ids=[f"{name}: {how}" for name, how in MUTATIONS])
def test_mutation_has_a_counterexample(name: str, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    symbolic = on_reals(monkeypatch)
    MUTATIONS[name, how](monkeypatch)
    obligations = LEMMAS[name](symbolic, monkeypatch)
    assert any(counterexample(each.claim, [*each.given, *symbolic.known()]) is not None for each in obligations)


def test_every_lemma_has_a_mutation() -> None:
    assert {name for name, _ in MUTATIONS} == set(LEMMAS)
