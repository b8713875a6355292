"""What only studies may change: how far a module looks ahead, and what giving back asks for."""

from __future__ import annotations

import pytest

from soter.rta import DecisionModule, Timing
from soter.sdk import Controller
from tests.rta.doubles import SPEED, TICK_S, Above, module, situation

SAFER_M = 0.02
"""Far inside the reach bound: nobody may be given back there."""


def decision(safer_alone: bool = False, timing: Timing | None = None) -> DecisionModule:
    declared = module(delta_s=0.1, dwell_s=0.0, phi_safer=Above(SAFER_M))
    return DecisionModule(declared, timing or Timing(), TICK_S, None, safer_alone)


def test_a_study_looks_ahead_by_delta_alone_whatever_the_lease() -> None:
    assert Timing(lease_s=0.3, tick_s=0.05).ahead_s(0.1) == pytest.approx(0.35)
    assert Timing(lease_s=0.3, tick_s=0.05, deltas=1.0).ahead_s(0.1) == pytest.approx(0.1)
    assert Timing(lease_s=0.3, tick_s=0.05, deltas=0.0).ahead_s(0.1) == 0.0


def test_a_study_takes_control_later() -> None:
    for deltas, reach_m in ((None, SPEED.bound(0.2)), (1.0, SPEED.bound(0.1)), (0.0, SPEED.bound(0.0))):
        made = decision(timing=Timing(deltas=deltas))
        made.decide(situation(10.0, 0.0))
        assert made.mode is Controller.AC
        assert not made.decide(situation(reach_m + 1e-6, 0.1))
        assert made.decide(situation(reach_m - 1e-6, 0.2))


@pytest.mark.parametrize("safer_alone", [False, True])
def test_within_reach_of_the_edge_only_a_study_gives_back(safer_alone: bool) -> None:
    made = decision(safer_alone)
    made.decide(situation(10.0, 0.0))
    assert made.decide(situation(0.0, 0.1))
    assert made.decide(situation(SAFER_M, 0.2)) is safer_alone


def test_a_study_does_not_give_back_outside_phi_safer() -> None:
    made = decision(safer_alone=True)
    made.decide(situation(10.0, 0.0))
    made.decide(situation(0.0, 0.1))
    made.decide(situation(SAFER_M - 1e-6, 0.2))
    assert made.mode is Controller.SC
