"""No input leaves a reach tube, and no sample is refused, within the noise that is declared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import SpeedAccelerationBound, UnicycleBound
from tests.rta.doubles import At
from tests.rta.unicycles import (
    ACCEL,
    BOTH_WAYS,
    BRAKE,
    DIRECTIONS,
    FINE,
    PERIOD_S,
    SLACK_M,
    STEP_S,
    V_MAX,
    YAW_MAX,
    Input,
    Unicycle,
    angles,
    drive,
    extremes,
    farthest,
    inputs,
    moving,
    shares,
)

noises = st.one_of(st.just(0.0), st.floats(0.0, 0.3))
heading_noises = st.one_of(st.just(0.0), st.floats(0.0, 0.6), st.floats(0.0, 3.2), st.just(math.pi / 2))
errors = st.one_of(shares, extremes)


class Noise(NamedTuple):
    """What a robot declares about its samples, and what is drawn of it for one of them.

    `along` is a robot that reports a speed along the heading that it reports; else a velocity, from anywhere.
    """

    position_m: float
    speed_m_s: float
    heading_rad: float
    along: bool

    def report(self, x: float, y: float, heading: float, v: float, stamp_s: float, drawn: Sequence[float]) -> At:
        far, place, off, way, turned = drawn
        seen = heading + turned * self.heading_rad
        far *= self.position_m
        if self.along:
            wrong = v + off * self.speed_m_s
            vx, vy = wrong * math.cos(seen), wrong * math.sin(seen)
        else:
            vx = v * math.cos(heading) + off * self.speed_m_s * math.cos(way * math.pi)
            vy = v * math.sin(heading) + off * self.speed_m_s * math.sin(way * math.pi)
        return At(
            x + far * math.cos(place * math.pi), y + far * math.sin(place * math.pi), stamp_s, heading_rad=seen,
            vx_m_s=vx, vy_m_s=vy,
        )  # fmt: skip


declared_noises = st.builds(Noise, noises, noises, heading_noises, st.booleans())
drawn_errors = st.tuples(errors, errors, errors, errors, errors)


# Robots that gain speed and turn slowly: no slack hides an error that is small at first.
SLUGGISH = [UnicycleBound(V_MAX, 0.02, BRAKE, 0.3, back, period_s=STEP_S) for back in (V_MAX, 0.1, 0.0)]


@pytest.mark.parametrize("exact", [BOTH_WAYS, *SLUGGISH])
@given(noise=declared_noises, driven=inputs, heading=angles, share=shares, drawn=st.lists(drawn_errors, min_size=1))
def test_no_input_leaves_a_tube_and_no_sample_is_refused_within_declared_noise(
    exact: UnicycleBound,
    noise: Noise,
    driven: list[Input],
    heading: float,
    share: float,
    drawn: list[tuple[float, ...]],
) -> None:
    unicycle = UnicycleBound(
        exact.forward_m_s, exact.accel_m_s2, BRAKE, exact.yaw_rate_max_rad_s, exact.reverse_m_s, noise.speed_m_s,
        noise.heading_rad, STEP_S,
    )  # fmt: skip
    along = SpeedAccelerationBound(V_MAX, exact.accel_m_s2, BRAKE, noise.speed_m_s)
    speed = share * (exact.forward_m_s if share > 0.0 else exact.reverse_m_s)
    seen = noise.report(0.0, 0.0, heading, speed, 0.0, drawn[0])
    places = drive(exact, moving(heading, speed), driven)
    time_s = PERIOD_S * len(driven)
    for ux, uy in DIRECTIONS:
        far = farthest(places, ux, uy) - SLACK_M
        assert far <= unicycle.extent(seen, time_s, ux, uy)
        assert far <= along.extent(seen, time_s, ux, uy)
    robot, before = Unicycle(exact, heading, speed, STEP_S), seen
    for number, (v, w) in enumerate(driven, start=1):
        for _ in range(FINE):
            robot.step(v, w, 5.0)
        after = noise.report(robot.x, robot.y, robot.heading, robot.v, number * PERIOD_S, drawn[number % len(drawn)])
        assert unicycle.admits(before, after, noise.position_m)
        assert along.admits(before, after, noise.position_m)
        before = after


@pytest.mark.parametrize("error", [0.1, 0.5, 1.5, 3.0])
@pytest.mark.parametrize("accel", [0.01, 1.0])
def test_a_robot_that_drives_straight_on_under_a_wrong_heading_stays_in_the_tube(error: float, accel: float) -> None:
    model = UnicycleBound(0.5, accel, 1.0, 0.01, 0.5, 0.0, error)
    seen = At(vx_m_s=0.5, heading_rad=error)
    for time_s in (0.0, 0.05, 0.5, 2.0):
        assert model.extent(seen, time_s, 1.0, 0.0) == pytest.approx(model.bound(time_s))
    assert model.admits(seen, seen._replace(x_m=0.025, stamp_s=0.05), 0.0)


def test_a_heading_that_is_nearly_right_tells_forwards_from_backwards() -> None:
    model = UnicycleBound(V_MAX, ACCEL, BRAKE, YAW_MAX, V_MAX, 0.01, 0.1)
    assert model.extent(moving(0.0, V_MAX), 0.15, -1.0, 0.0) < 0.5 * model.bound(0.15)
