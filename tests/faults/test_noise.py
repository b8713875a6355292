"""Positions that are wrong by a known amount: what a place, a pair and a motion are judged by."""

from __future__ import annotations

import pytest

from soter.stack.collision import Separation
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from tests.rta.doubles import At
from tests.sdk.fake import CAPABILITIES, capabilities
from tests.stack.ground import EMPTY, TICK_S, seen


@pytest.mark.parametrize(("own_m", "peer_m"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.02), (0.02, 0.03)])
def test_a_motion_towards_a_peer_pays_for_both_robots_noise(own_m: float, peer_m: float) -> None:
    situation = seen(At(2.0, 2.0, robot_id=1), [At(2.5, 2.0, robot_id=2)])
    exact = RecoveryPlanner(EMPTY, CAPABILITIES, RecoveryRules(), TICK_S)
    noisy = RecoveryPlanner(EMPTY, capabilities(position_noise_m=own_m), RecoveryRules(), TICK_S, peer_noise_m=peer_m)
    for length_m in (0.01, 0.05, 0.1):
        margins = [planner.certify(situation, 2.0 + length_m, 2.0) for planner in (exact, noisy)]
        assert margins[0] - margins[1] == pytest.approx((own_m + peer_m) / 2.0), (
            "each robot keeps to its half of the gap"
        )


def test_a_distance_is_wrong_by_what_both_positions_are() -> None:
    assert Separation(0.3, 0.22, 0.03).noise(0.02) == pytest.approx(0.05)
