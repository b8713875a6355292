"""Velocities become goals that go-to-goal control follows: speed, turn rate, backwards, with latency and without."""

from __future__ import annotations

import math

import pytest

from soter.controllers import Velocity
from soter.onboard.drive import DriveLimits
from tests.controllers.driving import Robot

FAST = DriveLimits(1.0, 2.0, 1.0, 1.5, 8.0)
LINKS = [(0.0, 0.0), (0.05, 0.05), (0.15, 0.15)]
SETTLED_S, MEASURED_S = 2.0, 4.0


def tracked(robot: Robot, forward_m_s: float, turn_rad_s: float) -> tuple[float, float]:
    """The mean speed and turn rate once both have settled."""
    robot.run(forward_m_s, turn_rad_s, SETTLED_S)
    driven_m, turned_rad = robot.driven_m, robot.turned_rad
    robot.run(forward_m_s, turn_rad_s, MEASURED_S)
    return (robot.driven_m - driven_m) / MEASURED_S, (robot.turned_rad - turned_rad) / MEASURED_S


@pytest.mark.parametrize("limits", [DriveLimits(), FAST], ids=["burger", "fast"])
@pytest.mark.parametrize(("latency_s", "age_s"), LINKS)
@pytest.mark.parametrize(
    ("forward_m_s", "turn_rad_s"),
    [(0.2, 0.0), (0.02, 0.0), (0.2, -0.4), (0.05, 0.4), (-0.2, 0.0), (-0.1, 0.4), (0.0, 0.1), (0.0, -1.5)],
)
def test_velocities_are_tracked(
    limits: DriveLimits, latency_s: float, age_s: float, forward_m_s: float, turn_rad_s: float
) -> None:
    robot = Robot(limits, latency_s, age_s)
    assert tracked(robot, forward_m_s, turn_rad_s) == pytest.approx((forward_m_s, turn_rad_s), abs=0.005)
    before_m = robot.driven_m
    robot.run(0.0, 0.0, 2.0)
    assert robot.speed_m_s == robot.turn_rad_s == 0.0
    braking_m = forward_m_s**2 / (2.0 * limits.brake_m_s2)
    late_m = abs(forward_m_s) * robot.tracker.delay_s
    assert abs(robot.driven_m - before_m) <= braking_m + late_m + 0.011, "it stops at once, and does not turn back"


@pytest.mark.parametrize("bias_m_s", [0.015, -0.015, 0.03, -0.03])
@pytest.mark.parametrize(("forward_m_s", "turn_rad_s"), [(0.2, 0.0), (0.2, -0.4), (-0.2, 0.0), (0.0, 0.5), (0.0, -1.5)])
def test_a_robot_that_seems_to_move_where_it_stands_is_driven_all_the_same(
    bias_m_s: float, forward_m_s: float, turn_rad_s: float
) -> None:
    robot = Robot(bias_m_s=bias_m_s)
    assert tracked(robot, forward_m_s, turn_rad_s) == pytest.approx((forward_m_s, turn_rad_s), abs=0.02)
    robot.run(0.0, 0.0, 2.0)
    assert robot.speed_m_s == robot.turn_rad_s == 0.0


@pytest.mark.parametrize(("latency_s", "most_rad_s"), [(0.0, 0.75), (0.05, 0.6), (0.15, 0.4)])
def test_beyond_what_can_be_steered_turn_rates_are_cut_and_speeds_are_not(latency_s: float, most_rad_s: float) -> None:
    robot = Robot(latency_s=latency_s)
    forward_m_s, turn_rad_s = tracked(robot, 0.1, 2.5)
    assert forward_m_s == pytest.approx(0.1, rel=0.05)
    assert most_rad_s < turn_rad_s < 1.4 * most_rad_s
    turned_rad = robot.turned_rad
    robot.run(0.1, 0.0, 2.0)
    assert robot.turned_rad - turned_rad < 0.3, "what was cut is not made up for"


def test_a_circle_is_one() -> None:
    robot = Robot()
    robot.run(0.2, 0.4, 3.0)
    x_m, y_m, heading_rad = robot.x_m, robot.y_m, robot.heading_rad
    centre = x_m - 0.5 * math.sin(heading_rad), y_m + 0.5 * math.cos(heading_rad)
    for _ in range(20):
        robot.run(0.2, 0.4, math.tau / 0.4 / 20.0)
        assert math.dist((robot.x_m, robot.y_m), centre) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(("forward_m_s", "turn_rad_s"), [(0.2, 0.3), (-0.2, 0.3), (0.0, 1.0)])
@pytest.mark.parametrize(("latency_s", "age_s"), LINKS)
def test_a_robot_whose_controller_falls_silent_stops_by_itself(
    forward_m_s: float, turn_rad_s: float, latency_s: float, age_s: float
) -> None:
    robot = Robot(latency_s=latency_s, age_s=age_s)
    robot.run(forward_m_s, turn_rad_s, 3.0)
    x_m, y_m = robot.x_m, robot.y_m
    robot.coast(5.0)
    assert robot.speed_m_s == robot.turn_rad_s == 0.0
    assert math.dist((robot.x_m, robot.y_m), (x_m, y_m)) <= robot.tracker.ahead_m(abs(forward_m_s)) + 0.005


def test_directions_change_with_a_stop_and_after_a_pause_the_heading_is_the_robots_own() -> None:
    robot = Robot()
    for forward_m_s, turn_rad_s in ((0.2, 0.5), (-0.2, -0.5), (0.0, 2.0), (0.2, 0.0), (0.0, -2.0)):
        assert tracked(robot, forward_m_s, turn_rad_s) == pytest.approx((forward_m_s, turn_rad_s), abs=0.005)
    robot.coast(3.0)
    heading_rad = robot.heading_rad
    robot.run(0.1, 0.0, 1.0)
    assert robot.heading_rad == pytest.approx(heading_rad, abs=0.02)


def test_robots_that_do_not_reverse_stand_and_none_is_sent_faster_than_it_can() -> None:
    robot = Robot(reverses=False)
    robot.run(-0.2, 0.0, 2.0)
    assert robot.driven_m == 0.0
    assert tracked(robot, 9.0, 0.0)[0] == pytest.approx(0.22, rel=0.01)
    assert tracked(Robot(), 0.0, 99.0)[1] == pytest.approx(2.84, rel=0.15)
    sample = robot._samples[0]
    assert robot.tracker.goal(sample, Velocity(9.0, 0.0), robot.time_s).speed_m_s == 0.22
