"""Commanding a vehicle of strings that has no gate: near places, headings, speeds. No wire, no waiting."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.robot import MavlinkRobot
from soter.errors import Unsupported
from soter.sdk import Controller, Waypoint
from tests.adapters.mavlink.puppet import FAR, STANDS, Puppet, ready, tick

AC, SC = Controller.AC, Controller.SC
TURNS = 0x09FF
STANDS_THERE = 0x05F8
GOES = 0x09F8
GOES_ANYHOW = 0x0DF8


def test_without_a_lease_of_its_own_the_vehicle_is_never_sent_further_than_ours_covers(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    robot.goto(FAR, SC)
    promised = robot.declared
    lease_s = promised.lease_s - promised.jitter_s - 0.5 * promised.setpoint_period_s
    full_m = promised.v_max_m_s * lease_s + promised.v_max_m_s**2 / (2.0 * promised.brake_m_s2)
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
    # It swings beyond what it is asked for.
    assert caps == pytest.approx([0.0824] * len(caps))
    assert len(caps) <= 2


def test_a_cap_that_a_rover_would_refuse_is_asked_for_as_the_least_that_it_takes(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    robot.goto(FAR._replace(speed_m_s=0.003), SC)
    tick(puppet, robot, 4)
    assert puppet.commands(mav.MAV_CMD_DO_CHANGE_SPEED)[-1]["param2"] == 0.05


def test_a_slow_limit_is_asked_for_by_no_less_than_slow_vehicles_swing_beyond_it(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet, promise={"v_max_m_s": 1.0})
    robot.goto(FAR._replace(speed_m_s=0.25), SC)
    tick(puppet, robot, 4)
    assert puppet.commands(mav.MAV_CMD_DO_CHANGE_SPEED)[-1]["param2"] == pytest.approx(0.2)


@pytest.mark.parametrize(("moves_m_s", "counts_m_s"), [(0.0, 0.25), (0.6, 0.6), (1.2, 1.0)])
def test_a_slow_vehicle_is_sent_no_farther_than_it_drives_in_the_time_of_a_fast_one(
    puppet: Puppet, moves_m_s: float, counts_m_s: float
) -> None:
    puppet.gate = False
    robot = ready(puppet, promise={"v_max_m_s": 1.0})
    puppet.speed_m_s = moves_m_s
    tick(puppet, robot)
    robot.goto(FAR._replace(speed_m_s=0.25), SC)
    promised = robot.declared
    lease_s = promised.lease_s - promised.jitter_s - 0.5 * promised.setpoint_period_s
    covered_m = counts_m_s * (lease_s + 1.0 / (2.0 * promised.brake_m_s2))
    assert puppet.targets()[-1][1]["y"] == pytest.approx(covered_m)


@pytest.mark.parametrize("v_max_m_s", [0.22, 0.05])
def test_however_slow_it_is_sent_so_far_that_it_sets_out_and_no_farther_than_a_fast_one(
    puppet: Puppet, v_max_m_s: float
) -> None:
    puppet.gate = False
    robot = ready(puppet, promise={"v_max_m_s": v_max_m_s})
    tick(puppet, robot)
    robot.goto(FAR._replace(speed_m_s=0.003), SC)
    promised = robot.declared
    lease_s = promised.lease_s - promised.jitter_s - 0.5 * promised.setpoint_period_s
    covered_m = v_max_m_s * lease_s + v_max_m_s**2 / (2.0 * promised.brake_m_s2)
    assert puppet.targets()[-1][1]["y"] == pytest.approx(min(0.015, covered_m))


@pytest.mark.parametrize(
    ("gain_per_s", "slows_s"), [(None, None), (4.0, 0.1875), (2.0, 0.375), (0.0, None), (math.nan, None)]
)
@pytest.mark.parametrize("yaw_rad", [-1.0, 3.0])
def test_a_rover_is_turned_by_headings_no_farther_off_than_it_turns_as_fast_as_promised_and_then_sent_to_the_place(
    puppet: Puppet, yaw_rad: float, gain_per_s: float | None, slows_s: float | None
) -> None:
    """Sent to a place it would end its turn and drive there, seconds after the lease."""
    puppet.gate = False
    if gain_per_s is not None:
        puppet.parameters["ATC_STR_ANG_P"] = gain_per_s
    robot = ready(puppet)
    puppet.yaw_rad = yaw_rad
    tick(puppet, robot)
    puppet.sent.clear()
    robot.goto(FAR, SC)
    most_rad = robot.declared.yaw_rate_max_rad_s * (slows_s or robot.declared.lease_s)
    first_rad = abs(puppet.targets()[-1][1]["yaw"] - yaw_rad)
    assert first_rad == pytest.approx(min(most_rad, abs(0.5 * math.pi - yaw_rad)), abs=1e-3)
    for _ in range(20):
        fields = puppet.targets()[-1][1]
        if fields["type_mask"] != TURNS:
            break
        step_rad = fields["yaw"] - puppet.yaw_rad
        assert 0.0 < abs(step_rad) <= most_rad + 1e-9
        puppet.yaw_rad += 0.5 * step_rad
        tick(puppet, robot)
    assert puppet.yaw_rad == pytest.approx(0.5 * math.pi, abs=0.1)
    assert puppet.targets()[-1][1]["type_mask"] == GOES_ANYHOW
    # A little off its course it drives on.
    puppet.yaw_rad -= 0.15
    tick(puppet, robot)
    assert puppet.targets()[-1][1]["type_mask"] == GOES_ANYHOW


def test_a_slow_rover_beside_its_leg_is_sent_towards_where_it_is_turned_to(puppet: Puppet) -> None:
    """Sent to a place on the leg, as near as it is beside the leg, it would be turned to and fro and not set out."""
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    robot.goto(FAR._replace(speed_m_s=0.003), SC)
    puppet.y_m += 0.012
    puppet.yaw_rad += 0.15
    tick(puppet, robot, 3)
    fields = puppet.targets()[-1][1]
    assert fields["type_mask"] == GOES_ANYHOW
    dx_m, dy_m = fields["y"] - puppet.x_m, fields["x"] - puppet.y_m
    assert math.hypot(dx_m, dy_m) == pytest.approx(0.015)
    assert -0.25 < math.atan2(dy_m, dx_m) < 0.0


def test_a_rover_that_drives_backwards_is_turned_with_its_back_to_the_place(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    puppet.sent.clear()
    robot.goto(FAR._replace(heading_rad=math.pi, y_m=0.0), SC)
    assert puppet.targets()[-1][1]["type_mask"] == TURNS
    puppet.yaw_rad = -0.5 * math.pi
    tick(puppet, robot)
    assert puppet.targets()[-1][1]["type_mask"] == GOES


def test_what_it_lacks_it_refuses_without_a_gate(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    puppet.sent.clear()
    for refused in (FAR._replace(heading_rad=1.0), Waypoint(1.0, 1.0, heading_rad=0.0)):
        with pytest.raises(Unsupported, match="no heading but that of its way"):
            robot.goto(refused, SC)
    assert not puppet.sent


def test_a_rover_without_a_gate_is_told_which_way_to_drive_until_it_has_answered(puppet: Puppet) -> None:
    puppet.gate = False
    robot = ready(puppet)
    tick(puppet, robot)
    puppet.sent.clear()
    for heading_rad in (math.pi, 0.0, None):
        robot.goto(Waypoint(3.0, 1.0, heading_rad=heading_rad), SC)
        tick(puppet, robot, 4)
    told = [fields["param1"] for fields in puppet.commands(mav.MAV_CMD_DO_SET_REVERSE)]
    assert list(dict.fromkeys(told)) == [1.0, 0.0]
    assert len(told) <= 4
    # Before the target that is meant by it.
    sent = [name for _, name, _ in puppet.sent if name in ("COMMAND_LONG", "SET_POSITION_TARGET_LOCAL_NED")]
    assert sent[0] == "COMMAND_LONG"
    # A vehicle that was made ready again may have forgotten it.
    robot.goto(Waypoint(3.0, 1.0, heading_rad=math.pi), SC)
    tick(puppet, robot, 4)
    puppet.reboot()
    puppet.sent.clear()
    tick(puppet, robot, 120)
    assert puppet.commands(mav.MAV_CMD_DO_SET_REVERSE)[0]["param1"] == 1.0


# --- copters ---------------------------------------------------------------------------------------------------


def flying(puppet: Puppet, **options: object) -> MavlinkRobot:
    """Return an ArduCopter in the air, at 0.2 m/s to the north."""
    puppet.kind, puppet.gate = (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA), False
    robot = ready(puppet, vehicle="copter", height_m=2.0, **options)
    puppet.speed_m_s = 0.2
    tick(puppet, robot)
    return robot


def masks(puppet: Puppet) -> list[int]:
    return [fields["type_mask"] for _, fields in puppet.targets()]


def test_an_arducopter_is_stopped_by_a_place_since_it_would_speed_up_after_a_velocity(puppet: Puppet) -> None:
    robot = flying(puppet)
    puppet.sent.clear()
    for controller in (AC, SC, AC):
        robot.goto(FAR, robot.in_charge)
        tick(puppet, robot, 4)
        robot.switch_ac_sc(controller, "test")
        tick(puppet, robot, 4)
    assert set(masks(puppet)) == {GOES, STANDS_THERE}
    robot.goto(FAR, AC)
    puppet.y_m += 1.0
    tick(puppet, robot)
    puppet.sent.clear()
    robot.switch_ac_sc(SC, "test")
    tick(puppet, robot, 10)
    places = {(fields["x"], fields["y"], fields["z"], fields["yaw_rate"]) for _, fields in puppet.targets()}
    # Once, and not anew from where it has got to since.
    ((north_m, east_m, down_m, yaw_rate_rad_s),) = places
    braking_m = 0.2**2 / (2.0 * robot.declared.brake_m_s2)
    assert 1.0 + braking_m <= north_m <= 1.0 + braking_m + 0.2 * robot.declared.sample_age_s
    assert (east_m, down_m, yaw_rate_rad_s) == (0.0, -2.0, 0.0)


def test_an_arducopter_whose_samples_are_late_is_left_with_the_place_that_it_was_sent_to_last(puppet: Puppet) -> None:
    robot = flying(puppet)
    robot.goto(FAR, SC)
    tick(puppet, robot, 4)
    _, last = puppet.targets()[-1]
    puppet.silent = True
    while masks(puppet)[-1] != STANDS_THERE:
        tick(puppet, robot)
    puppet.sent.clear()
    # It may be switched meanwhile.
    robot.switch_ac_sc(AC, "test")
    tick(puppet, robot, 4)
    assert {(fields["x"], fields["y"]) for _, fields in puppet.targets()} == {(last["x"], last["y"])}
    robot.goto(FAR, AC)
    puppet.silent = False
    tick(puppet, robot)
    puppet.sent.clear()
    tick(puppet, robot, 40)
    assert masks(puppet) == [GOES] * 40


def test_an_arducopter_that_others_had_gets_no_place_while_it_brakes(puppet: Puppet) -> None:
    robot = flying(puppet, promise={"v_max_m_s": 1.0, "brake_m_s2": 1.0})
    robot.goto(FAR, SC)
    puppet.mode = 5
    tick(puppet, robot, 60)
    puppet.mode = 4
    puppet.sent.clear()
    tick(puppet, robot, 40)
    # However long they had it: they may have driven it until now.
    stood = masks(puppet).count(STANDS)
    assert stood in (19, 20, 21)
    assert masks(puppet) == [STANDS] * stood + [GOES] * (40 - stood)


def test_an_arducopter_is_sent_its_speed_limit_after_the_place_and_again_after_a_velocity(puppet: Puppet) -> None:
    robot = flying(puppet)
    robot.goto(FAR, SC)
    for _ in range(2):
        tick(puppet, robot, 60)
        names = [name for _, name, _ in puppet.sent if name in ("COMMAND_LONG", "SET_POSITION_TARGET_LOCAL_NED")]
        limits = puppet.commands(mav.MAV_CMD_DO_CHANGE_SPEED)
        assert 1 <= len(limits) <= 2
        assert limits[-1]["param2"] == pytest.approx(0.92 * robot.declared.v_max_m_s)
        assert names[names.index("COMMAND_LONG") - 1] == "SET_POSITION_TARGET_LOCAL_NED"
        # Another may have driven it since, and then it is stopped by a velocity.
        puppet.mode = 5
        tick(puppet, robot, 4)
        puppet.mode = 4
        puppet.sent.clear()


def test_an_arducopter_that_others_had_does_not_go_back_to_where_it_stood(puppet: Puppet) -> None:
    robot = flying(puppet)
    robot.switch_ac_sc(AC, "test")
    tick(puppet, robot, 4)
    puppet.mode = 5
    tick(puppet, robot, 4)
    puppet.mode, puppet.y_m, puppet.speed_m_s = 4, 3.0, 0.0
    tick(puppet, robot, 40)
    puppet.sent.clear()
    tick(puppet, robot, 4)
    assert masks(puppet) == [STANDS_THERE] * 4
    assert puppet.targets()[-1][1]["x"] == pytest.approx(3.0)
