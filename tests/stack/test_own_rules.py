"""Legs under rules of a user's own: how much of a margin they may use up, and which ones lead away."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from soter.campaign.random.attackers import FarApart, Outside
from soter.rta import Region, Situation
from soter.stack.own_rules import OwnRule
from tests.rta.doubles import At
from tests.stack.ground import seen

OFF_M, OFF_RAD = 0.06, 0.35
LEG_M = 0.04
NEAR = At(1.05, robot_id=2)


def allowed(region: Region, of_pairs: bool, degrees: float, peers: Sequence[At] = (), length_m: float = LEG_M) -> bool:
    """Return whether a robot at the origin may drive a leg in that direction."""
    angle = math.radians(degrees)
    end = length_m * math.cos(angle), length_m * math.sin(angle)
    return OwnRule(region, of_pairs).allows(seen(At(), peers), *end, OFF_M, OFF_RAD, 0.0)


@pytest.mark.parametrize("degrees", [180.0, 130.0, 112.0, -112.0])
def test_a_leg_away_from_a_peer_is_allowed_where_half_of_the_margin_is_less_than_the_tracking_error(
    degrees: float,
) -> None:
    assert allowed(FarApart(1.0), True, degrees, [NEAR])


@pytest.mark.parametrize("degrees", [0.0, 60.0, 90.0, 105.0])
def test_any_other_leg_there_is_not(degrees: float) -> None:
    assert not allowed(FarApart(1.0), True, degrees, [NEAR])


def test_a_leg_away_from_a_place_is_allowed_where_the_margin_is_less_than_the_tracking_error() -> None:
    keep_out = Outside(1.0, 0.0, 0.97)
    assert allowed(keep_out, False, 135.0)
    assert not allowed(keep_out, False, 90.0)


def test_a_leg_away_from_the_nearest_peer_uses_up_no_more_than_half_of_the_margin_to_another_one() -> None:
    # Both peers may come as much nearer at the same time: to the nearest one that is no harm, to the other one it is.
    other = At(-1.25, robot_id=3)
    assert allowed(FarApart(1.0), True, 180.0, [NEAR, other])
    assert not allowed(FarApart(1.0), True, 180.0, [NEAR, other], length_m=0.11)
    assert allowed(FarApart(1.0), True, 180.0, [NEAR], length_m=0.11)


def test_a_rule_that_is_no_number_allows_no_leg() -> None:
    assert not allowed(FarApart(math.nan), True, 180.0, [NEAR])


def test_beside_a_rule_that_only_says_yes_or_no_no_leg_leads_away() -> None:
    class Half(Outside):
        def margin(self, situation: Situation) -> float:
            return 1.0 if situation.own.y_m >= -0.03 else -1.0

    assert not allowed(Half(0.0, 0.0, 0.0), False, 0.0)
    assert not allowed(Half(0.0, 0.0, 0.0), False, 30.0)
