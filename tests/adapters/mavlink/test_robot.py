"""Commanding a vehicle of strings: authority, the dead man, the end. No wire, no waiting."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER, SENDERS
from soter.errors import RobotUnavailable, Unsupported
from soter.sdk import Controller, GoalStatus, Waypoint
from tests.adapters.mavlink.puppet import FAR, ROVER_HOLD, STANDS, Puppet, ready, robot_of, tick

AC, SC = Controller.AC, Controller.SC


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
