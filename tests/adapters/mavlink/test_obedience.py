"""A vehicle of strings that does not obey: reboots, silence, pilots, fail-safes. No wire, no waiting."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import SENDERS
from soter.errors import RobotUnavailable
from soter.sdk import Controller, Link
from tests.adapters.mavlink.puppet import FAR, ROVER_GUIDED, ROVER_HOLD, STANDS, Puppet, ready, robot_of, tick

AC, SC = Controller.AC, Controller.SC


def test_after_a_reboot_it_is_made_ready_again_without_being_opened_anew(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.goto(FAR, SC)
    tick(puppet, robot, 2)
    puppet.reboot()
    tick(puppet, robot, 120)
    assert (puppet.mode, puppet.armed, puppet.master) == (ROVER_GUIDED, True, SENDERS[SC])
    state = robot.read_state()
    assert state.age_s(robot.clock.now()) < 0.1
    assert state.vehicle_stamp_s < 10.0
    assert puppet.targets()[-1][1]["type_mask"] != STANDS


@pytest.mark.parametrize("origin", [None, {"lat_deg": 47.3977420, "lon_deg": 8.5455940, "alt_m": 488.0}])
def test_a_reboot_moves_the_origin_and_no_sample_is_of_the_old_one(
    puppet: Puppet, origin: dict[str, float] | None
) -> None:
    robot = ready(puppet, origin=origin)
    puppet.y_m = 3.0
    tick(puppet, robot, 2)
    assert robot.read_state().y_m == pytest.approx(3.0, abs=0.01)
    # Its EKF begins where it stands.
    puppet.reboot()
    puppet.origin_lat += round(3.0 / 111_194.0 * 1e7)
    puppet.y_m = 0.0
    north_m = []
    for _ in range(120):
        tick(puppet, robot)
        state = robot.read_state()
        if state.age_s(robot.clock.now()) < 0.1:
            north_m.append(state.y_m)
    assert len(north_m) > 60
    assert north_m == pytest.approx([3.0] * len(north_m), abs=0.02)


def test_a_position_from_before_a_reboot_is_not_moved_by_a_turn_from_after_it(puppet: Puppet) -> None:
    robot = ready(puppet)
    puppet.speed_m_s = 0.2
    tick(puppet, robot, 2)
    before = robot.read_state()
    puppet.reboot()
    # Only half of a sample is heard of the new life yet.
    for _ in range(10):
        puppet.time.now_s += 0.02
        puppet.clock_s += 0.02
        puppet.say("ATTITUDE", time_boot_ms=round(puppet.clock_s * 1e3), yaw=puppet.yaw_rad, yawspeed=0.0)
        assert robot.read_state().y_m == pytest.approx(before.y_m, abs=0.01)


@pytest.mark.parametrize("reboots", [False, True])
def test_one_that_was_away_hears_of_a_switch_to_its_sc_at_once_and_of_no_renewal(puppet: Puppet, reboots: bool) -> None:
    robot = ready(puppet)
    robot.switch_ac_sc(AC, "test")
    robot.goto(FAR, AC)
    tick(puppet, robot, 2)
    assert puppet.master == SENDERS[AC]
    puppet.silent = True
    tick(puppet, robot, 120)
    robot.switch_ac_sc(SC, "test")
    tick(puppet, robot, 4)
    puppet.silent = False
    if reboots:
        puppet.reboot()
    puppet.sent.clear()
    assert len(tick(puppet, robot, 4)) == 4, "it is not ready yet"
    assert puppet.master == SENDERS[SC]
    renewed_s = [fields["x"] * 1e-3 for fields in puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)]
    assert not puppet.targets()
    assert reboots or max(renewed_s) < puppet.clock_s - robot.capabilities.lease_s
    assert len(tick(puppet, robot, 120)) < 120, "it gets ready all the same"


@pytest.mark.parametrize("returns", ["stopped", "rebooted"])
def test_one_that_is_not_driven_because_it_was_away_is_heard_again_all_the_same(puppet: Puppet, returns: str) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot, 2)
    puppet.silent, last_s = True, puppet.clock_s
    for _ in range(60):
        puppet.live(0.05)
        robot.read_state()
    puppet.silent, puppet.clock_s = False, last_s
    if returns == "rebooted":
        puppet.reboot()
    puppet.sent.clear()
    # Its lease is withheld, since what it says is too old.
    for _ in range(200):
        puppet.live(0.05)
        robot.read_state()
    assert robot.read_state().age_s(robot.clock.now()) < 0.1
    assert "HEARTBEAT" not in [name for _, name, _ in puppet.sent]
    assert tick(puppet, robot) == []
    assert (puppet.mode, puppet.armed) == (ROVER_GUIDED, True)


def test_silence_is_seen_as_age_and_what_comes_after_it_is_obeyed(puppet: Puppet) -> None:
    robot = ready(puppet)
    puppet.silent = True
    tick(puppet, robot, 80)
    assert robot.read_state().link is Link.DOWN
    puppet.silent = False
    # Its fail-safe has acted.
    puppet.mode = ROVER_HOLD
    tick(puppet, robot, 120)
    assert robot.read_state().link is Link.UP
    assert puppet.mode == ROVER_GUIDED


def test_a_copter_that_flies_after_a_silence_is_not_told_to_take_off(puppet: Puppet) -> None:
    puppet.kind = (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
    robot = ready(puppet, vehicle="copter", height_m=2.0)
    puppet.silent = True
    tick(puppet, robot, 80)
    puppet.silent, puppet.up_m = False, 1.0
    tick(puppet, robot, 120)
    assert not puppet.commands(mav.MAV_CMD_NAV_TAKEOFF)
    assert puppet.master == SENDERS[SC]


@pytest.mark.parametrize("gate", [True, False])
def test_a_pilot_who_takes_it_out_of_guided_keeps_it_until_he_gives_it_back(puppet: Puppet, gate: bool) -> None:
    puppet.gate = gate
    robot = ready(puppet)
    puppet.mode = 0
    assert set(tick(puppet, robot, 400)) == {"it is in the mode MANUAL, not GUIDED"}
    assert puppet.mode == 0
    assert not puppet.commands(mav.MAV_CMD_DO_SET_MODE)
    assert robot.read_state().controller is None
    puppet.mode = ROVER_GUIDED
    assert tick(puppet, robot) == []
    robot.goto(FAR, SC)
    assert puppet.targets()[-1][1]["type_mask"] != STANDS


def test_one_that_others_disarm_is_left_alone_and_said_to_be(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    puppet.armed = False
    assert set(tick(puppet, robot, 40)) == {"it is disarmed"}
    assert not puppet.commands(mav.MAV_CMD_COMPONENT_ARM_DISARM)


JUDGED = {
    "SERVO1_FUNCTION": 73.0, "WP_PIVOT_ANGLE": 60.0, "ATC_DECEL_MAX": 0.0, "ATC_ACCEL_MAX": 2.0,
    "WP_PIVOT_RATE": 80.0, "ATC_STR_ANG_P": 2.0,
}  # fmt: skip
ALL_ASKED_TICKS = 20 * len(JUDGED) + 2


@pytest.mark.parametrize("told", [True, False], ids=["told", "asked"])
@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("WP_PIVOT_ANGLE", 0.0, "its WP_PIVOT_ANGLE is 0: it does not turn in place"),
        ("ATC_ACCEL_MAX", 0.5, "its ATC_ACCEL_MAX is 0.5, which is 0.5 m/s2, and promise.brake_m_s2 is 1;"),
        ("ATC_DECEL_MAX", 0.1, "its ATC_DECEL_MAX is 0.1, which is 0.1 m/s2, and promise.brake_m_s2 is 1;"),
        ("WP_PIVOT_RATE", 0.0, "its WP_PIVOT_RATE is 0, which is no limit, and promise.yaw_rate_max_rad_s is 2.84;"),
    ],
)
def test_one_whose_parameters_somebody_sets_so_that_it_cannot_keep_its_promise_is_nobodys_until_they_allow_it(
    puppet: Puppet, name: str, value: float, says: str, told: bool
) -> None:
    puppet.gate = False
    puppet.parameters |= JUDGED
    robot = ready(puppet)
    robot.goto(FAR, SC)
    assert tick(puppet, robot, 2) == []
    puppet.parameters[name] = value
    if told:
        puppet.say("PARAM_VALUE", param_id=name, param_value=value)
        (why,) = tick(puppet, robot)
        assert why.startswith(says)
    else:
        # What it said of it was lost on the way: within as many seconds as there are such parameters.
        assert tick(puppet, robot, ALL_ASKED_TICKS)[-1].startswith(says)
    assert puppet.targets()[-1][1]["type_mask"] == STANDS
    puppet.parameters[name] = JUDGED[name]
    tick(puppet, robot, ALL_ASKED_TICKS)
    assert tick(puppet, robot) == []
    assert puppet.targets()[-1][1]["type_mask"] != STANDS


def test_what_it_says_of_parameters_that_were_not_asked_for_is_not_kept(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    before = dict(robot._vehicle.parameters)
    puppet.say("PARAM_VALUE", param_id="SCHED_LOOP_RATE", param_value=50.0)
    assert robot._vehicle.parameters == before


def test_what_a_fail_safe_took_is_taken_back_once_its_cause_is_gone(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    puppet.status = mav.MAV_STATE_CRITICAL
    assert tick(puppet, robot, 2) == ["its own fail-safe acts"] * 2
    puppet.mode = ROVER_HOLD
    tick(puppet, robot, 40)
    assert puppet.mode == ROVER_HOLD
    puppet.status = mav.MAV_STATE_ACTIVE
    tick(puppet, robot, 120)
    assert puppet.mode == ROVER_GUIDED
    assert tick(puppet, robot) == []


@pytest.mark.parametrize(
    ("name", "value", "believed"),
    [("compass", math.nan, True), ("compass", 0.9, False), ("variance", math.nan, False)],
)
def test_a_px4_needs_no_compass_to_know_where_it_is_but_one_that_it_has_must_agree(
    puppet: Puppet, name: str, value: float, believed: bool
) -> None:
    puppet.kind, puppet.gate, puppet.ekf = (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_PX4), False, 831
    robot = ready(puppet, vehicle="copter", height_m=2.0)
    tick(puppet, robot, 3)
    setattr(puppet, name, value)
    troubles = tick(puppet, robot, 22)
    assert believed == (not troubles)
    assert believed or "does not believe what it measures" in troubles[0]


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ({"ekf": 167}, "its EKF does not know"),
        ({"ekf": 831 | mav.EKF_GPS_GLITCHING}, "GPS jump"),
        ({"variance": 0.9}, "pos_horiz_variance is 0.90"),
        ({"variance": float("nan")}, "pos_horiz_variance is nan"),
        ({"fix": mav.GPS_FIX_TYPE_NO_FIX}, "fix type 1"),
        ({"finds": False}, "its GPS has found no place"),
        ({"accuracy_mm": 601}, "its GPS says that it is off by up to 0.60 m, allowed: gps_accuracy_m = 0.60"),
    ],
)
def test_a_vehicle_that_does_not_know_where_it_is_gives_no_samples(
    puppet: Puppet, what: dict[str, float], said: str
) -> None:
    puppet.gate = False
    robot = ready(puppet)
    robot.goto(FAR, SC)
    tick(puppet, robot, 3)
    for name, value in what.items():
        setattr(puppet, name, value)
    # A second at most.
    troubles = tick(puppet, robot, 22)
    assert said in troubles[0]
    before = robot.read_state()
    tick(puppet, robot, 12)
    state = robot.read_state()
    assert (state.stamp_s, state.link) == (before.stamp_s, Link.STALE)
    assert puppet.targets()[-1][1]["type_mask"] == STANDS
    puppet.ekf, puppet.variance, puppet.fix, puppet.finds = 831, 0.01, mav.GPS_FIX_TYPE_3D_FIX, True
    puppet.accuracy_mm = 600
    tick(puppet, robot, 2)
    assert robot.read_state().link is Link.UP


@pytest.mark.parametrize("says_none", [True, False])
def test_a_gps_that_says_how_far_it_is_off_is_waited_for_where_the_options_ask_for_less(
    puppet: Puppet, says_none: bool
) -> None:
    puppet.accuracy_mm = 0 if says_none else 400
    robot = robot_of(puppet, gps_accuracy_m=0.2)
    if says_none:
        robot.init(20.0)
        return
    with pytest.raises(RobotUnavailable, match=r"as accurate as gps_accuracy_m = 0\.2; it says 0\.40 m"):
        robot.init(5.0)
    assert not puppet.armed
    puppet.accuracy_mm = 150
    robot.init(20.0)
    assert tick(puppet, robot, 2) == []
    # Not twice what it was.
    puppet.accuracy_mm = 201
    assert "allowed: gps_accuracy_m = 0.20" in tick(puppet, robot, 2)[-1]


@pytest.mark.parametrize("autopilot", [mav.MAV_AUTOPILOT_ARDUPILOTMEGA, mav.MAV_AUTOPILOT_PX4], ids=["ardu", "px4"])
@pytest.mark.parametrize("moves", [True, False], ids=["moves", "corrected"])
def test_a_place_that_leaps_is_no_sample_before_the_origin_is_known_again(
    puppet: Puppet, moves: bool, autopilot: int
) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, autopilot), False
    robot = ready(puppet, origin={"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0})
    tick(puppet, robot, 2)
    puppet.deaf_to = {mav.MAV_CMD_REQUEST_MESSAGE}
    # 11.13 m: its EKF has another origin, or has found that it was wrong.
    puppet.y_m += -11.13 if moves else 11.13
    for _ in range(4):
        (why,) = tick(puppet, robot)
        assert why == "its place has leapt by 11.1 m: the origin of its EKF may have moved"
        assert robot.read_state().y_m == pytest.approx(0.0, abs=0.01)
    assert puppet.commands(mav.MAV_CMD_REQUEST_MESSAGE)[-1]["param1"] == mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
    assert puppet.targets()[-1][1]["type_mask"] == STANDS
    puppet.deaf_to = set()
    puppet.origin_lat += 1000 * moves
    puppet.tell_origin()
    north_m = []
    for _ in range(120):
        tick(puppet, robot)
        state = robot.read_state()
        if state.age_s(robot.clock.now()) < 0.1:
            north_m.append(state.y_m)
    assert len(north_m) > 60
    assert north_m == pytest.approx([0.0 if moves else 11.13] * len(north_m), abs=0.02)
    assert tick(puppet, robot) == []


def test_an_ekf_that_begins_anew_elsewhere_is_heard_again_once_its_origin_is_known(puppet: Puppet) -> None:
    puppet.gate = False
    origin = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0}
    robot = ready(puppet, origin=origin)
    puppet.origin_lat = 473977420 + 1000
    puppet.tell_origin()
    assert tick(puppet, robot)[0].startswith("the origin of its EKF has moved by 11.13 m: it is made ready again")
    tick(puppet, robot, 120)
    assert robot.read_state().y_m == pytest.approx(11.13, abs=0.01)


def test_one_that_was_started_anew_while_it_was_young_is_made_ready_again(puppet: Puppet) -> None:
    puppet.gate = False
    puppet.clock_s = 1.0
    robot = ready(puppet)
    tick(puppet, robot, 4)
    last_s = puppet.clock_s
    puppet.silent = True
    tick(puppet, robot, 50)
    # Its new clock shows more than the old one did, and it was not away for long enough to be missed.
    puppet.silent, puppet.clock_s = False, last_s + 0.2
    puppet.mode, puppet.armed = 0, False
    tick(puppet, robot, 120)
    assert (puppet.mode, puppet.armed) == (ROVER_GUIDED, True)


def test_fixes_without_a_time_are_new_as_long_as_they_come(puppet: Puppet) -> None:
    puppet.times_fixes = False
    robot = ready(puppet)
    assert tick(puppet, robot, 60) == []
    puppet.finds = False
    assert "its GPS has found no place for 0.8 s" in tick(puppet, robot, 60)[0]


@pytest.mark.parametrize("autopilot", [mav.MAV_AUTOPILOT_ARDUPILOTMEGA, mav.MAV_AUTOPILOT_PX4])
def test_an_ekf_that_says_no_more_whether_it_knows_where_it_is_is_not_believed(puppet: Puppet, autopilot: int) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, autopilot), False
    robot = ready(puppet)
    puppet.tells_ekf = False
    tick(puppet, robot, 30)
    assert robot.read_state().age_s(robot.clock.now()) < 0.1
    tick(puppet, robot, 30)
    assert robot.read_state().age_s(robot.clock.now()) > 0.5, "positions go on, and age"
    puppet.tells_ekf = True
    tick(puppet, robot, 2)
    assert robot.read_state().age_s(robot.clock.now()) < 0.1


def test_where_a_robot_is_is_known_again_long_before_it_is_ready_again(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    puppet.silent = True
    tick(puppet, robot, 100)
    # Its places are heard a little earlier than its heartbeat and its EKF, and its own fail-safe has acted.
    stamp = {"time_boot_ms": round(puppet.clock_s * 1e3)}
    puppet.say("LOCAL_POSITION_NED", **stamp, x=1.0, y=1.0, z=0.0, vx=0.0, vy=0.0, vz=0.0)
    tick(puppet, robot)
    puppet.silent, puppet.armed, puppet.refuses_to_arm, puppet.x_m = False, False, "PreArm: not yet", 2.0
    tick(puppet, robot, 40)
    state = robot.read_state()
    assert puppet.clock_s - state.vehicle_stamp_s < 0.1
    assert state.x_m == 2.0
    assert not puppet.armed


@pytest.mark.parametrize("vehicle", ["rover", "copter"])
def test_a_copter_that_another_has_led_off_is_nobodys_until_it_has_come_to_rest(puppet: Puppet, vehicle: str) -> None:
    flies, puppet.gate = vehicle == "copter", False
    puppet.kind = (mav.MAV_TYPE_QUADROTOR if flies else mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
    robot = ready(puppet, vehicle=vehicle)
    assert tick(puppet, robot, 2) == []
    puppet.say("POSITION_TARGET_GLOBAL_INT", lat_int=puppet.origin_lat + 1000, lon_int=85455940)
    (led,) = tick(puppet, robot)
    assert "another ground station sends it elsewhere" in led
    puppet.speed_m_s = 0.1
    assert tick(puppet, robot, 18)[-1] == led
    swings = {"another ground station has sent it elsewhere, and it has not come to rest since"}
    assert set(tick(puppet, robot, 60)[10:]) == (swings if flies else set())
    puppet.speed_m_s = math.nan
    assert set(tick(puppet, robot, 30)[25:]) == (swings if flies else set())
    puppet.speed_m_s = 0.0
    assert len(tick(puppet, robot, 60)) in (range(18, 22) if flies else (0,))
