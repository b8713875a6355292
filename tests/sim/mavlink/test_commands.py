"""Modes, arming, and how commands are answered."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.sdk.values import RobotSpec
from tests.sim.mavlink.client import ACCEPTED, CUSTOM, DENIED, FAILED, UNSUPPORTED, Rig

ROVER_MODES = {"MANUAL": 0, "HOLD": 4, "RTL": 11, "GUIDED": 15}
COPTER_MODES = {"STABILIZE": 0, "GUIDED": 4, "LOITER": 5, "RTL": 6, "LAND": 9, "BRAKE": 17}


@pytest.mark.parametrize(("vehicle", "modes"), [("rover", ROVER_MODES), ("copter", COPTER_MODES)])
def test_modes_have_the_numbers_of_their_vehicle(vehicle: str, modes: dict[str, int]) -> None:
    with Rig(vehicle=vehicle) as rig:
        for name, number in modes.items():
            assert rig.mode(number) == ACCEPTED
            assert rig.autopilot.mode.value == name
            # The heartbeat that shows the change follows at once, after the acknowledgement.
            assert rig.client.take("HEARTBEAT")[-1].custom_mode == number


def test_the_older_message_sets_modes_too() -> None:
    with Rig() as rig:
        rig.client.send(mav.MAVLink_set_mode_message(1, CUSTOM, 4))
        rig.run(0.1)
        ack = rig.client.take("COMMAND_ACK")[-1]
        assert (ack.command, ack.result) == (mav.MAVLINK_MSG_ID_SET_MODE, ACCEPTED)
        assert rig.autopilot.mode.value == "HOLD"
        rig.client.send(mav.MAVLink_set_mode_message(1, 0, 4))
        rig.run(0.1)
        assert rig.client.take("COMMAND_ACK")[-1].result == DENIED


def test_modes_that_cannot_be_are_refused() -> None:
    with Rig() as rig:
        for number in (1, 17, 99):
            assert rig.mode(number) == FAILED
            assert f"No such mode {number}" in rig.client.texts()
        assert rig.mode(10) == FAILED
        assert "Mode change to AUTO failed: no mission" in rig.client.texts()
        for base, custom in ((0, 15), (math.nan, 15), (CUSTOM, math.nan), (CUSTOM, 3.5)):
            assert rig.command(mav.MAV_CMD_DO_SET_MODE, base, custom) == DENIED
        assert rig.command(mav.MAV_CMD_NAV_LAND) == UNSUPPORTED
        assert rig.autopilot.mode.value == "MANUAL"


def test_rtl_by_command() -> None:
    with Rig() as rig:
        assert rig.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
        assert rig.autopilot.mode.value == "RTL"


def test_arming_makes_home_and_disarming_stops() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(9.0, 5.0)
        rig.run(3.0)
        assert rig.speed() > 0.2
        assert rig.disarm() == ACCEPTED
        rig.run(1.0)
        assert rig.speed() == 0.0
        stopped = rig.at()
        assert rig.arm() == ACCEPTED
        rig.run(1.0)
        # The old target is forgotten.
        assert rig.at() == stopped
        assert rig.autopilot.home is not None
        assert rig.autopilot.home[:2] == pytest.approx(stopped)
        assert rig.arm() == ACCEPTED
        assert rig.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 2) == UNSUPPORTED
        assert rig.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, math.nan) == UNSUPPORTED


def test_it_does_not_arm_in_rtl_nor_with_an_empty_battery() -> None:
    with Rig() as rig:
        rig.mode(ROVER_MODES["RTL"])
        assert rig.arm() == FAILED
        assert "Arm: RTL mode not armable" in rig.client.texts()
    with Rig(robots=[RobotSpec(1, 5.0, 5.0, 0.0, battery=0.0)]) as rig:
        assert rig.arm() == FAILED
        assert "Arm: Battery 1 is empty" in rig.client.texts()


def test_who_is_not_meant_is_silent_and_a_broadcast_is_for_all() -> None:
    with Rig(count=2) as rig:
        hold = mav.MAVLink_command_long_message
        rig.client.send(hold(77, 1, mav.MAV_CMD_DO_SET_MODE, 0, CUSTOM, 4, 0, 0, 0, 0, 0))
        rig.run(0.2)
        assert rig.client.take("COMMAND_ACK", 1) == rig.client.take("COMMAND_ACK", 2) == []
        assert {each.mode.value for each in rig.simulation.autopilots} == {"MANUAL"}
        rig.client.send(hold(2, 99, mav.MAV_CMD_DO_SET_MODE, 0, CUSTOM, 4, 0, 0, 0, 0, 0))
        rig.run(0.2)
        # A wrong component is not looked at.
        assert [each.mode.value for each in rig.simulation.autopilots] == ["MANUAL", "HOLD"]
        assert (len(rig.client.take("COMMAND_ACK", 1)), len(rig.client.take("COMMAND_ACK", 2))) == (0, 1)
        rig.client.send(hold(0, 0, mav.MAV_CMD_DO_SET_MODE, 0, CUSTOM, 15, 0, 0, 0, 0, 0))
        rig.run(0.2)
        assert {each.mode.value for each in rig.simulation.autopilots} == {"GUIDED"}
        assert len(rig.client.take("COMMAND_ACK", 1)) == len(rig.client.take("COMMAND_ACK", 2)) == 1


def test_an_unknown_command_is_unsupported_in_both_forms() -> None:
    with Rig() as rig:
        assert rig.command(mav.MAV_CMD_DO_PARACHUTE) == UNSUPPORTED
        assert rig.command_int(mav.MAV_CMD_DO_PARACHUTE) == UNSUPPORTED


def test_speed_is_changed_for_the_leg_under_way_too() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(15.0, 5.0)
        rig.run(3.0)
        assert rig.speed() == pytest.approx(0.22)
        assert rig.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 0.1) == ACCEPTED
        rig.run(2.0)
        assert rig.speed() == pytest.approx(0.1)
        # No change, and the usual speed.
        assert rig.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, -1) == ACCEPTED
        rig.run(1.0)
        assert rig.speed() == pytest.approx(0.1)
        assert rig.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, -2) == ACCEPTED
        rig.run(1.0)
        assert rig.speed() == pytest.approx(0.22)
        # What no motor can do is not done.
        assert rig.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 5.0) == ACCEPTED
        rig.run(1.0)
        assert rig.speed() == pytest.approx(0.22)
        for bad in (math.nan, math.inf, 0.0):
            assert rig.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, bad) == DENIED
        # As ArduRover: too slow for it, and nothing changes.
        assert rig.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 0.04) == FAILED
        rig.run(1.0)
        assert rig.speed() == pytest.approx(0.22)


def test_a_rover_backs_to_places_until_its_mode_changes() -> None:
    with Rig() as rig:
        rig.guided()
        assert rig.command(mav.MAV_CMD_DO_SET_REVERSE, 1) == ACCEPTED
        rig.target(4.0, 5.0)
        rig.run(6.0)
        assert rig.at() == pytest.approx((4.0, 5.0), abs=0.02)
        assert rig.simulation.world.truth.pose(1)[2] == pytest.approx(0.0, abs=0.02)
        rig.autopilot.set_mode(rig.autopilot.kind.stop, "test")
        rig.guided()
        rig.target(3.0, 5.0)
        rig.run(8.0)
        assert rig.at() == pytest.approx((3.0, 5.0), abs=0.02)
        assert abs(rig.simulation.world.truth.pose(1)[2]) == pytest.approx(math.pi, abs=0.05)


def test_a_copter_has_no_back() -> None:
    with Rig(vehicle="copter") as rig:
        assert rig.command(mav.MAV_CMD_DO_SET_REVERSE, 1) == UNSUPPORTED


def test_a_long_text_comes_in_numbered_parts() -> None:
    with Rig() as rig:
        rig.client.take("STATUSTEXT")
        rig.autopilot.say(mav.MAV_SEVERITY_INFO, "x" * 50 + "y" * 20)
        rig.client.pump()
        parts = rig.client.take("STATUSTEXT")
        assert [(part.text, part.chunk_seq) for part in parts] == [("x" * 50, 0), ("y" * 20, 1)]
        assert parts[0].id == parts[1].id != 0


def test_the_same_text_does_not_flood_the_link() -> None:
    with Rig() as rig:
        rig.guided()
        rig.client.texts()
        for _ in range(100):
            rig.target(math.nan, 0.0)
            rig.run(rig.period_s)
        assert 2 <= len(rig.client.texts()) <= 4


def test_home_is_moved_to_where_the_vehicle_is_or_to_a_place() -> None:
    set_home = mav.MAV_CMD_DO_SET_HOME
    with Rig() as rig:
        rig.guided()
        assert rig.command(set_home, 0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 488.0) == UNSUPPORTED
        assert rig.command_int(set_home, x=10, y=10, z=math.nan, frame=mav.MAV_FRAME_GLOBAL) == DENIED
        assert rig.autopilot.home == pytest.approx((5.0, 5.0, 0.0))
        x, y = rig.autopilot.origin.geodetic_e7(7.0, 8.0)
        assert rig.command_int(set_home, x=x, y=y, z=489.0, frame=mav.MAV_FRAME_GLOBAL) == ACCEPTED
        assert rig.autopilot.home == pytest.approx((7.0, 8.0, 1.0), abs=0.02)
        assert rig.command_int(set_home, 1.0) == ACCEPTED
        assert rig.autopilot.home == pytest.approx((5.0, 5.0, 0.0))
