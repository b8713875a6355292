"""Reach bounds hold for every input, and samples outside them are told apart."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import DischargeBound, PairBound, ReachModel, Situation, SpeedBound
from tests.rta.doubles import PAIR, SPEED, At, situation

V_MAX, BRAKE, YAW_MAX = 0.22, 1.0, 2.84
STEP_S = 0.01
Input = tuple[float, float]

inputs = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-4.0, 4.0)), min_size=1, max_size=40)


class Unicycle:
    """A robot that clamps what it is told and brakes at no less than `BRAKE`."""

    def __init__(self, heading: float = 0.0, speed: float = 0.0) -> None:
        self.x = self.y = 0.0
        self.heading = heading
        self.v = max(-V_MAX, min(V_MAX, speed))

    def step(self, v: float, yaw_rate: float) -> None:
        wanted = max(-V_MAX, min(V_MAX, v))
        self.v += max(-BRAKE * STEP_S, min(BRAKE * STEP_S, wanted - self.v))
        self.heading += max(-YAW_MAX, min(YAW_MAX, yaw_rate)) * STEP_S
        self.x += self.v * STEP_S * math.cos(self.heading)
        self.y += self.v * STEP_S * math.sin(self.heading)

    @property
    def away(self) -> float:
        return math.hypot(self.x, self.y)


def drive(robot: Unicycle, driven: list[Input]) -> list[tuple[float, float]]:
    """Drive by the inputs, ten steps each, then brake to rest; return positions at every step."""
    places = []
    for v, yaw_rate in driven:
        for _ in range(10):
            robot.step(v, yaw_rate)
            places.append((robot.x, robot.y))
    while robot.v != 0.0:
        robot.step(0.0, driven[-1][1])
        places.append((robot.x, robot.y))
    return places


@given(inputs, st.floats(-math.pi, math.pi), st.floats(-0.22, 0.22))
def test_no_input_leaves_the_speed_bound_stopping_included(driven: list[Input], heading: float, v: float) -> None:
    places = drive(Unicycle(heading, v), driven)
    # One step of braking more than the closed form, because this model moves at the speed that a step ends with.
    bound = SPEED.bound(0.1 * len(driven)) + V_MAX * STEP_S
    assert max(math.hypot(x, y) for x, y in places) <= bound


def test_the_speed_bound_is_tight() -> None:
    robot = Unicycle(0.0, V_MAX)
    drive(robot, [(V_MAX, 0.0)] * 10)
    assert robot.away == pytest.approx(SPEED.bound(1.0), abs=V_MAX * STEP_S)


@given(inputs, inputs, st.floats(0.1, 2.0))
def test_two_robots_close_in_by_no_more_than_the_pair_bound(one: list[Input], two: list[Input], gap: float) -> None:
    count = min(len(one), len(two))
    first, second = drive(Unicycle(0.0, V_MAX), one[:count]), drive(Unicycle(math.pi, V_MAX), two[:count])
    least = min(math.hypot(ax - gap - bx, ay - by) for (ax, ay), (bx, by) in zip(first, second, strict=False))
    assert gap - least <= PAIR.bound(0.1 * count) + 2.0 * V_MAX * STEP_S


@given(inputs, st.floats(-math.pi, math.pi))
def test_every_sample_of_a_robot_that_keeps_to_the_model_is_admitted(driven: list[Input], heading: float) -> None:
    places = drive(Unicycle(heading, V_MAX), driven)
    for step in range(5, len(places)):
        before, after = places[step - 5], places[step]
        assert SPEED.admits(At(*before, stamp_s=1.0), At(*after, stamp_s=1.0 + 5 * STEP_S), 0.0)


@given(st.floats(0.0, 10.0), st.floats(0.0, 0.1), st.floats(-math.pi, math.pi))
def test_a_sample_beyond_the_reach_set_is_not_admitted(time_s: float, noise_m: float, angle: float) -> None:
    allowed = V_MAX * time_s + 2.0 * noise_m
    for far, admitted in ((allowed - 1e-6, True), (allowed + 1e-6, False)):
        after = At(far * math.cos(angle), far * math.sin(angle), stamp_s=time_s)
        if far >= 0.0:
            assert SPEED.admits(At(), after, noise_m) is admitted
            assert PAIR.admits(At(), after, noise_m) is admitted


def test_a_sample_that_is_no_number_is_not_admitted() -> None:
    assert not SPEED.admits(At(), At(math.nan, stamp_s=1.0), 0.0)
    assert not SPEED.admits(At(), At(stamp_s=math.nan), 0.0)


DISCHARGE = DischargeBound(1.0 / 1800.0, 0.22, 0.002)


@given(st.floats(0.0, 100.0), st.floats(0.0, 1.0))
def test_a_charge_that_falls_faster_than_at_driving_power_is_not_admitted(time_s: float, charge: float) -> None:
    fall = time_s / 1800.0
    before = At(battery=charge)
    assert DISCHARGE.admits(before, At(stamp_s=time_s, battery=charge - fall), 0.0)
    assert DISCHARGE.admits(before, At(stamp_s=time_s, battery=1.0), 0.0), "charging is no surprise"
    assert not DISCHARGE.admits(before, At(stamp_s=time_s, battery=charge - fall - 1e-5), 0.0)


def test_a_battery_that_appears_or_disappears_is_not_admitted() -> None:
    assert not DISCHARGE.admits(At(battery=None), At(battery=0.5), 0.0)
    assert not DISCHARGE.admits(At(battery=0.5), At(battery=None), 0.0)
    assert DISCHARGE.admits(At(battery=None), At(battery=None), 0.0)
    assert not DISCHARGE.admits(At(battery=0.5), At(battery=math.nan), 0.0)


@given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_bounds_grow_with_time(one: float, other: float) -> None:
    for model in (SPEED, PAIR, DISCHARGE):
        assert model.bound(min(one, other)) <= model.bound(max(one, other))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_speeds_and_brakes_that_cannot_be_are_refused(value: float) -> None:
    for make in (lambda: SpeedBound(value, 1.0), lambda: SpeedBound(0.22, value)):
        assert_refused(make)


def assert_refused(make: Callable[[], ReachModel]) -> None:
    with pytest.raises(ValueError, match="allowed: above 0"):
        make()


def test_a_model_that_looks_at_the_state_says_so() -> None:
    class AtRest(SpeedBound):
        def reach(self, situation: Situation, time_s: float) -> float:
            return 0.0

    assert not SPEED.depends_on_state
    assert not PairBound(SPEED, SPEED).depends_on_state
    assert AtRest(0.22, 1.0).depends_on_state
    assert SPEED.reach(situation(), 2.0) == SPEED.bound(2.0)
