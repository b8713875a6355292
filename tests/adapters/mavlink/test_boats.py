"""Boats that drift where they have stopped: driven, held and refused. In virtual time; the truth is the world's."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.backend import VehicleBackend
from soter.adapters.mavlink.boats import drift_m
from soter.adapters.mavlink.robot import MavlinkRobot
from soter.errors import RobotUnavailable, Uncontrolled
from soter.sdk import Controller, Fleet, GoalStatus, Waypoint
from tests.adapters.mavlink.puppet import HostTime, Puppet, robot_of
from tests.adapters.mavlink.test_missions import SAFE, given_vehicle, once, options, run, sends_elsewhere
from tests.adapters.mavlink.test_vehicles import BACKENDS, started, tick
from tests.adapters.mavlink.virtual import VirtualBackend, Wire

LIKE = "ardurover-boat"
SC = Controller.SC
TIDE_M_S = 0.2
LOITER = 5

HELD = {
    "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0, "WP_PIVOT_ANGLE": 20.0, "FRAME_CLASS": 2.0, "LOIT_RADIUS": 0.2,
    "LOIT_TYPE": 0.0, "LOIT_SPEED_GAIN": 0.5, "WP_RADIUS": 0.1, "SAIL_ENABLE": 0.0, "FS_ACTION": 6.0,
    "FS_CRASH_CHECK": 0.0, "WP_SPEED": 0.22,
}  # fmt: skip
"""What a boat has that is held near where it has stopped."""


def sets(name: str, value: float, *systems: int) -> Callable[[Wire], None]:
    """Another ground station sets a parameter."""

    def tell(wire: Wire) -> None:
        for system in systems or (1,):
            wire.other(mav.MAVLink_param_set_message(system, 1, name.encode(), value, mav.MAV_PARAM_TYPE_REAL32))

    return tell


def flows(wire: Wire, now_s: float, m_s: float = TIDE_M_S) -> None:
    """Let there be a current from the first tick on, whose direction goes round."""
    if now_s < -4.9:
        sets("SIM_TIDE_SPD", m_s, 1, 2)(wire)
    sets("SIM_TIDE_DIR", 20.0 * now_s % 360.0, 1, 2)(wire)


def test_two_boats_that_drift_drive_their_mission_and_keep_their_places_in_the_end() -> None:
    fastest_m_s, drifted_s = 0.0, 0.0

    def watches(wire: Wire, now_s: float) -> None:
        nonlocal fastest_m_s, drifted_s
        flows(wire, now_s)
        bodies = wire.world.bodies
        fastest_m_s = max(fastest_m_s, *(abs(each) for each in bodies.v))
        drifted_s += 0.05 * sum(math.hypot(*each) > 0.9 * TIDE_M_S for each in bodies.carried.values())

    result = run(watches, 60.0, LIKE)
    promised_m_s = options(LIKE)["promise"]["v_max_m_s"]
    assert (result.status, result.violations, result.uncontrolled) == ("completed", SAFE, {})
    assert result.ac_share >= 0.8
    assert 0.9 * promised_m_s <= fastest_m_s <= promised_m_s
    assert drifted_s > 2.0
    wire = VirtualBackend.wire
    # In HOLD, or disarmed, they would drift away.
    assert {(each.mode.value, each.armed) for each in wire.autopilots} == {("LOITER", True)}


@pytest.fixture
def boat() -> Iterator[tuple[Fleet, MavlinkRobot]]:
    config, spec = given_vehicle(LIKE)
    with ExitStack() as opened:
        fleet = opened.enter_context(VirtualBackend().open(config, [spec]))
        (robot,) = fleet.robots
        assert isinstance(robot, MavlinkRobot)
        robot.init(60.0)
        robot.switch_ac_sc(SC, "test")
        sets("SIM_TIDE_SPD", TIDE_M_S)(VirtualBackend.wire)
        sets("LOIT_RADIUS", 0.3)(VirtualBackend.wire)
        yield fleet, robot


def ticks(fleet: Fleet, seconds: float) -> list[tuple[float, float, float]]:
    """Tick as a supervisor does; return where the boat really was, and its speed along its heading."""
    robot, wire = fleet.robots[0], VirtualBackend.wire
    places = []
    for _ in range(round(seconds / 0.05)):
        fleet.clock.sleep_until(fleet.clock.now() + 0.05)
        robot.read_state()
        robot.renew_lease()
        bodies = wire.world.bodies
        places.append((bodies.x[0], bodies.y[0], bodies.v[0]))
    return places


def most_m(robot: MavlinkRobot) -> float:
    """Return how far a boat may drift by its promise."""
    return drift_m({"LOIT_RADIUS": 0.3, "WP_RADIUS": 0.1}, robot.declared)


def test_a_boat_that_is_told_to_stand_drifts_within_what_is_promised_and_is_driven_back(
    boat: tuple[Fleet, MavlinkRobot],
) -> None:
    fleet, robot = boat
    goal = robot.goto(Waypoint(20.0, 19.0), SC)
    ticks(fleet, 4.0)
    goal.cancel()
    stopped = next(each for each in ticks(fleet, 3.0) if abs(each[2]) < 0.01)
    places = ticks(fleet, 60.0)
    off_m = [math.dist(stopped[:2], each[:2]) for each in places]
    assert 0.3 < max(off_m) <= most_m(robot)
    # It is driven back, again and again, and not told to stand on the way.
    assert max(abs(each[2]) for each in places[200:]) > 0.0
    assert max(off_m[-400:]) <= max(off_m[:400]) + 0.05


@pytest.mark.parametrize("turns", [True, False], ids=["turning", "driving"])
def test_a_boat_that_hears_nothing_more_stays_within_what_is_promised(
    boat: tuple[Fleet, MavlinkRobot], turns: bool
) -> None:
    fleet, robot = boat
    wire = VirtualBackend.wire
    # It looks east-north-east.
    robot.goto(Waypoint(16.0, 30.0) if turns else Waypoint(30.0, 20.0), SC)
    ticks(fleet, 0.4 if turns else 4.0)
    assert (abs(wire.world.bodies.v[0]) < 0.05) is turns
    heard = wire.world.truth.pose(1)[:2]
    off_m = 0.0
    for _ in range(600):
        wire.sleep(0.1)
        off_m = max(off_m, math.dist(heard, wire.world.truth.pose(1)[:2]))
    caps = robot.declared
    lease_m = caps.v_max_m_s * (caps.lease_s + caps.latency_s) + caps.v_max_m_s**2 / (2.0 * caps.brake_m_s2)
    assert 0.3 < off_m <= most_m(robot) + (0.0 if turns else lease_m)


def test_a_boat_that_is_nobodys_is_told_no_longer_than_it_brakes_and_is_held(boat: tuple[Fleet, MavlinkRobot]) -> None:
    fleet, robot = boat
    robot.goto(Waypoint(30.0, 20.0), SC)
    ticks(fleet, 4.0)
    sets("FS_ACTION", 2.0)(VirtualBackend.wire)
    with pytest.raises(Uncontrolled, match="its FS_ACTION is 2: it would stop its motors"):
        ticks(fleet, 2.0)
    places = []
    for _ in range(600):
        with pytest.raises(Uncontrolled):
            ticks(fleet, 0.05)
        places.append(VirtualBackend.wire.world.truth.pose(1)[:2])
    assert max(math.dist(places[100], each) for each in places[100:]) <= most_m(robot)


def test_a_boat_that_drifts_farther_than_is_promised_is_nobodys_and_told_to_stop_again(
    boat: tuple[Fleet, MavlinkRobot],
) -> None:
    fleet, robot = boat
    robot.goto(Waypoint(20.0, 19.0), SC).cancel()
    ticks(fleet, 3.0)
    sets("SIM_TIDE_SPD", 1.5)(VirtualBackend.wire)
    with pytest.raises(Uncontrolled, match=r"drifted .* where it had stopped, promise\.position_noise_m is 1\.9"):
        ticks(fleet, 10.0)


def test_a_boat_that_another_ground_station_sends_elsewhere_is_nobodys_as_long_as_that_lasts() -> None:
    result = run(sends_elsewhere, 12.0, LIKE)
    assert "another ground station sends it elsewhere" in result.uncontrolled[1].cause
    assert result.uncontrolled[1].lasted_s < 6.0
    assert (result.status, result.violations) == ("completed", SAFE)


def test_a_radius_beyond_the_promise_that_is_set_on_the_way_is_seen() -> None:
    result = run(once(sets("LOIT_RADIUS", 5.0)), 12.0, LIKE)
    assert "its LOIT_RADIUS is 5" in result.uncontrolled[1].cause
    assert result.violations == SAFE


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({}, ""),
        ({"LOIT_RADIUS": 2.0}, r"its LOIT_RADIUS is 2 .* 2.6 m, .* is 0.9 .* together less than 0.4"),
        ({"LOIT_RADIUS": math.nan}, "its LOIT_RADIUS is nan"),
        ({"LOIT_RADIUS": None}, "it does not say its LOIT_RADIUS"),
        ({"WP_RADIUS": 2.0}, "its WP_RADIUS 2: "),
        ({"SERVO1_FUNCTION": 26.0, "SERVO3_FUNCTION": 70.0}, "its SERVO1_FUNCTION is 26: it steers with its wheels"),
        ({"SERVO1_FUNCTION": 70.0, "SERVO3_FUNCTION": 26.0}, "SERVO8_FUNCTION are 70, 26: it has no motors on either"),
        ({"SERVO3_FUNCTION": None}, "are 73: it has no motors on either side"),
        ({"WP_PIVOT_ANGLE": 0.0}, "its WP_PIVOT_ANGLE is 0: it does not turn in place"),
        ({"FRAME_CLASS": 1.0}, "its FRAME_CLASS is 1: .* allowed: 2$"),
        ({"LOIT_TYPE": 1.0}, "its LOIT_TYPE is 1: .* allowed: 0$"),
        ({"LOIT_SPEED_GAIN": 0.0}, "its LOIT_SPEED_GAIN is 0, allowed for a boat: 0.5 to 1"),
        ({"SAIL_ENABLE": 1.0}, "its SAIL_ENABLE is 1: a sail drives it"),
        ({"FS_ACTION": 2.0}, "its FS_ACTION is 2: it would stop its motors, .* allowed: 0 or 6$"),
        ({"BATT_FS_LOW_ACT": 2.0}, "its BATT_FS_LOW_ACT is 2: it would stop its motors"),
        ({"FS_CRASH_CHECK": 1.0}, "its FS_CRASH_CHECK is 1: one that is held against a current counts as crashed"),
        ({"WP_SPEED": 0.5}, "its WP_SPEED is 0.5, .* promise.v_max_m_s is 0.22; allowed: at most 0.22"),
        ({"ATC_DECEL_MAX": 0.5}, "its ATC_DECEL_MAX is 0.5"),
    ],
)
def test_a_boat_that_would_not_be_held_as_is_promised_is_refused_before_it_is_armed(
    parameters: dict[str, Any], says: str
) -> None:
    puppet = Puppet(HostTime())
    puppet.kind = mav.MAV_TYPE_SURFACE_BOAT, mav.MAV_AUTOPILOT_ARDUPILOTMEGA
    puppet.gate = False
    puppet.parameters |= {name: value for name, value in (HELD | parameters).items() if value is not None}
    robot = robot_of(puppet, vehicle="boat")
    if not says:
        robot.init(20.0)
        return
    with pytest.raises(RobotUnavailable, match=says):
        robot.init(20.0)
    assert not puppet.armed


def test_a_boat_is_no_rover(puppet: Puppet) -> None:
    puppet.kind = mav.MAV_TYPE_SURFACE_BOAT, mav.MAV_AUTOPILOT_ARDUPILOTMEGA
    with pytest.raises(RobotUnavailable, match="it is a boat, and a rover was expected; set vehicle = 'boat'"):
        robot_of(puppet).init(20.0)


@BACKENDS
def test_a_boat_that_the_backend_simulates_is_driven_and_stays_armed(backend: type[VehicleBackend]) -> None:
    with ExitStack() as stack:
        fleet = started(stack, backend, vehicle="boat")
        robot = fleet.robots[0]
        goal = robot.goto(Waypoint(2.6, 3.4, radius_m=0.3), SC)
        assert tick(fleet, lambda: not goal.active)
        assert goal.status is GoalStatus.REACHED
        assert isinstance(robot, MavlinkRobot)
        robot.close(5.0)
        assert (robot._vehicle.mode, robot._vehicle.armed) == (LOITER, True)
