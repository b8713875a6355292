"""Samples: what the template of the narrow interface enforces, whatever an adapter hears."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from soter.clock import VirtualClock
from soter.errors import RobotUnavailable
from soter.sdk import Controller, Link, Waypoint
from tests.sdk.fake import FakeRobot, ready_robot

AC, SC = Controller.AC, Controller.SC
THERE = Waypoint(2.0, 1.0)
FINITE = ("x_m", "y_m", "z_m", "heading_rad", "vx_m_s", "vy_m_s", "yaw_rate_rad_s", "stamp_s")


def test_why_samples_are_discarded_is_said_before_any_is_valid() -> None:
    robot = FakeRobot()
    robot.init(1.0)
    robot.place(battery=24.3)
    with pytest.raises(RobotUnavailable, match=r"1 were discarded: battery is 24\.3, allowed: 0 to 1"):
        robot.read_state()


def test_no_sample_yet_is_said_and_not_invented() -> None:
    robot = FakeRobot()
    robot.init(1.0)
    robot.sample = None
    with pytest.raises(RobotUnavailable, match="no valid sample"):
        robot.read_state()


@pytest.mark.parametrize(
    ("age_s", "link"), [(0.0, Link.UP), (0.49, Link.UP), (0.51, Link.STALE), (2.9, Link.STALE), (3.1, Link.DOWN)]
)
def test_the_link_is_judged_by_the_age_of_the_sample(age_s: float, link: Link) -> None:
    robot = ready_robot()
    robot.time.sleep_until(age_s)
    state = robot.read_state()
    assert state.link is link
    assert state.age_s(robot.time.now()) == pytest.approx(age_s)


def test_a_link_comes_back_without_a_restart() -> None:
    robot = ready_robot()
    robot.time.sleep_until(5.0)
    assert robot.read_state().link is Link.DOWN
    robot.place(x_m=1.0)
    state = robot.read_state()
    assert (state.link, state.x_m) == (Link.UP, 1.0)


def test_a_sample_that_stops_coming_keeps_its_stamp() -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    robot.sample = None
    state = robot.read_state()
    assert (state.stamp_s, state.link) == (0.0, Link.STALE)


@pytest.mark.parametrize(
    "values",
    [
        *({name: value} for name in FINITE for value in (math.nan, math.inf, -math.inf)),
        {"vx_m_s": math.inf, "vy_m_s": -math.inf}, {"robot_id": 2}, {"stamp_s": 0.99}, {"stamp_s": -1.0},
        {"battery": -0.01}, {"battery": 1.01}, {"battery": math.nan}, {"stamp_s": 9.0}, {"stamp_s": 1e9},
    ],
)  # fmt: skip
def test_samples_that_cannot_be_are_discarded_and_counted(values: dict[str, Any]) -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    robot.place(x_m=1.0)
    good = robot.read_state()
    robot.time.sleep_until(1.2)
    robot.place(**{"x_m": 2.0, **values})
    assert robot.read_state() == good
    assert robot.discarded == 1
    assert any(word in robot.discarded_for for word in (*values, "another robot", "older", "future"))
    robot.place(x_m=3.0)
    assert robot.read_state().x_m == 3.0, "one bad sample must not shut out those that follow"


def test_a_clock_that_runs_ahead_a_little_is_forgiven() -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    robot.place(x_m=1.0, stamp_s=1.05)
    assert robot.read_state().x_m == 1.0


@pytest.mark.parametrize("battery", [None, 0.0, 1.0])
def test_an_unknown_empty_or_full_battery_is_a_sample(battery: float | None) -> None:
    robot = ready_robot()
    robot.place(battery=battery)
    assert robot.read_state().battery == battery
    assert robot.discarded == 0


def test_a_robot_lives_on_its_fleets_clock() -> None:
    clock = VirtualClock()
    robot = FakeRobot(clock=clock)
    robot.init(1.0)
    clock.sleep_until(3.0)
    robot.place()
    assert robot.goto(THERE, SC).sent_s == 3.0


@pytest.mark.parametrize("number", [np.float32, np.float64, np.int64, int])
@pytest.mark.parametrize("name", [*FINITE, "vehicle_stamp_s", "battery", "vz_m_s"])
def test_samples_hold_plain_floats_whatever_an_adapter_hands_out(name: str, number: Callable[[int], Any]) -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    assert robot.sample is not None
    robot.sample = robot.sample._replace(stamp_s=1.0)._replace(**{name: number(1)})
    state = robot.read_state()
    assert getattr(state, name) == 1.0
    assert msgspec.json.decode(msgspec.json.encode(state))[state._fields.index(name)] == 1.0
    assert robot.discarded == 0


@pytest.mark.parametrize("name", ["vehicle_stamp_s", "battery", "vz_m_s", "x_m"])
def test_text_is_no_number(name: str) -> None:
    robot = ready_robot()
    assert robot.sample is not None
    robot.sample = robot.sample._replace(**{name: "0.5"})  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        robot.read_state()
