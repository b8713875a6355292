"""Go-to-goal control, driven by the kinematic engine."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.onboard.drive import ARRIVED_M, OVERSHOOT_M, TUBE_M, Drive, DriveLimits
from soter.sdk.values import Waypoint
from soter_sim import World
from tests.sim.worlds import driven, empty, from_segment, specs

START = (10.0, 10.0)
angles = st.floats(-math.pi, math.pi)


def at_rest(world: World) -> bool:
    return abs(world.bodies.v[0]) < 1e-9 and abs(world.bodies.yaw_rate[0]) < 1e-9


def drive_to(world: World, target: Waypoint, most_s: float = 60.0) -> list[tuple[float, float, float, float]]:
    """Drive robot 1 to a target until it rests for half a second; return x, y, heading and v after each period."""
    world.set_control(1, driven(lambda: target))
    track: list[tuple[float, float, float, float]] = []
    resting = 0
    bodies = world.bodies
    while resting < 10:
        world.advance(world.now_s + world.period_s)
        track.append((bodies.x[0], bodies.y[0], bodies.heading[0], bodies.v[0]))
        resting = resting + 1 if at_rest(world) else 0
        assert len(track) * world.period_s < most_s, f"no rest after {most_s} s"
    return track


def beyond(start: tuple[float, float], angle: float, distance: float) -> tuple[float, float]:
    return start[0] + distance * math.cos(angle), start[1] + distance * math.sin(angle)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    heading=angles,
    bearing=angles,
    distance=st.floats(0.0, 2.0),
    wanted=st.none() | angles,
    cap=st.none() | st.floats(0.03, 1.0),
)
def test_it_arrives_within_the_tube_and_the_overshoot(
    heading: float, bearing: float, distance: float, wanted: float | None, cap: float | None
) -> None:
    world = World(empty(), specs((*START, heading)))
    end = beyond(START, bearing, distance)
    track = drive_to(world, Waypoint(*end, heading_rad=wanted, speed_m_s=cap), most_s=120.0)
    for x, y, _, v in track:
        off, over = from_segment(x, y, START, end)
        assert off <= TUBE_M
        assert over <= OVERSHOOT_M
        assert abs(v) <= (cap or 1.0) + 1e-12
    x, y, last_heading, _ = track[-1]
    assert math.hypot(x - end[0], y - end[1]) <= ARRIVED_M
    if wanted is not None:
        assert abs(math.remainder(last_heading - wanted, 2 * math.pi)) <= 0.01


@settings(max_examples=100, deadline=None, derandomize=True)
@given(turn=st.floats(-3.1, 3.1), distance=st.floats(0.05, 1.0), after=st.integers(1, 40))
def test_a_new_target_while_driving_is_reached_from_the_stopping_place_or_steered_to(
    turn: float, distance: float, after: int
) -> None:
    world = World(empty(), specs((*START, 0.0)))
    world.set_control(1, driven(lambda: Waypoint(15.0, 10.0)))
    world.advance(after * 0.05)
    here, v = (world.bodies.x[0], world.bodies.y[0]), world.bodies.v[0]
    stopped = beyond(here, 0.0, v * v / 2)
    end = beyond(here, turn, distance)
    for x, y, _, _ in drive_to(world, Waypoint(*end)):
        # Either it brakes and goes straight from where it rests, or it steers.
        off = min(
            from_segment(x, y, here, end)[0],
            from_segment(x, y, here, stopped)[0],
            from_segment(x, y, stopped, end)[0],
        )
        assert off <= TUBE_M
    assert math.dist((world.bodies.x[0], world.bodies.y[0]), end) <= ARRIVED_M


def test_a_small_change_of_direction_does_not_stop_it() -> None:
    world = World(empty(), specs((*START, 0.0)))
    targets = [Waypoint(12.0, 10.0)]
    world.set_control(1, driven(lambda: targets[0]))
    world.advance(2.0)
    targets[0] = Waypoint(12.0, 10.15)
    for period in range(20):
        world.advance(2.0 + period * 0.05)
        assert world.bodies.v[0] == pytest.approx(0.22)


def test_a_large_change_of_direction_makes_it_rest_and_pivot_first() -> None:
    world = World(empty(), specs((*START, 0.0)))
    targets = [Waypoint(12.0, 10.0)]
    world.set_control(1, driven(lambda: targets[0]))
    world.advance(2.0)
    targets[0] = Waypoint(world.bodies.x[0], 12.0)
    before = world.bodies.x[0]
    while world.bodies.heading[0] < 1.5:
        world.advance(world.now_s + 0.05)
        assert world.bodies.heading[0] == 0.0 or abs(world.bodies.v[0]) < 1e-9
        assert world.now_s < 10.0
    assert world.bodies.x[0] - before == pytest.approx(0.0242)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_carrot_is_followed_at_full_speed_in_both_directions(sign: float) -> None:
    world = World(empty(), specs((*START, 0.3)))
    bodies = world.bodies

    def carrot() -> Waypoint:
        along = (bodies.x[0] - START[0]) * math.cos(0.3) + (bodies.y[0] - START[1]) * math.sin(0.3)
        x, y = beyond(START, 0.3, along + sign * 0.04)
        return Waypoint(x, y, heading_rad=None if sign > 0 else 0.3)

    world.set_control(1, driven(carrot))
    for period in range(1, 100):
        world.advance(period * 0.05)
        if period > 5:
            assert bodies.v[0] == pytest.approx(sign * 0.22)
        assert from_segment(bodies.x[0], bodies.y[0], START, beyond(START, 0.3, sign * 9.0))[0] < 1e-3


@pytest.mark.parametrize(("wanted", "sign"), [(0.0, 1), (None, 1), (math.pi, -1), (2.5, -1), (1.0, 1)])
def test_a_leg_is_driven_backwards_when_that_arrives_with_the_heading(wanted: float | None, sign: int) -> None:
    world = World(empty(), specs((*START, 0.5)))
    track = drive_to(world, Waypoint(11.0, 10.0, heading_rad=wanted))
    assert {math.copysign(1, v) for _, _, _, v in track if abs(v) > 0.01} == {sign}
    if wanted is not None:
        assert track[-1][2] == pytest.approx(wanted, abs=0.01)


def test_backing_away_needs_no_turn() -> None:
    world = World(empty(), specs((*START, 0.0)))
    for _, _, heading, v in drive_to(world, Waypoint(9.5, 10.0, heading_rad=0.0)):
        assert heading == 0.0
        assert v <= 0.0


def test_without_a_target_it_brakes() -> None:
    drive = Drive()
    assert drive.command(0.0, 0.0, 0.0, 0.22, 0.5, None) == (0.0, 0.0)
    assert drive.command(0.0, 0.0, 0.0, 0.22, 0.0, Waypoint(1.0, 0.0))[0] == 0.22
    assert drive.command(0.0, 0.0, 0.0, 0.22, 0.0, None) == (0.0, 0.0)


def test_a_target_where_it_stands_moves_nothing() -> None:
    assert Drive().command(1.0, 1.0, 2.0, 0.0, 0.0, Waypoint(1.005, 1.0)) == (0.0, 0.0)


@pytest.mark.parametrize("length_m", [0.02, 0.04, 0.1])
def test_a_leg_that_is_shorter_than_the_noise_is_driven_all_the_same(length_m: float) -> None:
    """Safe controllers ask for such legs, and a robot that took itself for there would stand for ever."""
    drive = Drive(DriveLimits(position_noise_m=0.5))
    assert drive.command(0.0, 0.0, 0.0, 0.0, 0.0, Waypoint(length_m, 0.0))[0] > 0.0


Noise = tuple[float, float, float, float, float]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    bearing=angles,
    position_m=st.floats(0.0, 0.05),
    heading_rad=st.floats(0.0, 0.05),
    speed_m_s=st.floats(0.0, 0.1),
    yaw_rate_rad_s=st.floats(0.0, 0.1),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 5),
    chance=st.none() | st.randoms(use_true_random=False),
)
def test_whatever_is_told_within_its_noise_it_arrives_and_rests(
    bearing: float,
    position_m: float,
    heading_rad: float,
    speed_m_s: float,
    yaw_rate_rad_s: float,
    signs: Noise,
    chance: random.Random | None,
) -> None:
    """An estimate may be off always to the same side, as one of a filter that drifts, or anew each time."""
    exact = DriveLimits()
    drive = Drive(replace(exact, speed_noise_m_s=speed_m_s, position_noise_m=math.hypot(position_m, position_m)))
    x = y = heading = v = w = 0.0
    end = beyond((0.0, 0.0), bearing, 0.8)
    target = Waypoint(*end)
    for period in range(600):
        off = [sign if chance is None else chance.uniform(-1.0, 1.0) for sign in signs]
        speed, turn = drive.command(
            x + position_m * off[0], y + position_m * off[1], heading + heading_rad * off[2], v + speed_m_s * off[3],
            w + yaw_rate_rad_s * off[4], target,
        )  # fmt: skip
        v += max(-0.05 * exact.brake_m_s2, min(0.05 * exact.accel_m_s2, speed - v))
        w += max(-0.05 * exact.yaw_accel_rad_s2, min(0.05 * exact.yaw_accel_rad_s2, turn - w))
        heading += 0.05 * w
        x, y = beyond((x, y), heading, 0.05 * v)
        assert period < 500 or (v, w) == (0.0, 0.0), "it rests for the last five seconds"
    assert math.dist((x, y), end) <= ARRIVED_M + 3.0 * position_m


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_are_positive_and_finite(value: float) -> None:
    with pytest.raises(ValueError, match="brake_m_s2"):
        DriveLimits(brake_m_s2=value)
    with pytest.raises(ValueError, match="speed_noise_m_s is nan, allowed: finite and above 0, or 0"):
        DriveLimits(speed_noise_m_s=math.nan)
    with pytest.raises(ValueError, match="period_s"):
        Drive(period_s=value)
