"""The certificates of the recovery planner are sound, whatever robots with certified legs make of them."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.rta import Region, Situation
from soter.stack.own_rules import OwnRule
from soter.stack.recovery import LEAST_LEG_M, PAIR_NEAR_M, SEPARATION_M, RecoveryPlanner, RecoveryRules
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.sdk.fake import CAPABILITIES
from tests.stack.ground import (
    EMPTY,
    RADIUS_M,
    TERRAIN,
    TICK_S,
    between,
    boxes,
    clear_m,
    fence_m,
    inside,
    planner,
    robots,
    seen,
)

V_MAX = CAPABILITIES.v_max_m_s
STOP_M = V_MAX**2 / 2.0
LEG_M = V_MAX * (TICK_S + CAPABILITIES.latency_s) + STOP_M
angles = st.floats(-math.pi, math.pi)
near = st.tuples(st.floats(0.0, 0.7), angles)


def crowd(spread: list[tuple[float, float]], middle: Point) -> list[Point]:
    return [(middle[0] + r * math.cos(a), middle[1] + r * math.sin(a)) for r, a in spread]


def least_pair_m(places: list[Point]) -> float:
    return min(math.dist(a, b) for a, b in combinations(places, 2))


# --- the pair rule -----------------------------------------------------------------------------------------

fractions = st.lists(st.floats(0.0, 1.0) | st.sampled_from([0.0, 1.0]), min_size=4, max_size=4)
aims = st.lists(st.none() | near, min_size=4, max_size=4)
ticks = st.lists(st.tuples(aims, fractions), min_size=1, max_size=12)


@settings(max_examples=150)
@given(st.lists(near, min_size=2, max_size=4), ticks)
def test_robots_that_move_any_part_of_their_legs_stay_apart(
    spread: list[tuple[float, float]], moves: list[tuple[list[tuple[float, float] | None], list[float]]]
) -> None:
    """All in SC, all certify on one look, then each goes anywhere up to the end of its leg, straight; and again."""
    places = crowd(spread, (2.5, 2.5))
    assume(least_pair_m(places) >= SEPARATION_M)
    recoveries = [planner(EMPTY) for _ in places]
    for targets, parts in moves:
        samples = robots(places)
        legs = []
        for index, (recovery, sample) in enumerate(zip(recoveries, samples, strict=True)):
            look = seen(sample, samples)
            aim = targets[index]
            if aim is None:  # as unfriendly as can be: straight at the nearest peer
                other = min((p for p in samples if p is not sample), key=lambda p: math.dist(p[:2], sample[:2]))
                goal = (other.x_m, other.y_m)
            else:
                goal = crowd([aim], (2.5, 2.5))[0]
            legs.append(recovery.towards(look, [goal]))
        starts = places
        places = [
            at if leg is None else (at[0] + f * (leg.x_m - at[0]), at[1] + f * (leg.y_m - at[1]))
            for at, leg, f in zip(starts, legs, parts, strict=False)
        ]
        # Straight and each at its own pace: the worst is at any combination of points of the legs.
        for (i, a), (j, b) in combinations(enumerate(starts), 2):
            for p in between(a, places[i], 4):
                assert all(math.dist(p, q) >= SEPARATION_M - 1e-9 for q in between(b, places[j], 4))
    assert all(recovery.no_certified_motion == 0 for recovery in recoveries)


class Runner:
    """A robot that gets its legs one tick late and drives them at up to top speed; any command makes it brake first."""

    def __init__(self, place: Point) -> None:
        self.place = place
        self.speed = 0.0
        self.direction = (1.0, 0.0)
        self.end: Point | None = None
        self.coming: Point | None = None

    def sample(self, number: int, now_s: float) -> At:
        vx, vy = self.speed * self.direction[0], self.speed * self.direction[1]
        return At(*self.place, now_s, number, 0.0, vx, vy)

    def step(self, eagerness: float) -> None:
        """One tick along the command that was given a tick ago."""
        x, y = self.place
        left = math.dist(self.place, self.end) if self.end is not None else 0.0
        wanted = 0.0
        if self.end is not None and left > 1e-9:
            ux, uy = (self.end[0] - x) / left, (self.end[1] - y) / left
            if self.speed < 1e-9 or ux * self.direction[0] + uy * self.direction[1] > 0.999:
                if self.speed < 1e-9:
                    self.direction = (ux, uy)
                # As fast as still stops at the end of the leg.
                brake = TICK_S
                wanted = min(V_MAX * eagerness, math.sqrt(brake * brake + 2.0 * left) - brake)
        self.speed = max(wanted, self.speed - TICK_S, 0.0)
        travelled = self.speed * TICK_S
        self.place = (x + travelled * self.direction[0], y + travelled * self.direction[1])
        self.end = self.coming


@settings(max_examples=80)
@given(
    st.lists(near, min_size=2, max_size=4),
    st.lists(st.tuples(aims, fractions), min_size=5, max_size=30),
)
def test_robots_whose_legs_come_a_tick_late_stay_apart_while_they_brake_and_start_anew(
    spread: list[tuple[float, float]], moves: list[tuple[list[tuple[float, float] | None], list[float]]]
) -> None:
    places = crowd(spread, (2.5, 2.5))
    assume(least_pair_m(places) >= SEPARATION_M)
    runners = [Runner(place) for place in places]
    recoveries = [planner(EMPTY) for _ in places]
    held: list[tuple[float, float] | None] = [None] * len(places)
    for tick, (targets, parts) in enumerate(moves * 2):
        samples = [runner.sample(number, tick * TICK_S) for number, runner in enumerate(runners, start=1)]
        for index, runner in enumerate(runners):
            if tick % 5 == 0:
                held[index] = targets[index]
            aim = held[index]
            other = min((p for p in samples if p is not samples[index]), key=lambda p: math.dist(p[:2], runner.place))
            goal = (other.x_m, other.y_m) if aim is None else crowd([aim], (2.5, 2.5))[0]
            leg = recoveries[index].towards(seen(samples[index], samples, tick * TICK_S), [goal])
            runner.coming = None if leg is None else (leg.x_m, leg.y_m)
        for runner, part in zip(runners, parts, strict=False):
            runner.step(part)
        assert least_pair_m([runner.place for runner in runners]) >= SEPARATION_M - 1e-9


def test_balls_of_half_the_gap_would_not_do() -> None:
    """Two robots that sidestep to one point each move less than half of the gap, and meet: so legs are projected."""
    one, other = robots([(2.0, 2.0), (2.45, 2.0)])
    recovery = planner(EMPTY)
    both = (2.225, 2.1)
    assert recovery.certify(seen(one, [one, other]), *both) < 0.0
    assert recovery.certify(seen(other, [one, other]), *both) < 0.0


@given(st.floats(0.3, 0.59), st.floats(0.0, 2.0), angles)
def test_the_age_of_what_is_known_of_a_peer_limits_the_leg(gap: float, age_s: float, angle: float) -> None:
    own, peer = At(2.5, 2.5, age_s, 1), At(2.5 + gap * math.cos(angle), 2.5 + gap * math.sin(angle), 0.0, 2)
    look = seen(own, [own, peer], age_s)
    length = 0.1
    margin = planner(EMPTY).certify(look, 2.5 + length * math.cos(angle), 2.5 + length * math.sin(angle))
    allowed = (gap - 0.3) / 2.0 - V_MAX * (TICK_S + 0.05 + age_s) - CAPABILITIES.tube_m
    assert margin == pytest.approx(allowed - length, abs=1e-9)


def test_moving_away_is_allowed_even_where_the_rule_is_broken() -> None:
    one, other = robots([(2.0, 2.0), (2.2, 2.0)])
    recovery = planner(EMPTY)
    assert recovery.certify(seen(one, [one, other]), 1.95, 2.0) >= 0.0
    assert recovery.certify(seen(one, [one, other]), 2.01, 2.0) < 0.0
    assert recovery.certify(seen(one, robots([(2.0, 2.0), (2.0, 2.0)])), 1.9, 2.0) < 0.0


def test_robots_that_keep_farther_apart_limit_their_legs_from_farther_away() -> None:
    rules = RecoveryRules(separation_m=0.59)
    one, other = robots([(2.0, 2.0), (2.61, 2.0)])
    assert math.dist(one[:2], other[:2]) > PAIR_NEAR_M
    for recovery, allowed in ((planner(EMPTY, rules), False), (planner(EMPTY), True)):
        margins = [recovery.certify(seen(a, [a, b]), a.x_m + way, 2.0) for a, b, way in
                   ((one, other, LEG_M), (other, one, -LEG_M))]  # fmt: skip
        assert all((margin >= 0.0) is allowed for margin in margins)


# --- fence and boxes ---------------------------------------------------------------------------------------


@settings(max_examples=300)
@given(boxes(), inside, angles, st.floats(0.0, 3.0), st.floats(-0.02, 0.02))
def test_a_certified_leg_leaves_the_robot_inside_and_clear_even_where_it_strays(
    some: tuple[Box, ...], at: Point, angle: float, far: float, stray: float
) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    assume(clear_m(terrain, *at) >= 0.0)
    recovery = planner(terrain)
    goal = (at[0] + far * math.cos(angle), at[1] + far * math.sin(angle))
    (own,) = robots([at])
    leg = recovery.towards(seen(own), [goal])
    if leg is None:
        return
    end = (leg.x_m, leg.y_m)
    assert math.dist(at, end) <= LEG_M + 1e-9
    safe = fence_m(*at) >= 0.02 and clear_m(terrain, *at) >= 0.02
    across = (-math.sin(angle) * stray, math.cos(angle) * stray) if safe else (0.0, 0.0)
    clear, fence = clear_m(terrain, *at), fence_m(*at)
    for x, y in between(at, end):
        assert fence_m(x + across[0], y + across[1]) >= min(fence, 0.0) - 1e-9
        assert clear_m(terrain, x + across[0], y + across[1]) >= min(clear, 0.0) - 1e-9


@pytest.mark.parametrize("age_s", [0.0, 0.1, 0.3])
def test_what_a_robot_has_driven_at_a_slant_since_its_sample_is_paid_for(age_s: float) -> None:
    """Before a leg is certified the robot may move as much as this much across it, else it stops first."""
    aslant = 0.35
    (own,) = robots([(2.5, 1.0)])
    own = own._replace(vx_m_s=V_MAX * math.cos(aslant), vy_m_s=-V_MAX * math.sin(aslant))
    across = V_MAX * math.sin(aslant) * age_s
    for spare, allowed in ((-1e-6, False), (1e-6, True)):
        at = own._replace(y_m=CAPABILITIES.tube_m + across + spare)
        assert (planner(EMPTY).certify(seen(at, now_s=age_s), 2.6, at.y_m) >= 0.0) is allowed


@settings(max_examples=300)
@given(boxes(), st.tuples(st.floats(-0.2, 5.2), st.floats(-0.2, 5.2)), angles, st.floats(0.02, 0.2))
def test_a_static_margin_that_is_negative_may_only_rise(
    some: tuple[Box, ...], at: Point, angle: float, length: float
) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    (own,) = robots([at])
    end = (at[0] + length * math.cos(angle), at[1] + length * math.sin(angle))
    if planner(terrain).certify(seen(own), *end) < 0.0:
        return
    fence, clear = fence_m(*at), clear_m(terrain, *at)
    for x, y in between(at, end):
        assert fence_m(x, y) >= min(fence, 0.0) - 1e-9
        assert clear_m(terrain, x, y) >= min(clear, 0.0) - 1e-9


def corner_beside_a_wall() -> tuple[Terrain, At, Point]:
    """Leaving a wall past the corner of another box: the clearance rises at both ends and dips in the middle."""
    start = (0.105 + 0.0005, 2.0)
    corner = Box(start[0] + 0.023, 2.0 + 0.104, start[0] + 0.024, 3.0)
    terrain = Terrain(Workspace(5.0, 5.0, (Box(-1.0, 0.0, 0.0, 5.0), corner), ()), RADIUS_M)
    return terrain, At(*start), (start[0] + 0.046, 2.0)


def test_leaving_one_box_is_no_excuse_for_touching_another() -> None:
    terrain, own, end = corner_beside_a_wall()
    assert terrain.clearance_m(*end) > terrain.clearance_m(own.x_m, own.y_m) >= 0.0
    assert min(clear_m(terrain, x, y) for x, y in between((own.x_m, own.y_m), end)) < 0.0
    assert planner(terrain, RecoveryRules(fence=False)).certify(seen(own), *end) < 0.0


def test_a_robot_inside_a_box_may_leave_it() -> None:
    (own,) = robots([(2.02, 0.5)])
    recovery = planner()
    assert recovery.certify(seen(own), 1.97, 0.5) >= 0.0
    assert recovery.certify(seen(own), 2.07, 0.5) < 0.0


def test_rules_that_are_off_are_not_tested() -> None:
    pair = robots([(0.01, 2.0), (0.2, 2.0)])
    out = (-0.04, 2.0)
    assert planner(EMPTY).certify(seen(pair[0], pair), *out) < 0.0
    assert planner(EMPTY, RecoveryRules(fence=False)).certify(seen(pair[0], pair), *out) >= 0.0
    assert planner(EMPTY, RecoveryRules(pairs=False)).certify(seen(pair[0], pair), 0.05, 2.0) >= 0.0
    (box,) = robots([(1.9, 0.5)])
    assert planner(TERRAIN).certify(seen(box), 1.95, 0.5) < 0.0
    assert planner(TERRAIN, RecoveryRules(boxes=False)).certify(seen(box), 1.95, 0.5) >= 0.0


# --- motions -----------------------------------------------------------------------------------------------


@given(inside, inside, angles)
@example((2.5, 2.0), (2.5, 2.0), 0.0)
def test_a_leg_is_short_certified_and_driven_the_way_that_turns_less(at: Point, to: Point, heading: float) -> None:
    assume(clear_m(TERRAIN, *at) >= 0.0)
    own = At(*at, heading_rad=heading)
    recovery = planner()
    look = seen(own)
    leg = recovery.towards(look, [to])
    if leg is None:
        return
    assert recovery.certify(look, leg.x_m, leg.y_m) >= 0.0
    assert 0.02 <= math.dist(at, (leg.x_m, leg.y_m)) <= LEG_M + 1e-9
    bearing = math.atan2(leg.y_m - at[1], leg.x_m - at[0])
    assert leg.heading_rad is not None
    assert abs(math.remainder(leg.heading_rad - heading, math.tau)) <= math.pi / 2.0 + 1e-9
    assert abs(math.sin(leg.heading_rad - bearing)) < 1e-6
    if min(fence_m(*at), clear_m(TERRAIN, *at)) >= recovery.path_m:
        # Nearer to something than paths are it may lead away from that first.
        assert abs(math.remainder(bearing - math.atan2(to[1] - at[1], to[0] - at[0]), math.tau)) < 1e-6
    leg.check()


def test_a_robot_that_cannot_reverse_gets_no_heading() -> None:
    recovery = RecoveryPlanner(EMPTY, replace(CAPABILITIES, reverses=False), RecoveryRules(), TICK_S)
    leg = recovery.towards(seen(At(2.0, 2.0, heading_rad=math.pi)), [(3.0, 2.0)])
    assert leg is not None
    assert leg.heading_rad is None


@pytest.mark.parametrize(("angle", "goes"), [(0.0, True), (0.3, True), (0.4, False), (1.6, False), (3.1, False)])
def test_a_moving_robot_stops_before_it_goes_another_way(angle: float, goes: bool) -> None:
    own = At(2.0, 2.0, vx_m_s=0.2 * math.cos(angle), vy_m_s=0.2 * math.sin(angle))
    assert (planner(EMPTY).towards(seen(own), [(3.0, 2.0)]) is not None) is goes
    assert (planner(EMPTY).away(seen(own), 1.0, 0.0, anywhere) is not None) is goes


def anywhere(x_m: float, y_m: float) -> bool:
    return True


def test_away_ends_only_where_a_path_leads_back_unless_there_is_none_now() -> None:
    def west(x_m: float, y_m: float) -> bool:
        return x_m <= 2.0

    leg = planner(EMPTY).away(seen(At(2.0, 2.0)), 1.0, 1.0, west)
    assert leg is not None
    assert leg.x_m <= 2.0 < leg.y_m
    assert planner(EMPTY).away(seen(At(2.1, 2.0)), 1.0, 1.0, west) == planner(EMPTY).away(
        seen(At(2.1, 2.0)), 1.0, 1.0, anywhere
    )


def test_away_takes_the_certified_direction_that_leads_farthest() -> None:
    pair = robots([(0.03, 2.0), (0.4, 2.0)])
    leg = planner(EMPTY).away(seen(pair[0], pair), -1.0, 0.0, anywhere)
    assert leg is None or leg.x_m >= 0.02
    free = planner(EMPTY).away(seen(At(2.0, 2.0)), 1.0, 1.0, anywhere)
    assert free is not None
    assert math.atan2(free.y_m - 2.0, free.x_m - 2.0) == pytest.approx(math.pi / 4.0)


def look_at(*places: Point) -> Situation:
    samples = robots(list(places))
    return seen(samples[0], samples)


@pytest.mark.parametrize(
    ("look", "improves"),
    [
        (look_at((-0.1, 2.0)), lambda x, y: x > -0.1),
        (look_at((3.8, 2.0), (4.0, 2.0)), lambda x, y: x < 3.8),
        (look_at((1.92, 0.5)), lambda x, y: x < 1.92),
    ],
)
def test_where_no_motion_keeps_every_rule_the_best_is_taken_and_counted(look: Situation, improves: object) -> None:
    recovery = planner()
    leg = recovery.hold(look)
    assert recovery.no_certified_motion == 1
    assert leg is not None
    assert callable(improves)
    assert improves(leg.x_m, leg.y_m)


def test_a_slow_robot_that_has_left_gets_a_leg_long_enough_not_to_count_as_arrived() -> None:
    slow = replace(CAPABILITIES, v_max_m_s=0.05)
    recovery = RecoveryPlanner(TERRAIN, slow, RecoveryRules(), TICK_S)
    leg = recovery.hold(look_at((-0.1, 2.0)))
    assert leg is not None
    assert leg.x_m >= -0.1 + LEAST_LEG_M * 0.9


def test_holding_where_all_is_well_is_no_motion_and_not_counted() -> None:
    recovery = planner()
    assert recovery.hold(look_at((2.5, 2.0), (2.5, 1.7))) is None
    assert recovery.no_certified_motion == 0
    assert recovery.towards(look_at((2.5, 2.0)), []) is None
    assert recovery.towards(look_at((2.5, 2.0)), [(2.51, 2.0)]) is None, "it is there"


class Fails(Region):
    """Knows nothing of the east."""

    def margin(self, situation: Situation) -> float:
        if situation.own.x_m > 2.02:
            raise RuntimeError("no map here")
        return 1.0

    def edge_margin(self, safer: Region) -> float:
        return 0.0


def test_a_rule_of_the_users_that_fails_allows_no_leg_and_fails_nobody() -> None:
    recovery = planner(EMPTY)
    recovery.own_rules = [OwnRule(Fails(), of_pairs=False)]
    assert recovery.towards(seen(At(2.0, 2.0)), [(3.0, 2.0)]) is None
    assert recovery.towards(seen(At(2.0, 2.0)), [(1.0, 2.0)]) is not None
