"""No acceleration, from no state, takes a point out of its reach tube in space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import DirectedReach, PointMassBound, Situation, Threat
from tests.rta.doubles import At

V_MAX, ACCEL, BRAKE = 5.0, 3.0, 2.0
CLIMB, SINK, CLIMB_ACCEL, CLIMB_BRAKE = 2.5, 1.5, 4.0, 3.0
COPTER = PointMassBound(V_MAX, ACCEL, BRAKE, CLIMB, SINK, CLIMB_ACCEL, CLIMB_BRAKE)
STEP_S = 0.02
SLACK_M = 1e-9
DIRECTIONS = [
    (math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e))
    for a in (k * math.pi / 6 for k in range(12))
    for e in (-math.pi / 2, -0.7, 0.0, 0.4, math.pi / 2)
]

Pushed = tuple[float, float, float]

shares = st.floats(-1.0, 1.0)
angles = st.floats(-math.pi, math.pi)
pushes = st.one_of(
    st.tuples(angles, st.floats(0.0, 1.0), shares),
    st.tuples(angles, st.sampled_from([0.0, 1.0]), st.sampled_from([-1.0, 0.0, 1.0])),
)
inputs = st.lists(pushes, min_size=1, max_size=12)
states = st.tuples(angles, st.floats(0.0, 1.0), st.floats(-SINK, CLIMB))


class Point:
    """A point that is pushed, horizontally and vertically; what is beyond a top speed does not push."""

    def __init__(self, heading: float, share: float, climb: float) -> None:
        self.x = self.y = self.z = 0.0
        self.vx, self.vy = share * V_MAX * math.cos(heading), share * V_MAX * math.sin(heading)
        self.vz = climb

    def sample(self, stamp_s: float = 0.0) -> At:
        return At(self.x, self.y, stamp_s, vx_m_s=self.vx, vy_m_s=self.vy, z_m=self.z, vz_m_s=self.vz)

    def push(self, angle: float, share: float, up: float) -> None:
        vx, vy = (
            self.vx + share * ACCEL * STEP_S * math.cos(angle),
            self.vy + share * ACCEL * STEP_S * math.sin(angle),
        )
        speed = math.hypot(vx, vy)
        if speed > V_MAX:
            vx, vy = self.vx, self.vy
        self._move(vx, vy, min(CLIMB, max(-SINK, self.vz + up * CLIMB_ACCEL * STEP_S)))

    def brake(self) -> None:
        speed = math.hypot(self.vx, self.vy)
        part = max(0.0, 1.0 - BRAKE * STEP_S / speed) if speed > 0.0 else 0.0
        vz = math.copysign(max(0.0, abs(self.vz) - CLIMB_BRAKE * STEP_S), self.vz)
        self._move(part * self.vx, part * self.vy, vz)

    def _move(self, vx: float, vy: float, vz: float) -> None:
        # Exact while the velocity changes at a constant rate; where it reaches 0 within the step it is no less.
        self.x += 0.5 * (self.vx + vx) * STEP_S
        self.y += 0.5 * (self.vy + vy) * STEP_S
        self.z += 0.5 * (self.vz + vz) * STEP_S
        self.vx, self.vy, self.vz = vx, vy, vz


LAST_STEP_M = math.hypot(BRAKE, CLIMB_BRAKE) * STEP_S * STEP_S / 2.0
"""What the step in which a point comes to rest may be too long."""


@given(start=states, pushed=inputs, each=st.integers(1, 8))
def test_no_push_leaves_the_tube_stopping_included(
    start: tuple[float, float, float], pushed: list[Pushed], each: int
) -> None:
    point = Point(*start)
    sample = point.sample()
    places = [(0.0, 0.0, 0.0)]
    for push in pushed:
        for _ in range(each):
            point.push(*push)
            places.append((point.x, point.y, point.z))
    time_s = len(pushed) * each * STEP_S
    while point.vx or point.vy or point.vz:
        point.brake()
        places.append((point.x, point.y, point.z))
    reach = COPTER.reach(Situation(1, sample, 0.0), time_s)
    assert reach <= COPTER.bound(time_s) + SLACK_M
    assert max(math.hypot(*place) for place in places) <= reach + LAST_STEP_M
    for u in DIRECTIONS:
        extent = COPTER.extent(sample, time_s, *u)
        assert extent <= reach + SLACK_M
        assert max(dot(u, place) for place in places) <= extent + LAST_STEP_M


def dot(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


@given(start=states, pushed=inputs)
def test_every_sample_of_a_point_is_admitted(start: tuple[float, float, float], pushed: list[Pushed]) -> None:
    point = Point(*start)
    before = point.sample()
    for number, push in enumerate(pushed, start=1):
        point.push(*push)
        after = point.sample(number * STEP_S)
        assert COPTER.admits(before, after, 0.0)
        before = after


def test_full_thrust_uses_up_the_tube() -> None:
    for start, u, up in (
        ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), 0.0),
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.0),
        ((0.0, 0.0, CLIMB), (0.0, 0.0, 1.0), 1.0),
        ((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), -1.0),
    ):
        point = Point(*start)
        sample = point.sample()
        for _ in range(50):
            point.push(0.0, 1.0 if up == 0.0 else 0.0, up)
        while point.vx or point.vy or point.vz:
            point.brake()
        far = dot(u, (point.x, point.y, point.z))
        # Less than one push below the top speed, which this point does not get past.
        assert far >= 0.97 * COPTER.extent(sample, 1.0, *u)


def test_a_copter_that_flies_away_gets_back_later() -> None:
    away = At(vx_m_s=-V_MAX, vz_m_s=0.0)
    assert COPTER.extent(away, 1.0, 1.0, 0.0) == 0.0
    assert COPTER.extent(away, 1.0, -1.0, 0.0) == pytest.approx(V_MAX + V_MAX**2 / (2.0 * BRAKE))
    assert 0.0 < COPTER.extent(away, 5.0, 1.0, 0.0) < COPTER.extent(At(vz_m_s=0.0), 5.0, 1.0, 0.0)


def test_an_unknown_vertical_speed_is_the_top_speed() -> None:
    unknown = COPTER.extent(At(), 1.0, 0.0, 0.0, 1.0)
    assert unknown == pytest.approx(COPTER.extent(At(vz_m_s=CLIMB), 1.0, 0.0, 0.0, 1.0))
    assert COPTER.extent(At(), 1.0, 0.0, 0.0, -1.0) == pytest.approx(SINK + SINK**2 / (2.0 * CLIMB_BRAKE))


AFTER = At(stamp_s=STEP_S, vz_m_s=0.0)


@pytest.mark.parametrize(
    "wrong",
    [
        AFTER._replace(x_m=0.01),
        AFTER._replace(z_m=0.06),
        AFTER._replace(z_m=-0.04),
        AFTER._replace(vx_m_s=ACCEL * STEP_S + 1e-6),
        AFTER._replace(vz_m_s=CLIMB_ACCEL * STEP_S + 1e-6),
        AFTER._replace(stamp_s=-STEP_S),
        AFTER._replace(x_m=math.nan),
        AFTER._replace(vx_m_s=math.nan),
        AFTER._replace(z_m=math.nan),
    ],
)
def test_a_sample_that_no_point_gets_to_is_not_admitted(wrong: At) -> None:
    assert not COPTER.admits(At(vz_m_s=0.0), wrong, 0.0)
    assert COPTER.admits(At(vz_m_s=0.0), AFTER, 0.0)


@dataclass(frozen=True)
class Ceiling:
    """Heights below a ceiling."""

    height_m: float

    def margin(self, situation: Situation) -> float:
        return self.height_m - situation.own.z_m

    def threats(self, situation: Situation) -> list[Threat]:
        return [Threat(self.margin(situation), 0.0, 0.0, 1.0)]


def test_a_ceiling_is_near_for_who_climbs_only() -> None:
    reach = DirectedReach(Ceiling(10.0), COPTER)
    sinking, climbing, level = (
        Situation(1, At(z_m=9.0, vx_m_s=V_MAX, vz_m_s=climb), 0.0) for climb in (-SINK, CLIMB, 0.0)
    )
    assert reach.reach(sinking, 0.2) == 0.0
    assert 0.0 < reach.reach(level, 0.2) < 1.0 < reach.reach(climbing, 0.2)
