"""Robots that drive like unicycles, integrated exactly, and what is drawn for them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from hypothesis import strategies as st

from soter.rta import Motion, Sample, Situation, SpeedAccelerationBound, UnicycleBound
from tests.rta.doubles import At

V_MAX, ACCEL, BRAKE, YAW_MAX = 0.22, 1.0, 0.8, 2.84
PERIOD_S = 0.05
FINE = 5
"""Steps of the integrator in one period; each is an exact arc."""

SLACK_M = 1e-9

ALONG = SpeedAccelerationBound(V_MAX, ACCEL, BRAKE)
STEP_S = PERIOD_S / FINE
BOTH_WAYS = UnicycleBound(V_MAX, ACCEL, BRAKE, YAW_MAX, V_MAX, period_s=STEP_S)
SLOW_BACK = UnicycleBound(V_MAX, ACCEL, BRAKE, YAW_MAX, 0.05, period_s=STEP_S)
FORWARDS_ONLY = UnicycleBound(V_MAX, ACCEL, BRAKE, YAW_MAX, 0.0, period_s=STEP_S)
SLOW_TURN = UnicycleBound(V_MAX, ACCEL, BRAKE, 0.002, V_MAX, period_s=STEP_S)
UNICYCLES = [BOTH_WAYS, SLOW_BACK, FORWARDS_ONLY, SLOW_TURN]
MOTIONS: list[Motion] = [ALONG, *UNICYCLES]
DIRECTIONS = [(math.cos(k * math.pi / 12), math.sin(k * math.pi / 12)) for k in range(24)]

Input = tuple[float, float]
Place = tuple[float, float]

times = st.floats(0.0, 3.0)
angles = st.floats(-math.pi, math.pi)
shares = st.floats(-1.0, 1.0)
extremes = st.sampled_from([-1.0, 0.0, 1.0])
inputs = st.one_of(
    st.lists(st.tuples(shares, shares), min_size=1, max_size=30),
    st.lists(st.tuples(extremes, extremes), min_size=1, max_size=30),
    # One input for long, then another: what bang-bang control does.
    st.lists(st.tuples(extremes, extremes, st.integers(1, 15)), min_size=1, max_size=4).map(
        lambda parts: [(v, w) for v, w, count in parts for _ in range(count)]
    ),
)


class Unicycle:
    """A robot that is told a share of its top speed and turn rate, and turns at any rate at once.

    Speed grows as the model allows, and falls as fast as it likes, to 0 at once; it never falls short of BRAKE.
    """

    def __init__(self, model: UnicycleBound, heading: float, speed: float, step_s: float) -> None:
        self.model = model
        self.x = self.y = 0.0
        self.heading = heading
        self.v = speed
        self.step_s = step_s

    def step(self, v: float, w: float, slower: float) -> None:
        model, step_s = self.model, self.step_s
        wanted = v * (model.forward_m_s if v > 0.0 else model.reverse_m_s)
        if wanted * self.v < 0.0:
            self.v = 0.0
        was, sign = abs(self.v), math.copysign(1.0, wanted or self.v)
        if abs(wanted) > was:
            now = min(abs(wanted), was + model.accel_m_s2 * step_s)
            length = 0.5 * (was + now) * step_s
        else:
            now = max(abs(wanted), was - slower * step_s)
            # As long as it takes to slow down, and the rest of the step at the new speed.
            length = now * step_s + (was - now) ** 2 / (2.0 * slower)
        self.v = sign * now
        turn = w * model.yaw_rate_max_rad_s * step_s
        # The chord of a circular arc.
        chord = sign * length * (math.sin(turn / 2.0) / (turn / 2.0) if turn else 1.0)
        self.x += chord * math.cos(self.heading + turn / 2.0)
        self.y += chord * math.sin(self.heading + turn / 2.0)
        self.heading += turn


def drive(model: UnicycleBound, start: At, driven: Sequence[Input]) -> list[Place]:
    """Drive by the inputs, a period each, then brake to rest; return all places, relative to the start."""
    speed = start.vx_m_s * math.cos(start.heading_rad) + start.vy_m_s * math.sin(start.heading_rad)
    robot = Unicycle(model, start.heading_rad, speed, STEP_S)
    places = [(0.0, 0.0)]
    for v, w in driven:
        for _ in range(FINE):
            robot.step(v, w, math.inf if v == 0.0 else 5.0)
            places.append((robot.x, robot.y))
    while robot.v != 0.0:
        robot.step(0.0, driven[-1][1], BRAKE)
        places.append((robot.x, robot.y))
    return places


def moving(heading: float, speed: float) -> At:
    return At(heading_rad=heading, vx_m_s=speed * math.cos(heading), vy_m_s=speed * math.sin(heading))


def farthest(places: Iterable[Place], ux: float, uy: float) -> float:
    return max(x * ux + y * uy for x, y in places)


def situation_of(sample: Sample) -> Situation:
    return Situation(1, sample, 0.0)
