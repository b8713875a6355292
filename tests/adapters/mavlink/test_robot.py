"""One robot over a vehicle of strings: getting ready, authority, the dead man, reboots. No wire, no waiting."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER, SENDERS
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.robot import MavlinkRobot
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable, Uncontrolled, Unsupported
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Controller, GoalStatus, Link, RobotSpec, Waypoint
from soter.sdk.robot import FUTURE_S
from tests.adapters.mavlink.puppet import ROVER_GUIDED, ROVER_HOLD, HostTime, Puppet

AC, SC = Controller.AC, Controller.SC
ROOM = Workspace(4.0, 4.0, (), (RobotPlace(1, 1.0, 1.0, Box(0.9, 0.9, 1.1, 1.1)),))
FAR = Waypoint(3.0, 0.0)
STANDS = 0x05C7


@pytest.fixture
def puppet() -> Puppet:
    """A vehicle that lives while the adapter sleeps."""
    return Puppet(HostTime())


def robot_of(puppet: Puppet, **options: object) -> MavlinkRobot:
    assert isinstance(puppet.clock, VehicleClock)
    config = MavlinkConfig.model_validate({"workspace": ROOM, **options})
    spec = RobotSpec(1, 0.0, 0.0, 0.0, promised=replace(config.promised(), **config.promise.given))
    return MavlinkRobot(spec, puppet.clock, puppet, config)


def ready(puppet: Puppet, **options: object) -> MavlinkRobot:
    robot = robot_of(puppet, **options)
    robot.init(20.0)
    puppet.sent.clear()
    return robot


def tick(puppet: Puppet, robot: MavlinkRobot, times: int = 1) -> list[str]:
    """Tick as a supervisor does; return what the vehicle did instead of what it was told, a text for each tick."""
    disobeyed = []
    for _ in range(times):
        puppet.live(0.025)
        puppet.live(0.025)
        robot.read_state()
        try:
            robot.renew_lease()
        except Uncontrolled as failure:
            disobeyed.append(str(failure))
    return disobeyed


# --- getting ready -------------------------------------------------------------------------------------------


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
    with pytest.raises(
        RobotUnavailable, match=r"LOCAL_POSITION_NED 50 times a second \(DENIED\); set a lower stream_hz"
    ):
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
    other.speed_m_s = 0.03
    robot = ready(other, promise={"speed_noise_m_s": 0.05})
    assert robot.declared.moving_m_s == pytest.approx(0.07)
    began_s = other.time()
    robot.close(5.0)
    assert other.time() - began_s < 1.0


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"ATC_DECEL_MAX": 0.5, "ATC_ACCEL_MAX": 2.0}, "its ATC_DECEL_MAX is 0.5, and promise.brake_m_s2 is 1;"),
        ({"ATC_DECEL_MAX": 0.0, "ATC_ACCEL_MAX": 0.9}, "its ATC_ACCEL_MAX is 0.9"),
        ({"ATC_DECEL_MAX": 1.0}, ""),
        ({"ATC_DECEL_MAX": 0.0, "ATC_ACCEL_MAX": 0.0}, ""),
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


@pytest.mark.parametrize(("name", "value"), [("SERVO1_FUNCTION", 26.0), ("WP_PIVOT_ANGLE", 0.0)])
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


def test_a_vehicle_that_is_not_there_is_missed_in_time_and_others_are_named(puppet: Puppet) -> None:
    puppet.silent = True
    puppet.strangers.update({7, 3})
    began_s = puppet.time()
    with pytest.raises(RobotUnavailable, match=r"lacks a heartbeat; heard are the systems \[3, 7\]"):
        robot_of(puppet).init(2.0)
    assert puppet.time() - began_s < 2.5


def test_what_was_refused_once_is_not_taken_for_ready_the_next_time(puppet: Puppet) -> None:
    robot = ready(puppet)
    reboot(puppet)
    puppet.most_hz = 10.0
    assert "does not send LOCAL_POSITION_NED" in tick(puppet, robot, 50)[-1]
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


def test_px4_is_sent_targets_before_it_is_asked_to_take_them_and_from_then_on(puppet: Puppet) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_PX4), False
    robot_of(puppet).init(20.0)
    names = [name for _, name, fields in puppet.sent if name != "TIMESYNC"]
    modes = [fields for fields in puppet.commands(mav.MAV_CMD_DO_SET_MODE) if fields["param2"] == 6.0]
    first = next(number for number, (_, _, fields) in enumerate(puppet.sent) if fields == modes[0])
    assert "SET_POSITION_TARGET_LOCAL_NED" in [name for _, name, _ in puppet.sent[first : first + 40]]
    assert names.count("SET_POSITION_TARGET_LOCAL_NED") >= 2


def test_without_a_gate_it_promises_less(puppet: Puppet) -> None:
    puppet.gate, puppet.percent = False, -1
    robot = ready(puppet)
    found = robot.capabilities
    assert (found.reports_controller, found.reverses, found.reports_battery) == (False, False, False)
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


# --- authority -----------------------------------------------------------------------------------------------


def test_targets_come_from_the_component_in_charge(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.goto(FAR, SC)
    robot.switch_ac_sc(AC, "test")
    assert puppet.master == SENDERS[AC]
    robot.goto(FAR, AC)
    senders = [component for component, fields in puppet.targets() if fields["type_mask"] != STANDS]
    assert senders == [SENDERS[SC], SENDERS[AC]]
    assert all(component == KEEPER for component, name, _ in puppet.sent if name == "COMMAND_INT")


def test_after_a_switch_the_old_target_is_never_sent_again(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.switch_ac_sc(AC, "test")
    goal = robot.goto(FAR, AC)
    robot.switch_ac_sc(SC, "test")
    puppet.sent.clear()
    tick(puppet, robot, 5)
    assert goal.status is GoalStatus.PREEMPTED
    assert {(component, fields["type_mask"]) for component, fields in puppet.targets()} == {(SENDERS[SC], STANDS)}


def test_frames_are_those_of_the_autopilot(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.goto(Waypoint(3.0, 2.0, heading_rad=0.0, speed_m_s=0.1), SC)
    fields = puppet.targets()[-1][1]
    assert (fields["x"], fields["y"], fields["z"]) == (2.0, 3.0, 0.0)
    assert fields["yaw"] == pytest.approx(1.5708, abs=1e-4)
    assert (fields["vx"] ** 2 + fields["vy"] ** 2) ** 0.5 == pytest.approx(0.1)
    assert fields["type_mask"] == 0x0DF8 & ~0x0400 & ~0x0038


def test_numbers_of_any_kind_become_those_of_a_message(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.goto(Waypoint(np.float32(3.0), Fraction(1, 2), speed_m_s=np.float64(0.1)), SC)  # type: ignore[arg-type]
    fields = puppet.targets()[-1][1]
    assert (fields["x"], fields["y"]) == (0.5, 3.0)
    assert all(type(fields[name]) is float for name in ("x", "y", "vx", "vy"))


def test_a_place_in_the_air_is_refused_by_what_stays_on_the_ground(puppet: Puppet) -> None:
    robot = ready(puppet)
    with pytest.raises(Unsupported, match="stays on the ground"):
        robot.goto(Waypoint(1.0, 1.0, z_m=1.0), SC)
    assert all(fields["type_mask"] == STANDS for _, fields in puppet.targets())


def test_a_switch_is_never_older_than_what_was_sent_before(puppet: Puppet) -> None:
    """A clock that is learned better may put a moment earlier; the vehicle would take the switch for overtaken."""
    robot = ready(puppet)
    tick(puppet, robot, 3)
    for turn in range(6):
        puppet.clock_s -= 0.004
        puppet.live(0.001)
        robot.switch_ac_sc((AC, SC)[turn % 2], "test")
    stamps = [fields["x"] for fields in puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)]
    assert stamps == sorted(stamps)


# --- the dead man --------------------------------------------------------------------------------------------


def test_only_a_renewal_renews(puppet: Puppet) -> None:
    robot = ready(puppet)
    tick(puppet, robot)
    renewed = puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)[-1]["x"]
    puppet.sent.clear()
    for _ in range(10):
        puppet.live(0.05)
        robot.read_state()
        robot.goto(FAR, SC)
    # A switch that changes something is followed by a renewal of its own; gotos and reading are followed by nothing.
    assert not puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)
    assert "HEARTBEAT" not in [name for _, name, _ in puppet.sent]
    tick(puppet, robot)
    assert puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)[-1]["x"] > renewed + 400


def test_without_a_lease_of_its_own_the_vehicle_is_never_sent_further_than_ours_covers(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    robot.goto(FAR, SC)
    promised = robot.declared
    full_m = promised.v_max_m_s * promised.lease_s + promised.v_max_m_s**2 / (2.0 * promised.brake_m_s2)
    assert puppet.targets()[-1][1]["y"] == pytest.approx(full_m)
    for _ in range(4):
        puppet.live(0.05)
        robot.goto(FAR, SC)
    last = puppet.targets()[-1][1]
    # The lease is over: the vehicle is told to stand, however many gotos come.
    assert last["type_mask"] == STANDS
    tick(puppet, robot)
    assert puppet.targets()[-1][1]["y"] == pytest.approx(full_m)


def test_on_a_link_on_which_samples_wait_a_vehicle_without_a_lease_is_not_driven_on(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    robot.goto(FAR, SC)
    assert puppet.targets()[-1][1]["type_mask"] != STANDS
    puppet.silent = True
    tick(puppet, robot, 4)
    assert puppet.targets()[-1][1]["type_mask"] != STANDS
    tick(puppet, robot, 4)
    assert puppet.targets()[-1][1]["type_mask"] == STANDS


def test_without_a_gate_a_speed_cap_is_asked_for_once(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    robot.goto(FAR._replace(speed_m_s=0.1), SC)
    tick(puppet, robot, 4)
    caps = [fields["param2"] for fields in puppet.commands(mav.MAV_CMD_DO_CHANGE_SPEED)]
    assert caps[0] == 0.1
    assert set(caps) == {0.1}
    assert len(caps) <= 2


def test_what_it_lacks_it_refuses_without_a_gate(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    with pytest.raises(Unsupported, match="takes no heading"):
        robot.goto(FAR._replace(heading_rad=1.0), SC)


# --- reboots, silence, pilots --------------------------------------------------------------------------------


def reboot(puppet: Puppet) -> None:
    puppet.clock_s = 0.5
    puppet.mode, puppet.armed, puppet.master, puppet.streams = 0, False, 0, {}


def test_after_a_reboot_it_is_made_ready_again_without_being_opened_anew(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.goto(FAR, SC)
    tick(puppet, robot, 2)
    reboot(puppet)
    tick(puppet, robot, 120)
    assert (puppet.mode, puppet.armed, puppet.master) == (ROVER_GUIDED, True, SENDERS[SC])
    state = robot.read_state()
    assert state.age_s(robot.clock.now()) < 0.1
    assert state.vehicle_stamp_s < 10.0
    assert puppet.targets()[-1][1]["type_mask"] != STANDS


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
        reboot(puppet)
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
    ("what", "said"),
    [
        ({"ekf": 167}, "its EKF does not know"),
        ({"ekf": 831 | mav.EKF_GPS_GLITCHING}, "GPS jump"),
        ({"variance": 0.9}, "pos_horiz_variance is 0.90"),
        ({"variance": float("nan")}, "pos_horiz_variance is nan"),
        ({"fix": mav.GPS_FIX_TYPE_NO_FIX}, "fix type 1"),
        ({"finds": False}, "no place for 1.0 s"),
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
    tick(puppet, robot, 2)
    assert robot.read_state().link is Link.UP


def test_an_ekf_that_begins_anew_elsewhere_is_heard_again_once_its_origin_is_known(puppet: Puppet) -> None:
    puppet.gate = False
    origin = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0}
    robot = ready(puppet, origin=origin)
    puppet.origin_lat = 473977420 + 1000
    puppet.tell_origin()
    assert "made ready again" in tick(puppet, robot)[0]
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


# --- the end -------------------------------------------------------------------------------------------------


def test_closing_stops_it_and_gives_it_back(puppet: Puppet) -> None:
    robot = ready(puppet)
    robot.goto(FAR, SC)
    robot.close(2.0)
    assert puppet.mode == ROVER_HOLD
    assert puppet.commands(mav.MAV_CMD_DO_GUIDED_MASTER)[-1]["param2"] == 0.0
    assert not puppet.armed


def test_closing_leaves_a_vehicle_armed_that_was_so_before(puppet: Puppet) -> None:
    puppet.armed = True
    ready(puppet).close(2.0)
    assert (puppet.mode, puppet.armed) == (ROVER_HOLD, True)


def test_closing_leaves_a_vehicle_to_its_pilot(puppet: Puppet) -> None:
    robot = ready(puppet)
    puppet.mode = 0
    puppet.live()
    puppet.sent.clear()
    robot.close(2.0)
    assert (puppet.mode, puppet.armed, puppet.sent) == (0, True, [])


def test_one_that_was_not_armed_yet_is_closed_at_once(puppet: Puppet) -> None:
    puppet.refuses_to_arm = "PreArm: not yet"
    robot = robot_of(puppet)
    with pytest.raises(RobotUnavailable):
        robot.init(10.0)
    began_s = puppet.time()
    robot.close(5.0)
    assert puppet.time() == began_s
    assert not puppet.armed


def test_closing_waits_no_longer_than_it_may_for_one_that_is_gone(puppet: Puppet) -> None:
    robot = ready(puppet)
    puppet.silent = True
    puppet.live(0.1)
    began_s = puppet.time()
    robot.close(3.0)
    assert puppet.time() - began_s <= 3.2


def test_one_that_was_never_ready_can_be_closed(puppet: Puppet) -> None:
    robot_of(puppet).close(1.0)
    assert not puppet.sent


def test_a_number_that_is_none_is_never_sent(puppet: Puppet) -> None:
    with pytest.raises(ValueError, match=r"SET_POSITION_TARGET_LOCAL_NED\.x is nan"):
        puppet.send(1, SENDERS[SC], "SET_POSITION_TARGET_LOCAL_NED", {"x": float("nan")})
