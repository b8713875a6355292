"""What a vehicle says and refuses until it is ready, and what it does when it is booted again."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.sim.mavlink.client import ACCEPTED, FAILED, Rig

READY, NOT_READY = 831, 167


def test_it_is_silent_then_heard_then_knows_where_it_is_then_is_ready() -> None:
    with Rig(boot_s=42.0) as rig:
        client = rig.client
        rig.run(1.5)
        assert client.heard == []
        assert rig.arm() is None
        rig.run(2.0)
        heartbeat = client.take("HEARTBEAT")[-1]
        assert (heartbeat.type, heartbeat.autopilot) == (mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
        assert heartbeat.system_status == mav.MAV_STATE_CALIBRATING
        assert heartbeat.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        assert not heartbeat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED
        assert client.take("EKF_STATUS_REPORT")[-1].flags == NOT_READY
        assert client.take("LOCAL_POSITION_NED") == []
        assert client.take("GPS_RAW_INT")[-1].fix_type == mav.GPS_FIX_TYPE_NO_FIX
        rig.run(10.0)
        assert client.take("GPS_RAW_INT")[-1].fix_type == mav.GPS_FIX_TYPE_RTK_FIXED
        # A position, but one that must not be trusted yet.
        assert abs(client.take("LOCAL_POSITION_NED")[-1].z) == pytest.approx(584.0)
        rig.run(30.0)
        assert client.take("EKF_STATUS_REPORT")[-1].flags == READY
        assert client.take("HEARTBEAT")[-1].system_status == mav.MAV_STATE_STANDBY
        at = client.take("LOCAL_POSITION_NED")[-1]
        assert (at.x, at.y, at.z) == pytest.approx((5.0, 5.0, 0.0))


@pytest.mark.parametrize(("vehicle", "guided"), [("rover", 15), ("copter", 4)])
def test_arming_and_guided_are_refused_with_a_reason_until_it_is_ready(vehicle: str, guided: int) -> None:
    with Rig(boot_s=4.0, vehicle=vehicle) as rig:
        rig.run(2.0)
        rig.client.texts()
        assert rig.mode(guided) == FAILED
        assert any("requires position" in text for text in rig.client.texts())
        assert rig.arm() == FAILED
        assert any(text.startswith("Arm: ") for text in rig.client.texts())
        rig.run(3.0)
        assert rig.mode(guided) == ACCEPTED
        assert rig.arm() == ACCEPTED
        rig.run(1.0)
        heartbeat = rig.client.take("HEARTBEAT")[-1]
        assert heartbeat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED
        assert heartbeat.custom_mode == guided
        assert heartbeat.system_status == mav.MAV_STATE_ACTIVE


def test_a_reboot_starts_the_clock_anew_and_forgets_what_was_asked_for() -> None:
    with Rig(boot_s=1.0) as rig:
        rig.run(5.0)
        rig.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_ATTITUDE, 50_000)
        rig.client.send(mav.MAVLink_param_set_message(1, 1, b"WP_RADIUS", 0.5, mav.MAV_PARAM_TYPE_REAL32))
        assert rig.master(255, 191) == ACCEPTED
        rig.guided()
        assert rig.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == FAILED
        assert "Reboot: armed" in rig.client.texts()
        assert rig.disarm() == ACCEPTED
        assert rig.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 2) == mav.MAV_RESULT_UNSUPPORTED
        before_ms = rig.autopilot.boot_ms
        assert rig.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
        rig.client.heard.clear()
        rig.run(0.5)
        assert rig.arm() == FAILED
        rig.run(2.0)
        stamps = [each.time_boot_ms for each in rig.client.take("ATTITUDE")]
        assert 0 < max(stamps) < before_ms
        assert len(stamps) <= 3
        assert rig.autopilot.guided.keeper is None
        assert rig.autopilot.parameters["WP_RADIUS"] == 0.5
        assert rig.client.take("HEARTBEAT")[-1].custom_mode == 0


def test_a_reboot_that_is_forced_happens_although_it_is_armed() -> None:
    with Rig(boot_s=1.0) as rig:
        rig.run(5.0)
        rig.guided()
        before_ms = rig.autopilot.boot_ms
        assert rig.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1, 0, 0, 0, 0, 20190226) == ACCEPTED
        rig.run(0.5)
        assert rig.autopilot.boot_ms < before_ms
        assert not rig.autopilot.armed


def test_it_says_what_it_is() -> None:
    with Rig() as rig:
        for number in (mav.MAV_CMD_REQUEST_MESSAGE, mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES):
            assert rig.command(number, mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == ACCEPTED
            version = rig.client.take("AUTOPILOT_VERSION")[-1]
            assert version.capabilities & mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            assert version.capabilities & mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            assert version.flight_sw_version >> 24 == 4
