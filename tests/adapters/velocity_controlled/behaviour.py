"""What a robot behind a mux does when something dies, whatever carries the messages: a test each, for every adapter."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

import pytest

from soter.adapters.velocity_controlled.simulator import VelocityControlledSimulator
from soter.errors import Intruder, RobotUnavailable
from soter.sdk import Controller, Fleet, GoalStatus, Link, Robot, Waypoint
from tests.adapters.velocity_controlled.driving import rest_after_s, tick, under_way


def intruder(robot: Robot) -> str:
    """What a robot says of who goes round its mux; empty where nobody does."""
    try:
        robot.renew_lease()
    except Intruder as found:
        return repr(found)
    return ""


def drives(fleet: Fleet) -> None:
    """Its robots become ready, and go where they are told."""
    assert fleet.truth is not None
    for robot in fleet.robots:
        robot.init(20.0)
    goals = [robot.goto(Waypoint(robot.spec.x_m, robot.spec.y_m + 0.5), Controller.SC) for robot in fleet.robots]
    assert tick(fleet, lambda: not any(goal.active for goal in goals), 15.0)
    for goal, robot in zip(goals, fleet.robots, strict=True):
        assert goal.status is GoalStatus.REACHED
        state, pose = robot.read_state(), fleet.truth.pose(robot.id)
        assert math.dist((state.x_m, state.y_m), pose[:2]) < 0.03
        assert state.controller is Controller.SC
        assert state.battery is not None
        # It stood on its charger for a while.
        assert 0.75 < state.battery < 0.95
        assert state.vehicle_stamp_s > 1000.0, "the world's clock, not the host's"


def silence(fleet: Fleet) -> None:
    """When SOTER falls silent the robot stops."""
    under_way(fleet)
    caps = fleet.robots[0].capabilities
    stopped_s = rest_after_s(fleet, 2.0, drive=False)
    assert stopped_s <= caps.lease_s + caps.latency_s + caps.setpoint_period_s + caps.v_max_m_s / caps.brake_m_s2 + 0.2


def mux_dies(fleet: Fleet, simulator: VelocityControlledSimulator) -> None:
    """When its mux dies the robot stops, and goes on with the next."""
    under_way(fleet)
    simulator.muxes[1].kill()
    simulator.muxes[1].wait()
    # The base's own time-out of 0.2 s, and braking.
    assert rest_after_s(fleet, 2.0, drive=True) <= 0.2 + 0.22 + 0.2
    simulator.start_mux(1)
    state = fleet.robots[0].read_state()
    goal = fleet.robots[0].goto(Waypoint(state.x_m + 0.2, state.y_m + 0.1), Controller.SC)
    assert tick(fleet, lambda: not goal.active, 30.0)
    assert goal.status is GoalStatus.REACHED


def robot_dies(fleet: Fleet, simulator: VelocityControlledSimulator) -> None:
    """When the robot dies its link goes down, and closing does not hang."""
    under_way(fleet)
    simulator.world.kill()
    simulator.world.wait()
    robot = fleet.robots[0]
    links: set[Link] = set()

    def down() -> bool:
        links.add(robot.read_state().link)
        return Link.DOWN in links

    assert tick(fleet, down, 5.0)
    assert links == {Link.UP, Link.STALE, Link.DOWN}
    began_s = fleet.clock.steady_s()
    fleet.close()
    assert fleet.clock.steady_s() - began_s < 3.0


def robot_reboots(
    fleet: Fleet,
    simulator: VelocityControlledSimulator,
    start_again: Callable[[], VelocityControlledSimulator],
    on_s: float,
) -> None:
    """A robot that was on for so long, and was switched off and on again, works without a restart."""
    robot = fleet.robots[0]
    under_way(fleet)
    # A clock that began anew is known by stamps that go back: it must have been on for longer than it will be off.
    tick(fleet, lambda: robot.read_state().vehicle_stamp_s > 1000.0 + on_s, on_s + 10.0)
    simulator.close()
    assert tick(fleet, lambda: robot.read_state().link is Link.STALE, 5.0)
    # Its clock, its session and its odometry begin anew.
    another = start_again()
    try:
        assert tick(fleet, lambda: robot.read_state().link is Link.UP, 10.0)
        assert tick(fleet, lambda: robot.read_state().controller is Controller.SC, 5.0)
        goal = robot.goto(Waypoint(2.3, 2.6), Controller.SC)
        assert tick(fleet, lambda: not goal.active, 20.0)
        assert goal.status is GoalStatus.REACHED
        assert robot.read_state().age_s(fleet.clock.now()) < 0.3
        fleet.close()
    finally:
        another.close()


def follows_another_program(first: Fleet, other: Fleet) -> None:
    """A robot that follows another program is refused; its lease must outlive what a busy host does to that program."""
    under_way(first)
    done = threading.Event()
    renewing = threading.Thread(target=lambda: tick(first, done.is_set, 30.0))
    renewing.start()
    try:
        with pytest.raises(RobotUnavailable, match="its mux follows another program, whose lease lives"):
            other.robots[0].init(5.0)
    finally:
        done.set()
        renewing.join()
