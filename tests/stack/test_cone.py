"""What a robot is near to already may be left, in every direction that it may take: it strays by up to 0.35 rad."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.stack.recovery import RecoveryRules
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.sdk.fake import CAPABILITIES
from tests.stack.ground import EMPTY, RADIUS_M, TICK_S, boxes, planner, robots, seen, to_box_m

TUBE_M = CAPABILITIES.tube_m
CONE_RAD = 0.35
STEP_M = 1e-6

angles = st.floats(-math.pi, math.pi)


def distances(boxes_: tuple[Box, ...], x: float, y: float) -> list[float]:
    """Return how far a robot is from every side of the fence, and its body from every box."""
    return [x, 5.0 - x, y, 5.0 - y, *(to_box_m(box, x, y) - RADIUS_M for box in boxes_)]


def leads_away(boxes_: tuple[Box, ...], at: Point, angle: float, index: int) -> bool:
    """Whether the distance to one thing rises in every direction within the cone about a leg's, by brute force."""
    before = distances(boxes_, *at)[index]
    for k in range(-20, 21):
        turned = angle + CONE_RAD * k / 20
        there = (at[0] + STEP_M * math.cos(turned), at[1] + STEP_M * math.sin(turned))
        if distances(boxes_, *there)[index] < before - 1e-6 * STEP_M:
            return False
    return True


@settings(max_examples=400)
@given(
    st.sampled_from(["fence", "box"]), st.floats(0.0, TUBE_M), st.floats(0.6, 4.4), angles, angles,
    st.floats(0.02, 0.1), boxes(2),
)  # fmt: skip
@example("fence", 0.01, 2.5, 0.0, math.pi / 2.0, 0.05, ())
@example("box", 0.01, 2.5, 0.0, CONE_RAD + 0.01, 0.05, ())
@example("box", 0.01, 2.5, 0.0, CONE_RAD - 0.01, 0.05, ())
def test_from_inside_the_tube_a_leg_may_only_lead_away_whichever_way_it_is_driven(
    what: str, near_m: float, along_m: float, around: float, angle: float, length_m: float, others: tuple[Box, ...]
) -> None:
    if what == "fence":
        some, at = others, (along_m, near_m)
    else:
        # Around a box: beside it or at a corner of it.
        box = Box(2.0, 2.0, 3.0, 3.0)
        some = (box, *others)
        reach = RADIUS_M + near_m
        at = (
            (3.0 + reach * math.cos(around), 3.0 + reach * math.sin(around))
            if 0.0 <= around <= math.pi / 2.0
            else (2.5, 3.0 + reach)
        )
    before = distances(some, *at)
    assume(min(before) >= 0.0)
    assume(min(before) <= TUBE_M)
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    end = (at[0] + length_m * math.cos(angle), at[1] + length_m * math.sin(angle))
    margin = planner(terrain).certify(seen(At(*at)), *end)
    near = [index for index, distance in enumerate(before) if distance < TUBE_M - 1e-9]
    assume(near)
    away = all(leads_away(some, at, angle, index) for index in near)
    if margin >= 0.0:
        assert away
    elif away and all(  # and nothing else is in the way
        distance >= TUBE_M + length_m + 1e-6 for index, distance in enumerate(before) if index not in near
    ):
        # Not refused without need, to within rounding of the directions that were tried.
        turned = [leads_away(some, at, angle + nudge, index) for index in near for nudge in (-0.02, 0.02)]
        assert not all(turned), margin


@settings(max_examples=300)
@given(st.floats(0.3, 0.6), angles, angles, st.floats(0.02, 0.08), st.floats(-CONE_RAD, CONE_RAD), st.floats(-1.0, 1.0))
@example(0.46, 0.0, math.pi / 2.0, 0.05, 0.0, 1.0)
def test_the_extent_towards_a_peer_is_at_most_half_the_gap_whichever_way_the_leg_is_driven(
    apart_m: float, bearing: float, angle: float, length_m: float, stray: float, aside: float
) -> None:
    """Lemma 4: the projection of all that the robot may cover, wherever it is within the tube of its leg."""
    own, peer = robots([(2.5, 2.5), (2.5 + apart_m * math.cos(bearing), 2.5 + apart_m * math.sin(bearing))])
    dx, dy = length_m * math.cos(angle), length_m * math.sin(angle)
    assume(planner(EMPTY).certify(seen(own, [own, peer]), 2.5 + dx, 2.5 + dy) >= 0.0)
    half_m = (apart_m - RecoveryRules().separation_m) / 2.0
    blind_m = CAPABILITIES.v_max_m_s * (TICK_S + CAPABILITIES.latency_s)
    ux, uy = math.cos(bearing), math.sin(bearing)
    towards = dx * ux + dy * uy
    if towards <= -math.sin(CONE_RAD) * length_m + 1e-12:
        # It only gets away, even if it strays all along.
        assert length_m * math.cos(angle + stray - bearing) <= 1e-9
        return
    # At the end of the leg, aside of it by as much as it may be, or beyond it if it leads there.
    tube_x, tube_y = -math.sin(angle) * aside * TUBE_M, math.cos(angle) * aside * TUBE_M
    assert max(towards, 0.0) + tube_x * ux + tube_y * uy <= half_m - blind_m + 1e-9


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_leg_across_has_its_tube_towards_the_peer(side: float) -> None:
    blind_m = CAPABILITIES.v_max_m_s * (TICK_S + CAPABILITIES.latency_s)
    edge_m = RecoveryRules().separation_m + 2.0 * (blind_m + TUBE_M)
    for spare_m, allowed in ((-1e-6, False), (1e-6, True)):
        own, peer = robots([(2.5, 2.5), (2.5 + edge_m + spare_m, 2.5)])
        assert (planner(EMPTY).certify(seen(own, [own, peer]), 2.5, 2.5 + side * 0.05) >= 0.0) is allowed
