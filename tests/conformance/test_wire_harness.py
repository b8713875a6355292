"""What a harness of simulated robots on a wire does to them, with the ZeroMQ adapter for one of its kind."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from soter.conformance.driver import drive_until
from soter.sdk import Controller, Link, Robot, Waypoint
from soter_zmq.harness import ZmqHarness


@pytest.fixture
def harness() -> Iterator[ZmqHarness]:
    opened = ZmqHarness()
    yield opened
    opened.close()


def speed(robot: Robot) -> float:
    state = robot.read_state()
    return math.hypot(state.vx_m_s, state.vy_m_s)


@pytest.mark.parametrize("step_s", [-30.0, 30.0])
def test_a_robot_whose_clock_is_set_stops_at_most_and_is_found_again(harness: ZmqHarness, step_s: float) -> None:
    with harness.open(1) as fleet:
        robot = fleet.robots[0]
        robot.init(10.0)
        robot.goto(Waypoint(3.3, 4.1), Controller.SC)
        assert drive_until(fleet, lambda: speed(robot) > 0.2, 10.0)
        before_s = robot.read_state().vehicle_stamp_s
        harness.step_clock(robot.id, step_s)
        assert drive_until(fleet, lambda: abs(robot.read_state().vehicle_stamp_s - before_s - step_s) < 2.0, 10.0)
        assert drive_until(fleet, lambda: speed(robot) > 0.2, 10.0)
        assert robot.read_state().age_s(fleet.clock.now()) < 0.5
        harness.step_clock(robot.id, -30.0)
        assert drive_until(fleet, lambda: speed(robot) < 1e-3, 5.0, renew=False), "no lease lives on"


def test_a_robot_that_was_switched_off_and_on_knows_nothing_of_before(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = fleet.robots[0]
        robot.init(10.0)
        robot.switch_ac_sc(Controller.AC, "test")
        drive_until(fleet, lambda: False, 0.3)
        assert robot.read_state().controller is Controller.AC
        # What is under way would be taken by the robot that knows nothing.
        drive_until(fleet, lambda: False, 0.2, renew=False)
        harness.restart(robot.id)
        assert drive_until(fleet, lambda: robot.read_state().vehicle_stamp_s < 100.0, 5.0, renew=False)
        assert robot.read_state().controller is None, "it follows nobody"
        assert drive_until(fleet, lambda: robot.read_state().controller is Controller.AC, 5.0)


def test_a_second_program_has_a_connection_of_its_own(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet, harness.second() as other:
        fleet.robots[0].init(10.0)
        fleet.robots[0].close(5.0)
        other.robots[0].init(10.0)
        assert other.robots[0].read_state().controller is Controller.SC


def test_what_happens_to_the_link_of_one_program_is_none_of_the_second_one_s(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet, harness.second() as other:
        fleet.robots[0].init(10.0)
        fleet.robots[0].close(5.0)
        other.robots[0].init(10.0)
        harness.cut(other.robots[0].id)
        drive_until(other, lambda: False, 2.0)
        assert other.robots[0].read_state().link is Link.UP


def test_a_robot_whose_program_is_switched_off_and_on_is_at_the_same_address(harness: ZmqHarness) -> None:
    fleet, off, on = harness.switchable()
    with fleet:
        robot = fleet.robots[0]
        robot.init(10.0)
        for _ in range(2):
            off()
            assert drive_until(fleet, lambda: robot.read_state().link is not Link.UP, 5.0)
            on()
            assert drive_until(fleet, lambda: robot.read_state().link is Link.UP, 10.0)
            assert harness.observe(robot.id)[:2] == (robot.spec.x_m, robot.spec.y_m)


def test_a_robot_whose_program_stands_still_is_not_heard_until_it_goes_on(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = fleet.robots[0]
        robot.init(10.0)
        began_s = fleet.clock.now()
        harness.stall(robot.id, 1.5)
        assert drive_until(fleet, lambda: robot.read_state().link is not Link.UP, 1.5)
        assert drive_until(fleet, lambda: robot.read_state().link is Link.UP, 10.0)
        assert fleet.clock.now() - began_s >= 1.5
        # It is no matter for the end that somebody stands still.
        harness.stall(robot.id, 0.3)


def test_a_robot_whose_clock_stands_still_says_the_same_time_and_drives_until_its_lease_ends(
    harness: ZmqHarness,
) -> None:
    with harness.open(1) as fleet:
        robot = fleet.robots[0]
        robot.init(10.0)
        robot.goto(Waypoint(3.3, 4.1), Controller.SC)
        assert drive_until(fleet, lambda: speed(robot) > 0.2, 10.0)
        harness.stop_clock(robot.id)
        drive_until(fleet, lambda: False, 0.2)
        shown_s = robot.read_state().vehicle_stamp_s
        assert drive_until(fleet, lambda: speed(robot) < 1e-3, 5.0, renew=False)
        assert robot.read_state().vehicle_stamp_s == shown_s


def test_a_robot_that_the_backend_starts_itself_is_lost_with_its_program(harness: ZmqHarness) -> None:
    fleet, kill = harness.killable()
    with fleet:
        fleet.robots[0].init(10.0)
        assert fleet.lost() == ""
        kill()
        assert drive_until(fleet, lambda: "ended" in fleet.lost(), 5.0, renew=False)
