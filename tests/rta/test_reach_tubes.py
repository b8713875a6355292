"""No input, from no state, leaves a reach tube, stopping included; and tubes are not much larger than that."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given

from soter.rta import Motion, PointMassBound, SpeedAccelerationBound, UnicycleBound
from tests.rta.doubles import At, situation
from tests.rta.unicycles import (
    ACCEL,
    ALONG,
    BOTH_WAYS,
    BRAKE,
    DIRECTIONS,
    FINE,
    FORWARDS_ONLY,
    MOTIONS,
    PERIOD_S,
    SLACK_M,
    STEP_S,
    UNICYCLES,
    V_MAX,
    YAW_MAX,
    Input,
    Unicycle,
    angles,
    drive,
    farthest,
    inputs,
    moving,
    shares,
    situation_of,
    times,
)


@pytest.mark.parametrize("model", UNICYCLES)
@given(driven=inputs, heading=angles, share=shares)
def test_no_input_leaves_the_tube_of_a_unicycle(
    model: UnicycleBound, driven: list[Input], heading: float, share: float
) -> None:
    start = moving(heading, share * (model.forward_m_s if share > 0.0 else model.reverse_m_s))
    places = drive(model, start, driven)
    time_s = PERIOD_S * len(driven)
    for ux, uy in DIRECTIONS:
        assert farthest(places, ux, uy) <= model.extent(start, time_s, ux, uy) + SLACK_M


@given(driven=inputs, heading=angles, share=shares)
def test_no_input_leaves_the_disc_of_a_robot_whose_speed_counts(
    driven: list[Input], heading: float, share: float
) -> None:
    start = moving(heading, share * V_MAX)
    reach = ALONG.reach(situation_of(start), PERIOD_S * len(driven)) + SLACK_M
    assert max(math.hypot(x, y) for x, y in drive(BOTH_WAYS, start, driven)) <= reach


@pytest.mark.parametrize("model", MOTIONS)
@given(time_s=times, heading=angles, share=shares, angle=angles)
def test_no_reach_is_more_than_the_bound_and_no_extent_more_than_the_reach(
    model: Motion, time_s: float, heading: float, share: float, angle: float
) -> None:
    sample = moving(heading, share * V_MAX)
    reach = model.reach(situation_of(sample), time_s)
    assert reach <= model.bound(time_s) + 1e-12
    extent = model.extent(sample, time_s, math.cos(angle), math.sin(angle))
    assert 0.0 <= extent <= reach + 1e-12


@pytest.mark.parametrize("model", MOTIONS)
@given(one=times, other=times, heading=angles, share=shares)
def test_extents_grow_with_time(model: Motion, one: float, other: float, heading: float, share: float) -> None:
    sample = moving(heading, share * V_MAX)
    shorter, longer = min(one, other), max(one, other)
    for ux, uy in DIRECTIONS[::5]:
        assert model.extent(sample, shorter, ux, uy) <= model.extent(sample, longer, ux, uy) + 1e-9


@pytest.mark.parametrize("model", UNICYCLES[:3])
@given(time_s=times, heading=angles, share=shares)
def test_the_closed_form_is_the_integral(model: UnicycleBound, time_s: float, heading: float, share: float) -> None:
    sample = moving(heading, share * V_MAX)
    count = 500
    for ux, uy in DIRECTIONS[:1]:
        ahead = math.acos(max(-1.0, min(1.0, ux * math.cos(heading) + uy * math.sin(heading))))
        sums = [0.0, 0.0]
        for end, (angle, speed, most) in enumerate(
            (
                (ahead, max(0.0, share) * V_MAX, model.forward_m_s),
                (math.pi - ahead, max(0.0, -share) * V_MAX, model.reverse_m_s),
            )
        ):

            def along(t: float, angle: float = angle) -> float:
                return max(0.0, math.cos(max(0.0, angle - model.yaw_rate_max_rad_s * t)))

            def at(t: float, speed: float = speed, most: float = most) -> float:
                return min(most, speed + ACCEL * t)

            step_s = time_s / count
            sums[end] = sum(at(t) * along(t) for t in ((k + 0.5) * step_s for k in range(count))) * step_s
            rests_s = at(time_s) / BRAKE
            for k in range(count):
                after_s = (k + 0.5) * rests_s / count
                sums[end] += (at(time_s) - BRAKE * after_s) * along(time_s + after_s + STEP_S) * rests_s / count
        extent = model.extent(sample, time_s, ux, uy)
        assert extent <= sum(sums) + 5e-5
        assert extent >= max(sums) - 5e-5


# --- how tight they are ------------------------------------------------------------------------------------


def greedy(model: UnicycleBound, start: At, time_s: float, ux: float, uy: float) -> float:
    """Return how far the robot gets that turns to the direction by the shorter way, and drives when that helps."""
    speed = start.vx_m_s * math.cos(start.heading_rad) + start.vy_m_s * math.sin(start.heading_rad)
    best = 0.0
    for gear in (1.0, -1.0):
        robot = Unicycle(model, start.heading_rad, speed, STEP_S)
        far, steps = 0.0, round(time_s / robot.step_s)
        while steps > 0 or robot.v != 0.0:
            steps -= 1
            error = math.remainder(math.atan2(uy, ux) - robot.heading - (math.pi if gear < 0.0 else 0.0), math.tau)
            w = max(-1.0, min(1.0, error / (model.yaw_rate_max_rad_s * robot.step_s)))
            v = gear if steps >= 0 and abs(error) < math.pi / 2 else 0.0
            robot.step(v, w, BRAKE if steps < 0 else math.inf)
            far = max(far, robot.x * ux + robot.y * uy)
        best = max(best, far)
    return best


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0, math.pi / 2, 2.5, math.pi])
@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
@pytest.mark.parametrize("time_s", [0.15, 0.5, 1.05])
def test_somebody_gets_nearly_as_far_as_the_tube_allows(angle: float, share: float, time_s: float) -> None:
    start = moving(0.0, share * V_MAX)
    ux, uy = math.cos(angle), math.sin(angle)
    for model in (BOTH_WAYS, FORWARDS_ONLY):
        extent, far = model.extent(start, time_s, ux, uy), greedy(model, start, time_s, ux, uy)
        # Across and backwards the tube lets the robot gain speed and turn at the same time; never by much, though.
        assert far >= (0.95 * extent if angle <= 1.0 else extent - 0.3 * model.bound(time_s))


def test_driving_straight_on_uses_up_the_tube() -> None:
    for share in (1.0, 0.3, 0.0):
        start = moving(0.7, share * V_MAX)
        far = greedy(BOTH_WAYS, start, 1.0, math.cos(0.7), math.sin(0.7))
        assert far == pytest.approx(BOTH_WAYS.extent(start, 1.0, math.cos(0.7), math.sin(0.7)), rel=0.01)


def test_a_robot_that_faces_away_is_far_from_where_it_came_from() -> None:
    away, towards, aside = moving(math.pi, V_MAX), moving(0.0, V_MAX), moving(math.pi / 2, V_MAX)
    bound = BOTH_WAYS.bound(0.15)
    assert BOTH_WAYS.extent(towards, 0.15, 1.0, 0.0) == pytest.approx(bound)
    assert BOTH_WAYS.extent(away, 0.15, 1.0, 0.0) < 0.5 * bound
    assert BOTH_WAYS.extent(aside, 0.15, 1.0, 0.0) < 0.5 * bound
    assert FORWARDS_ONLY.extent(away, 0.15, 1.0, 0.0) == 0.0


# --- what is admitted --------------------------------------------------------------------------------------


@given(driven=inputs, heading=angles, share=shares)
def test_every_sample_of_a_unicycle_is_admitted(driven: list[Input], heading: float, share: float) -> None:
    robot = Unicycle(BOTH_WAYS, heading, share * V_MAX, STEP_S)
    before = moving(heading, share * V_MAX)
    for number, (v, w) in enumerate(driven, start=1):
        for _ in range(FINE):
            robot.step(v, w, 5.0)
        after = moving(robot.heading, robot.v)._replace(x_m=robot.x, y_m=robot.y, stamp_s=number * PERIOD_S)
        for model in (ALONG, BOTH_WAYS):
            assert model.admits(before, after, 0.0)
        before = after


class Wrong(NamedTuple):
    """A sample a period after one at rest in the origin, heading east."""

    what: str
    sample: At


AFTER = At(stamp_s=PERIOD_S)
WRONG = [
    Wrong("sideways", AFTER._replace(y_m=0.003)),
    Wrong("too far", AFTER._replace(x_m=0.5 * ACCEL * PERIOD_S**2 + 1e-6)),
    Wrong("too fast", AFTER._replace(vx_m_s=ACCEL * PERIOD_S + 1e-6)),
    Wrong("turned too far", AFTER._replace(heading_rad=YAW_MAX * PERIOD_S + 1e-6)),
    Wrong("before", AFTER._replace(stamp_s=-PERIOD_S)),
    Wrong("not a number", AFTER._replace(x_m=math.nan)),
    Wrong("no speed", AFTER._replace(vx_m_s=math.nan)),
    Wrong("no heading", AFTER._replace(heading_rad=math.nan)),
]


@pytest.mark.parametrize("wrong", WRONG, ids=[wrong.what for wrong in WRONG])
def test_a_sample_that_no_unicycle_gets_to_is_not_admitted(wrong: Wrong) -> None:
    assert not BOTH_WAYS.admits(At(), wrong.sample, 0.0)
    assert BOTH_WAYS.admits(At(), AFTER, 0.0)


@pytest.mark.parametrize("model", MOTIONS)
def test_a_speed_that_is_no_number_is_the_top_speed(model: Motion) -> None:
    for ux, uy in DIRECTIONS:
        extent = model.extent(At(vx_m_s=math.nan), 1.0, ux, uy)
        assert extent == pytest.approx(model.bound(1.0))
    assert model.reach(situation_of(At(vx_m_s=math.nan)), 1.0) == pytest.approx(model.bound(1.0))


@pytest.mark.parametrize("model", UNICYCLES)
def test_a_heading_that_is_no_number_may_be_any(model: UnicycleBound) -> None:
    for ux, uy in DIRECTIONS:
        unsure = model.extent(At(heading_rad=math.nan, vx_m_s=math.nan), 1.0, ux, uy)
        assert unsure == pytest.approx(model.bound(1.0))


# --- what cannot be -----------------------------------------------------------------------------------------


REFUSED: list[tuple[Callable[[float], object], str]] = [
    (lambda value: SpeedAccelerationBound(value, 1.0, 1.0), "v_max_m_s"),
    (lambda value: SpeedAccelerationBound(0.2, value, 1.0), "accel_m_s2"),
    (lambda value: SpeedAccelerationBound(0.2, 1.0, value), "brake_m_s2"),
    (lambda value: UnicycleBound(value, 1.0, 1.0, 1.0, 0.2), "v_max_m_s"),
    (lambda value: UnicycleBound(0.2, 1.0, 1.0, value, 0.2), "yaw_rate_max_rad_s"),
    (lambda value: PointMassBound(1.0, 1.0, 1.0, value, 1.0, 1.0, 1.0), "climb_m_s"),
    (lambda value: PointMassBound(1.0, 1.0, 1.0, 1.0, value, 1.0, 1.0), "sink_m_s"),
    (lambda value: PointMassBound(1.0, 1.0, 1.0, 1.0, 1.0, value, 1.0), "climb_accel_m_s2"),
    (lambda value: PointMassBound(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, value), "climb_brake_m_s2"),
]


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(("make", "name"), REFUSED)
def test_limits_that_cannot_be_are_refused(make: Callable[[float], object], name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} is .*allowed: above 0"):
        make(value)


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_noises_that_cannot_be_are_refused(value: float) -> None:
    for make in (
        lambda: SpeedAccelerationBound(0.2, 1.0, 1.0, value),
        lambda: UnicycleBound(0.2, 1.0, 1.0, 1.0, value),
        lambda: UnicycleBound(0.2, 1.0, 1.0, 1.0, 0.2, 0.0, value),
        lambda: PointMassBound(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, value),
    ):
        with pytest.raises(ValueError, match="allowed: 0 or more"):
            make()


def test_a_robot_at_rest_gets_less_far_than_one_at_speed() -> None:
    rest = ALONG.reach(situation(), 0.15)
    assert rest == pytest.approx(0.5 * 0.15**2 + 0.15**2 / (2.0 * BRAKE))
    assert rest < 0.5 * ALONG.bound(0.15)
    assert ALONG.reach(situation_of(moving(0.0, V_MAX)), 0.15) == pytest.approx(ALONG.bound(0.15))
