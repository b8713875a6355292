"""Targets, and how goals end: what the template of the narrow interface enforces, whatever an adapter does."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.sdk import MAX_COORDINATE_M, Controller, Goal, GoalStatus, Link, Waypoint
from tests.sdk.fake import FakeRobot, ready_robot

AC, SC = Controller.AC, Controller.SC
THERE = Waypoint(2.0, 1.0)
BAD_NUMBERS = [math.nan, math.inf, -math.inf, 1.1 * MAX_COORDINATE_M, -1.1 * MAX_COORDINATE_M, 1e300]


# --- targets -----------------------------------------------------------------------------------------------


def refused(robot: FakeRobot, target: object, error: type[Exception]) -> None:
    """Check that a target is refused, sends nothing and leaves the goal before it alone."""
    before = robot.goto(THERE, SC)
    robot.calls.clear()
    with pytest.raises(error):
        robot.goto(cast(Waypoint, target), SC)
    assert robot.calls == []
    assert before.active


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize("name", ["x_m", "y_m", "z_m"])
def test_coordinates_that_are_not_finite_or_absurd_send_nothing(name: str, value: float) -> None:
    refused(ready_robot(), THERE._replace(**{name: value}), ValueError)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("heading_rad", math.nan), ("heading_rad", math.inf), ("heading_rad", 1e7), ("speed_m_s", 0.0),
        ("speed_m_s", -0.1),
        ("speed_m_s", math.nan), ("speed_m_s", math.inf), ("radius_m", 0.0), ("radius_m", -1.0), ("radius_m", math.nan),
        ("radius_m", math.inf), ("timeout_s", 0.0), ("timeout_s", -1.0), ("timeout_s", math.nan),
        ("timeout_s", math.inf),
    ],
)  # fmt: skip
def test_other_values_out_of_range_send_nothing_and_are_named(name: str, value: float) -> None:
    refused(ready_robot(), THERE._replace(**{name: value}), ValueError)
    with pytest.raises(ValueError, match=rf"Waypoint\.{name} is"):
        THERE._replace(**{name: value}).check()


class Friendly(Waypoint):
    __slots__ = ()

    def check(self, max_coordinate_m: float = 0.0) -> None:
        """Find everything in order."""


class LookAlike:
    x_m = y_m = z_m = 0.0
    heading_rad = speed_m_s = None
    radius_m = timeout_s = 1.0

    def check(self) -> None:
        """Find everything in order."""


@pytest.mark.parametrize(
    "target",
    [
        None, "there", (1.0, 2.0), 7, LookAlike(), Friendly(math.nan, 0.0), THERE._replace(x_m=cast(Any, Decimal(1))),
        THERE._replace(y_m=cast(Any, "1")), THERE._replace(z_m=cast(Any, None)),
        THERE._replace(heading_rad=cast(Any, Decimal(1))), THERE._replace(timeout_s=cast(Any, None)),
        THERE._replace(radius_m=cast(Any, [1.0])),
    ],
)  # fmt: skip
def test_what_only_looks_like_a_waypoint_is_refused_here_and_not_in_the_vehicle(target: object) -> None:
    refused(ready_robot(), target, TypeError)


def test_targets_outside_every_fence_are_passed_on() -> None:
    robot = ready_robot()
    robot.goto(Waypoint(-50.0, 9_999.0, heading_rad=9.0, speed_m_s=5.0), SC)
    assert len(robot.sent) == 1


@pytest.mark.parametrize(
    "target",
    [
        Waypoint(1, 2, radius_m=3),
        Waypoint(cast(Any, Fraction(1, 2)), cast(Any, np.float32(0.25)), speed_m_s=cast(Any, np.float32(1))),
    ],
)
def test_an_adapter_is_given_floats_whatever_kind_of_number_a_target_is_of(target: Waypoint) -> None:
    robot = ready_robot()
    goal = robot.goto(target, SC)
    assert goal.target == target
    assert all(type(value) is float or value is None for value in goal.target)
    assert robot.sent == [goal]


@pytest.mark.parametrize("name", ["x_m", "heading_rad", "speed_m_s", "radius_m", "timeout_s"])
def test_whole_numbers_that_no_float_can_be_are_refused(name: str) -> None:
    refused(ready_robot(), THERE._replace(**{name: 10**400}), ValueError)


@pytest.mark.parametrize("name", ["x_m", "heading_rad", "speed_m_s", "radius_m", "timeout_s"])
def test_numbers_of_32_bits_that_are_infinite_are_refused(name: str) -> None:
    refused(ready_robot(), THERE._replace(**{name: cast(Any, np.float32(math.inf))}), ValueError)


@given(st.builds(Waypoint, *[st.floats()] * 3, st.none() | st.floats(), st.none() | st.floats(), *[st.floats()] * 2))
def test_whatever_the_numbers_a_target_is_sent_whole_or_not_at_all(target: Waypoint) -> None:
    robot = ready_robot()
    try:
        goal = robot.goto(target, SC)
    except ValueError:
        assert robot.calls == []
    else:
        assert robot.sent == [goal]
        assert all(value is None or math.isfinite(value) for value in target)
        assert math.isfinite(goal.deadline_s)


# --- how goals end -----------------------------------------------------------------------------------------


def test_sent_is_not_reached() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.time.sleep_until(1.0)
    robot.place()
    robot.read_state()
    assert goal.active
    assert goal.ended_s is None


def test_a_new_goal_supersedes_the_one_before() -> None:
    robot = ready_robot()
    first = robot.goto(THERE, SC)
    second = robot.goto(THERE, SC)
    assert first.status is GoalStatus.SUPERSEDED
    assert f"goal {second.id}" in first.reason
    assert second.active
    assert second.id != first.id


@pytest.mark.parametrize("radius_m", [0.005, 0.1, 1.0])
def test_reached_is_judged_from_the_state_with_the_goals_own_radius(radius_m: float) -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(radius_m=radius_m), SC)
    robot.time.sleep_until(1.0)
    robot.place(x_m=2.0, y_m=1.0 + 1.01 * radius_m)
    robot.read_state()
    assert goal.active
    robot.place(x_m=2.0 - 0.99 * radius_m, y_m=1.0)
    robot.read_state()
    assert goal.status is GoalStatus.REACHED
    assert goal.ended_s == 1.0


def test_height_counts() -> None:
    robot = ready_robot()
    goal = robot.goto(Waypoint(0.0, 0.0, 2.0), SC)
    robot.place()
    robot.read_state()
    assert goal.active


def test_a_sample_from_before_the_goal_does_not_reach_it() -> None:
    robot = ready_robot()
    robot.place(x_m=THERE.x_m, y_m=THERE.y_m, stamp_s=0.0)
    robot.time.sleep_until(0.5)
    goal = robot.goto(THERE, SC)
    robot.read_state()
    assert goal.active
    robot.time.sleep_until(0.6)
    robot.place(x_m=THERE.x_m, y_m=THERE.y_m, stamp_s=0.55)
    robot.read_state()
    assert goal.status is GoalStatus.REACHED


def test_cancel_ends_its_own_goal_only() -> None:
    robot = ready_robot()
    first = robot.goto(THERE, SC)
    second = robot.goto(THERE, SC)
    robot.calls.clear()
    first.cancel()
    assert first.status is GoalStatus.SUPERSEDED
    assert second.active
    assert robot.calls == []
    second.cancel()
    assert second.status is GoalStatus.CANCELLED
    second.cancel()
    assert robot.calls == ["halt"]


def test_a_goal_goes_on_until_the_robot_could_be_told_to_stop() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.failing.add("halt")
    for _ in range(2):
        with pytest.raises(OSError, match="halt failed"):
            goal.cancel()
        assert goal.active
    robot.failing.clear()
    goal.cancel()
    assert goal.status is GoalStatus.CANCELLED
    assert robot.calls.count("halt") == 3


def test_a_goal_that_could_not_be_sent_leaves_the_one_before_as_it_was() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.failing.add("send")
    with pytest.raises(OSError, match="send failed"):
        robot.goto(THERE, SC)
    assert goal.active, "it is what the vehicle works on"
    goal.cancel()
    assert robot.calls[-1] == "halt"


def test_a_goal_whose_time_is_up_is_stopped_although_that_fails_at_first() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(timeout_s=1.0), SC)
    robot.time.sleep_until(1.0)
    robot.place()
    robot.failing.add("halt")
    with pytest.raises(OSError, match="halt failed"):
        robot.read_state()
    robot.failing.clear()
    robot.calls.clear()
    robot.read_state()
    assert robot.calls == ["halt"]
    assert goal.status is GoalStatus.TIMED_OUT


def test_a_goal_whose_time_is_up_stops_the_robot() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(timeout_s=2.0), SC)
    robot.time.sleep_until(1.99)
    robot.place()
    robot.read_state()
    assert goal.active
    robot.calls.clear()
    robot.time.sleep_until(2.0)
    robot.read_state()
    assert goal.status is GoalStatus.TIMED_OUT
    assert robot.calls == ["halt"]


def test_a_goal_times_out_although_the_link_is_down() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(timeout_s=5.0), SC)
    robot.time.sleep_until(6.0)
    assert robot.read_state().link is Link.DOWN
    assert goal.status is GoalStatus.TIMED_OUT


def arrive(robot: FakeRobot) -> None:
    robot.place(x_m=THERE.x_m, y_m=THERE.y_m)
    robot.read_state()


def wait(robot: FakeRobot) -> None:
    robot.time.sleep_until(robot.time.now() + 200.0)
    robot.read_state()


ENDINGS: dict[str, Callable[[FakeRobot, Goal], object]] = {
    "supersede": lambda robot, goal: robot.goto(Waypoint(9.0, 9.0), robot.vehicle_in_charge),
    "preempt": lambda robot, goal: robot.switch_ac_sc(AC if robot.vehicle_in_charge is SC else SC, "test"),
    "cancel": lambda robot, goal: goal.cancel(),
    "arrive": lambda robot, goal: arrive(robot),
    "wait": lambda robot, goal: wait(robot),
}


@given(st.lists(st.sampled_from(sorted(ENDINGS)), min_size=1, max_size=6))
def test_status_leaves_active_once(endings: list[str]) -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    seen = []
    for ending in endings:
        ENDINGS[ending](robot, goal)
        seen.append((goal.status, goal.reason, goal.ended_s))
    assert seen[0][0] is not GoalStatus.ACTIVE
    assert set(seen) == {seen[0]}
