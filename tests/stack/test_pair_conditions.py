"""Under which conditions two robots may each use up half of the gap between them, and that missions are held to it."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, cast

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from soter.errors import IllFormedModule
from soter.rta import PairBound, RTAModule, SpeedBound, Timing
from soter.sdk import Capabilities
from soter.stack.collision import Separation, check_halves
from soter.stack.peers import PeerBounds
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from tests.rta.doubles import FakeNode
from tests.sdk.fake import CAPABILITIES
from tests.stack.ground import EMPTY, TICK_S, robots, seen


def module(delta_s: float = 0.1, least_m: float = 0.3, brake_m_s2: float = 1.0) -> RTAModule:
    node, speed = FakeNode("node"), SpeedBound(0.22, brake_m_s2)
    return RTAModule(
        "collision", node, node, delta_s, Separation(least_m, 0.22), Separation(least_m + 0.2, 0.22),
        PairBound(speed, speed),
    )  # fmt: skip


def suggested(error: IllFormedModule) -> float:
    found = re.search(r"(?:phi_safe_m|; Delta) = ([\d.]+)", str(error))
    assert found is not None
    return float(found[1])


TIMING = Timing(latency_s=0.05, lease_s=0.1, tick_s=0.05)


def test_legs_are_at_most_a_quarter_of_the_separation() -> None:
    check_halves(module(), TIMING, 0.075)
    with pytest.raises(IllFormedModule, match=r"P2a.*up to 0\.080 m long.*separation of 0\.3 m") as caught:
        check_halves(module(), TIMING, 0.0801)
    check_halves(module(least_m=suggested(caught.value)), TIMING, 0.0801)


def test_the_ac_loses_control_early_enough_for_what_braking_takes() -> None:
    check_halves(module(0.05), TIMING, 0.05)
    with pytest.raises(
        IllFormedModule, match=r"P2a.*takes 0\.550 s.*0\.109 s before it must, and not 0\.050 s"
    ) as caught:
        check_halves(module(0.05, brake_m_s2=0.4), TIMING, 0.05)
    check_halves(module(suggested(caught.value), brake_m_s2=0.4), TIMING, 0.05)
    check_halves(module(0.05, brake_m_s2=0.4), replace(TIMING, latency_s=0.3), 0.05)
    check_halves(module(0.05, brake_m_s2=0.4), replace(TIMING, lease_s=0.2), 0.05)


@given(st.floats(0.05, 2.0), st.floats(0.05, 2.0), st.floats(0.01, 0.5), st.floats(0.01, 0.3), st.floats(0.0, 1.0))
def test_whatever_passes_leaves_a_braking_robot_what_it_needs(
    v_max: float, brake: float, delta_s: float, late_s: float, share: float
) -> None:
    """By driving on at top speed while the robot brakes, its peer takes no more of its half than was set aside."""
    node, speed = FakeNode("node"), SpeedBound(v_max, brake)
    made = RTAModule(
        "collision", node, node, delta_s, Separation(100.0, v_max), Separation(200.0, v_max), PairBound(speed, speed)
    )
    timing = Timing(latency_s=late_s / 2.0, tick_s=late_s / 2.0)
    try:
        check_halves(made, timing, 0.0)
    except IllFormedModule:
        assume(False)
    speed_m_s = share * v_max
    peer_m, own_m = v_max * speed_m_s / brake, speed_m_s**2 / (2.0 * brake)
    assert (peer_m - own_m) / 2.0 <= speed_m_s * delta_s + v_max * late_s / 2.0 + 1e-9


kinds = st.builds(
    lambda v_max, brake, latency_s, tube_m: replace(
        CAPABILITIES, v_max_m_s=v_max, brake_m_s2=brake, latency_s=latency_s, tube_m=tube_m
    ),
    st.floats(0.05, 1.0), st.floats(0.2, 2.0), st.floats(0.0, 1.0), st.floats(0.0, 0.1),
)  # fmt: skip
shares = st.floats(0.0, 1.0)


@given(kinds, kinds, st.floats(0.0, 0.3), st.lists(st.tuples(st.booleans(), shares, shares), max_size=40))
def test_legs_of_robots_with_unlike_promises_never_lead_two_of_them_together(
    first: Capabilities, second: Capabilities, further_m: float, course: list[tuple[bool, float, float]]
) -> None:
    """Lemma 4 on one line: wherever both are when either decides, both may drive to the ends of their legs."""
    fleet, least_m = (first, second), 1.0
    peers = PeerBounds.of(fleet, TICK_S)
    rules = RecoveryRules(fence=False, boxes=False, separation_m=least_m)
    planners = [
        RecoveryPlanner(EMPTY, each, rules, TICK_S, peers.noise_m, peers.v_max_m_s, peers.extent_m) for each in fleet
    ]
    # They start where neither has to limit its first leg, or nearly so.
    at = [0.0, least_m + sum(planner.leg_m(0.0) for planner in planners) + further_m]
    ends, ways = [*at], (1.0, -1.0)
    for who, *driven in course:
        look = robots([(at[0], 0.0), (at[1], 0.0)])
        planner = planners[who]
        length = planner.leg_m(0.0)
        while length > 1e-3 and planner.certify(seen(look[who], look), at[who] + ways[who] * length, 0.0) < 0.0:
            length /= 2.0
        ends[who] = at[who] + ways[who] * (length if length > 1e-3 else 0.0)
        strays_m = sum(each.tube_m for each, end, here in zip(fleet, ends, at, strict=True) if end != here)
        assert ends[1] - ends[0] - strays_m >= least_m - 1e-9
        for index, share in enumerate(driven):
            step_m = share * fleet[index].v_max_m_s * TICK_S
            at[index] += ways[index] * min(step_m, abs(ends[index] - at[index]))


def test_a_rule_of_another_kind_has_no_halves() -> None:
    check_halves(replace(module(), model=SpeedBound(0.22, 1.0)), TIMING, 10.0)
    check_halves(replace(module(), phi_safe=cast("Any", None), model=None), TIMING, 10.0)
