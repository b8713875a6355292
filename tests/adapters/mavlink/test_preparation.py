"""Vehicles get ready, or are refused before they are armed. No wire, no waiting."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import SENDERS
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import Controller, Link, Waypoint
from soter.sdk.robot import FUTURE_S
from tests.adapters.mavlink.puppet import ROVER_GUIDED, ROVER_HOLD, HostTime, Puppet, ready, robot_of, tick
from tests.adapters.mavlink.virtual import VirtualBackend, VirtualConfig
from tests.adapters.velocity_controlled.driving import ROOM, SPECS

AC, SC = Controller.AC, Controller.SC


def test_a_vehicle_gets_ready_and_reports_who_is_in_charge(puppet: Puppet) -> None:
    robot = ready(puppet)
    assert (puppet.mode, puppet.armed, puppet.master) == (ROVER_GUIDED, True, SENDERS[SC])
    assert robot.capabilities == robot.declared
    puppet.live()
    state = robot.read_state()
    assert (state.controller, state.battery, state.link) == (SC, 0.8, Link.UP)
    assert puppet.parameters["SOTER_LEASE_MS"] == round(1e3 * robot.declared.lease_s)


def test_a_rate_that_is_denied_is_lowered(puppet: Puppet) -> None:
    puppet.most_hz = 30.0
    ready(puppet, stream_hz=20.0)
    assert 20.0 <= puppet.streams[mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED] <= 30.0


def test_a_rate_below_what_is_promised_is_refused(puppet: Puppet) -> None:
    puppet.most_hz = 30.0
    with pytest.raises(RobotUnavailable, match=r"ATTITUDE 50 times a second \(DENIED\); set a lower stream_hz"):
        robot_of(puppet).init(20.0)


def test_it_waits_for_the_ekf_and_not_for_the_first_position(puppet: Puppet) -> None:
    puppet.ekf = 167
    with pytest.raises(RobotUnavailable, match="EKF to know where it is"):
        robot_of(puppet).init(5.0)
    assert not puppet.commands(mav.MAV_CMD_COMPONENT_ARM_DISARM)


def test_a_vehicle_that_refuses_to_arm_says_why(puppet: Puppet) -> None:
    puppet.refuses_to_arm = "PreArm: Compass not \x1b[2Jcalibrated"
    with pytest.raises(RobotUnavailable, match=r"it to arm; it says: PreArm: Compass not \?\[2Jcalibrated"):
        robot_of(puppet).init(10.0)


def test_it_is_not_ready_while_its_samples_come_out_as_of_the_future(puppet: Puppet) -> None:
    robot, puppet.answered_late_s = robot_of(puppet), 0.3
    with pytest.raises(RobotUnavailable, match="samples come out as of the future"):
        robot.init(3.0)
    puppet.answered_late_s = 0.0
    robot.init(3.0)
    assert robot.read_state().stamp_s <= robot.clock.now() + FUTURE_S


def test_rest_is_what_the_promised_noise_of_the_speed_allows(puppet: Puppet) -> None:
    puppet.speed_m_s = 0.03
    with pytest.raises(RobotUnavailable, match=r"shows 0\.030 m/s .* promise\.speed_noise_m_s = 0\.01"):
        robot_of(puppet).init(5.0)
    other = Puppet(HostTime())
    # A gyroscope shakes, too: the rim of a body of 0.35 m seems to move by the same noise.
    other.speed_m_s, other.yaw_rate_rad_s = 0.03, 0.05
    with pytest.raises(RobotUnavailable, match=r"0\.050 rad/s, allowed at rest: .* and 0\.029 rad/s"):
        robot_of(other, promise={"speed_noise_m_s": 0.03, "body_radius_m": 1.05}).init(5.0)
    robot = ready(other, promise={"speed_noise_m_s": 0.05, "body_radius_m": 0.35})
    assert robot.declared.moving_m_s == pytest.approx(0.07)
    began_s = other.time()
    robot.close(5.0)
    assert other.time() - began_s < 1.0


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"ATC_DECEL_MAX": 0.5, "ATC_ACCEL_MAX": 2.0}, "its ATC_DECEL_MAX is 0.5, .* promise.brake_m_s2 is 1;"),
        ({"ATC_DECEL_MAX": 0.0, "ATC_ACCEL_MAX": 0.9}, "its ATC_ACCEL_MAX is 0.9"),
        ({"ATC_DECEL_MAX": math.nan}, "its ATC_DECEL_MAX is nan"),
        ({"ATC_DECEL_MAX": 1.0}, ""),
        ({"ATC_DECEL_MAX": 0.0, "ATC_ACCEL_MAX": 0.0}, ""),
        ({"WP_PIVOT_RATE": 0.0}, "its WP_PIVOT_RATE is 0, which is no limit"),
        ({"WP_PIVOT_RATE": 180.0}, "its WP_PIVOT_RATE is 180, which is 3.142 rad/s, .*yaw_rate_max_rad_s is 2.84;"),
        ({"WP_PIVOT_RATE": 162.0}, ""),
    ],
)
def test_a_vehicle_that_may_not_brake_as_promised_is_refused_before_it_is_armed(
    puppet: Puppet, parameters: dict[str, float], says: str
) -> None:
    puppet.gate = False
    puppet.parameters |= parameters
    robot = robot_of(puppet)
    if not says:
        robot.init(20.0)
        return
    with pytest.raises(RobotUnavailable, match=says):
        robot.init(20.0)
    assert not puppet.armed


@pytest.mark.parametrize(
    ("name", "value"),
    [("SERVO1_FUNCTION", 26.0), ("WP_PIVOT_ANGLE", 0.0), ("WP_PIVOT_ANGLE", 5.0), ("WP_PIVOT_ANGLE", math.nan)],
)
def test_a_rover_that_cannot_turn_in_place_is_refused_before_it_is_armed(
    puppet: Puppet, name: str, value: float
) -> None:
    puppet.gate = False
    puppet.parameters |= {"SERVO1_FUNCTION": 73.0, "WP_PIVOT_ANGLE": 60.0}
    robot_of(puppet).init(20.0)
    other = Puppet(HostTime())
    other.gate = False
    other.parameters |= {"SERVO1_FUNCTION": 73.0, "WP_PIVOT_ANGLE": 60.0, name: value}
    with pytest.raises(RobotUnavailable, match=f"its {name} is {value:g}: .* allowed: skid steering"):
        robot_of(other).init(20.0)
    assert not other.armed


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("WPNAV_ACCEL", 190.0, r"its WPNAV_ACCEL is 190, which is 1.9 m/s2, and promise.brake_m_s2 is 2;"),
        ("WP_ACC", 1.9, r"its WP_ACC is 1.9, which is 1.9 m/s2, and promise.brake_m_s2 is 2;"),
        ("WPNAV_ACCEL", math.nan, "its WPNAV_ACCEL is nan"),
        ("WPNAV_ACCEL", 200.0, ""),
        ("WPNAV_SPEED", 23.0, r"its WPNAV_SPEED is 23, which is 0.23 m/s, .* is 0.22; allowed: at most 22$"),
        ("WP_SPD", 10.0, r"its WP_SPD is 10, .* promise.v_max_m_s is 0.22; allowed: at most 0.22$"),
        ("WP_SPD", math.nan, "its WP_SPD is nan"),
        ("WPNAV_SPEED", 22.0, ""),
        ("WP_SPD", 0.2199999988079071, ""),
        (
            "ATC_RATE_Y_MAX",
            0.0,
            r"its ATC_RATE_Y_MAX is 0, which is no limit, .* is 1.5; .* at most 85.94$",
        ),
        ("ATC_RATE_Y_MAX", 86.0, r"its ATC_RATE_Y_MAX is 86, which is 1.501 rad/s, and .* at most 85.94$"),
        ("ATC_RATE_Y_MAX", math.nan, "its ATC_RATE_Y_MAX is nan"),
        ("ATC_RATE_Y_MAX", 85.0, ""),
    ],
)
def test_a_copter_whose_own_speed_turns_and_braking_are_not_as_promised_is_refused_before_it_is_armed(
    puppet: Puppet, name: str, value: float, says: str
) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA), False
    puppet.parameters[name] = value
    robot = robot_of(puppet, vehicle="copter")
    if not says:
        robot.init(20.0)
        return
    with pytest.raises(RobotUnavailable, match=says):
        robot.init(20.0)
    assert not puppet.armed


def test_a_vehicle_that_is_not_there_is_missed_in_time_and_others_are_named(puppet: Puppet) -> None:
    puppet.silent = True
    puppet.strangers.update({7, 3})
    began_s = puppet.time()
    with pytest.raises(RobotUnavailable, match=r"lacks a heartbeat; heard are the systems \[3, 7\]"):
        robot_of(puppet).init(2.0)
    assert puppet.time() - began_s < 2.5


def test_what_was_refused_once_is_not_taken_for_ready_the_next_time(puppet: Puppet) -> None:
    robot = ready(puppet)
    puppet.reboot()
    puppet.most_hz = 10.0
    assert "does not send ATTITUDE" in tick(puppet, robot, 50)[-1]
    assert not puppet.armed


def test_one_that_cannot_be_commanded_is_left_alone_when_closed(puppet: Puppet) -> None:
    puppet.kind = (mav.MAV_TYPE_FIXED_WING, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
    robot = robot_of(puppet)
    with pytest.raises(RobotUnavailable, match="robot 1: it is a vehicle of MAV_TYPE 1"):
        robot.init(5.0)
    puppet.sent.clear()
    robot.close(1.0)
    assert not puppet.sent


def test_another_kind_of_vehicle_than_promised_is_refused(puppet: Puppet) -> None:
    with pytest.raises(RobotUnavailable, match="it is a rover, and a copter was expected; set vehicle = 'rover'"):
        robot_of(puppet, vehicle="copter").init(5.0)


def test_what_it_was_on_its_way_to_is_dropped_first(puppet: Puppet) -> None:
    puppet.mode, puppet.armed = ROVER_GUIDED, True
    robot_of(puppet).init(20.0)
    modes = [fields["param2"] for fields in puppet.commands(mav.MAV_CMD_DO_SET_MODE)]
    assert modes[0] == ROVER_HOLD
    assert modes[-1] == ROVER_GUIDED


@pytest.mark.parametrize("autopilot", [mav.MAV_AUTOPILOT_ARDUPILOTMEGA, mav.MAV_AUTOPILOT_PX4])
def test_a_copter_takes_off_to_its_height_which_is_the_plane_of_the_workspace(puppet: Puppet, autopilot: int) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_QUADROTOR, autopilot), False
    robot = ready(puppet, vehicle="copter", height_m=2.0)
    puppet.live()
    assert puppet.up_m == pytest.approx(2.0)
    assert robot.read_state().z_m == pytest.approx(0.0)
    assert puppet.mode == (4 if autopilot == mav.MAV_AUTOPILOT_ARDUPILOTMEGA else 6 << 16)
    tick(puppet, robot)
    robot.goto(Waypoint(1.0, 0.0, z_m=0.5, heading_rad=0.0), SC)
    assert puppet.targets()[-1][1]["z"] < -2.0


@pytest.mark.parametrize(("up_m", "aloft", "armed"), [(0.2, True, True), (0.4, False, False), (-0.4, False, False)])
def test_a_copter_climbs_from_where_it_hovers_and_from_a_ground_that_its_estimate_has_drifted_from(
    puppet: Puppet, up_m: float, aloft: bool, armed: bool
) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA), False
    puppet.up_m, puppet.aloft, puppet.armed = up_m, aloft, armed
    robot_of(puppet, vehicle="copter", height_m=2.0).init(20.0)
    assert puppet.up_m == 2.0
    assert puppet.commands(mav.MAV_CMD_NAV_TAKEOFF)


def test_px4_is_sent_targets_before_it_is_asked_to_take_them_and_from_then_on(puppet: Puppet) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_PX4), False
    robot_of(puppet).init(20.0)
    names = [name for _, name, fields in puppet.sent if name != "TIMESYNC"]
    modes = [fields for fields in puppet.commands(mav.MAV_CMD_DO_SET_MODE) if fields["param2"] == 6.0]
    first = next(number for number, (_, _, fields) in enumerate(puppet.sent) if fields == modes[0])
    assert "SET_POSITION_TARGET_LOCAL_NED" in [name for _, name, _ in puppet.sent[first : first + 40]]
    assert names.count("SET_POSITION_TARGET_LOCAL_NED") >= 2


@pytest.mark.parametrize(
    ("autopilot", "reverses"), [(mav.MAV_AUTOPILOT_ARDUPILOTMEGA, True), (mav.MAV_AUTOPILOT_PX4, False)]
)
def test_without_a_gate_only_an_ardurover_is_told_which_way_to_drive(
    puppet: Puppet, autopilot: int, reverses: bool
) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, autopilot), False
    assert robot_of(puppet).declared.reverses
    assert ready(puppet).capabilities.reverses is reverses


def test_without_a_gate_it_promises_less(puppet: Puppet) -> None:
    puppet.gate, puppet.percent = False, -1
    robot = ready(puppet)
    found = robot.capabilities
    assert (found.reports_controller, found.pivots_first, found.reports_battery) == (False, False, False)
    puppet.live()
    assert robot.read_state().controller is None


def test_a_vehicle_that_does_not_answer_timesync_is_timed_by_its_samples(puppet: Puppet) -> None:
    puppet.answers_time = False
    robot = ready(puppet)
    puppet.live()
    assert 0.0 <= robot.read_state().age_s(robot.clock.now()) < 0.05


@pytest.mark.parametrize("better_s", [0.004, 0.03])
def test_a_clock_that_is_learned_better_costs_no_sample(puppet: Puppet, better_s: float) -> None:
    robot = ready(puppet)
    assert isinstance(puppet.clock, VehicleClock)
    for _ in range(4):
        puppet.live(0.02)
        before = robot.read_state()
        puppet.clock.observe(1, puppet.clock_s + better_s, puppet.time())
        newer = {"time_boot_ms": round(puppet.clock_s * 1e3) + 20}
        puppet.say("LOCAL_POSITION_NED", **newer, x=0.0, y=0.0, z=0.0, vx=0.0, vy=0.0, vz=0.0)
        assert robot.read_state() == before
        puppet.say("ATTITUDE", **newer, yaw=0.5, yawspeed=0.0)
        after = robot.read_state()
        assert after.vehicle_stamp_s == pytest.approx(before.vehicle_stamp_s + 0.02)
        assert after.stamp_s >= before.stamp_s
        puppet.clock_s += 0.02
        puppet.time.now_s += 0.02
    assert robot.discarded == 0


@pytest.mark.parametrize(
    ("autopilot", "flags", "starts"),
    [
        (mav.MAV_AUTOPILOT_PX4, 1023, True),
        (mav.MAV_AUTOPILOT_PX4, 1023 | mav.ESTIMATOR_GPS_GLITCH, False),
        (mav.MAV_AUTOPILOT_PX4, 229, False),
        (mav.MAV_AUTOPILOT_ARDUPILOTMEGA, 831 | mav.EKF_CONST_POS_MODE, False),
    ],
)
def test_a_px4_that_stands_on_the_ground_knows_where_it_is_though_it_says_that_its_position_is_constant(
    puppet: Puppet, autopilot: int, flags: int, starts: bool
) -> None:
    puppet.kind, puppet.gate, puppet.ekf = (mav.MAV_TYPE_QUADROTOR, autopilot), False, flags
    robot = robot_of(puppet, vehicle="copter", height_m=2.0)
    if starts:
        robot.init(20.0)
        return
    with pytest.raises(RobotUnavailable, match="its EKF to know where it is"):
        robot.init(5.0)


def test_a_px4_is_not_asked_for_a_gate(puppet: Puppet) -> None:
    puppet.kind = (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_PX4)
    robot = ready(puppet, vehicle="copter", height_m=2.0)
    assert not puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)
    assert not robot.capabilities.reports_controller


@pytest.mark.parametrize("like", [None, "arducopter"])
def test_copters_climb_together_once_none_lacks_anything_but_to_be_armed(like: str | None) -> None:
    promise = {"speed_noise_m_s": 0.15} if like else {}
    config = VirtualConfig(workspace=ROOM, vehicle="copter", height_m=10.0, like=like, promise=promise)
    with VirtualBackend().open(config, SPECS) as fleet:
        wire = VirtualBackend.wire
        armed_s: dict[int, float] = {}

        def look() -> None:
            for autopilot in wire.autopilots:
                if autopilot.armed:
                    armed_s.setdefault(autopilot.id, wire.host_s)

        wire.between = look
        fleet.robots[0].init(120.0)
        one_s = wire.host_s
        assert armed_s.keys() == {1, 2}
        assert abs(armed_s[1] - armed_s[2]) < 1.0
        fleet.robots[1].init(120.0)
        assert wire.host_s - one_s < 0.3 * (one_s - armed_s[1]), "it has climbed already"
