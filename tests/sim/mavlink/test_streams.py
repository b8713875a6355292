"""What a vehicle tells of itself, when, and how often."""

from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.sdk.values import RobotSpec
from soter_sim.mavlink.frames import Origin
from tests.sim.mavlink.client import ACCEPTED, DENIED, FAILED, Rig

INTERVAL = mav.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST = mav.MAV_CMD_REQUEST_MESSAGE
LOCAL = mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED
ATTITUDE = mav.MAVLINK_MSG_ID_ATTITUDE


def test_a_rover_tells_much_once_a_second_and_a_copter_its_heartbeat_only() -> None:
    with Rig() as rig:
        rig.client.heard.clear()
        rig.run(5.0)
        for name in ("HEARTBEAT", "LOCAL_POSITION_NED", "ATTITUDE", "SYS_STATUS", "BATTERY_STATUS"):
            assert len(rig.client.take(name)) == 5, name
    with Rig(vehicle="copter") as rig:
        rig.run(1.0)
        rig.client.heard.clear()
        rig.run(5.0)
        assert {each.get_type() for each in rig.client.heard} == {"HEARTBEAT"}
        assert len(rig.client.take("HEARTBEAT")) == 5


@pytest.mark.parametrize(("rate_hz", "most_hz"), [(40.0, 40.0), (100.0, 100.0)])
def test_a_message_comes_as_often_as_was_asked_for_and_more_is_denied(rate_hz: float, most_hz: float) -> None:
    with Rig(rate_hz=rate_hz) as rig:
        assert rig.command(INTERVAL, LOCAL, 1e6 / most_hz) == ACCEPTED
        assert rig.command(INTERVAL, ATTITUDE, 1e6 / most_hz) == ACCEPTED
        rig.client.heard.clear()
        rig.run(2.0)
        places, attitudes = rig.client.take("LOCAL_POSITION_NED"), rig.client.take("ATTITUDE")
        assert len(places) == 2 * most_hz
        # Both of one moment, with the stamp of that moment.
        assert [each.time_boot_ms for each in places] == [each.time_boot_ms for each in attitudes]
        steps = {b.time_boot_ms - a.time_boot_ms for a, b in itertools.pairwise(places)}
        assert steps == {round(1000.0 / rate_hz)}
        assert rig.command(INTERVAL, LOCAL, 1e6 / most_hz - 200.0) == DENIED
        assert rig.command(INTERVAL, LOCAL, 200_000) == ACCEPTED
        rig.client.heard.clear()
        rig.run(2.0)
        assert len(rig.client.take("LOCAL_POSITION_NED")) == 10
        assert rig.command(INTERVAL, LOCAL, -1) == ACCEPTED
        rig.client.heard.clear()
        rig.run(2.0)
        assert rig.client.take("LOCAL_POSITION_NED") == []
        assert rig.command(INTERVAL, LOCAL, 0) == ACCEPTED
        rig.client.heard.clear()
        rig.run(2.0)
        assert len(rig.client.take("LOCAL_POSITION_NED")) == 2


def test_what_may_be_sent_can_be_less_than_there_are_control_periods() -> None:
    with Rig(rate_hz=100.0, streams_hz=30.0) as rig:
        assert rig.command(INTERVAL, LOCAL, 20_000) == DENIED
        assert rig.command(INTERVAL, LOCAL, 40_000) == ACCEPTED


def test_rates_belong_to_the_link() -> None:
    with Rig() as rig:
        other = rig.connect(254, 1)
        assert rig.command(INTERVAL, LOCAL, 50_000) == ACCEPTED
        rig.client.heard.clear()
        other.heard.clear()
        rig.run(2.0)
        assert len(rig.client.take("LOCAL_POSITION_NED")) == 40
        assert len(other.take("LOCAL_POSITION_NED")) == 2


def test_what_makes_no_sense_is_refused() -> None:
    with Rig() as rig:
        assert rig.command(INTERVAL, 9999, 100_000) == FAILED
        assert rig.command(INTERVAL, math.nan, 100_000) == FAILED
        assert rig.command(INTERVAL, LOCAL, math.nan) == DENIED
        assert rig.command(INTERVAL, LOCAL, -5) == DENIED
        assert rig.command(INTERVAL, LOCAL, 1e30) == DENIED
        assert rig.command(REQUEST, 9999) == FAILED
        assert rig.command(REQUEST, math.nan) == FAILED
        assert rig.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, 9999) == FAILED


def test_intervals_can_be_asked_for() -> None:
    with Rig() as rig:
        rig.command(INTERVAL, LOCAL, 100_000)
        assert rig.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, LOCAL) == ACCEPTED
        assert rig.client.take("MESSAGE_INTERVAL")[-1].interval_us == 100_000
        assert rig.command(REQUEST, mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_HOME_POSITION) == ACCEPTED
        assert rig.client.take("MESSAGE_INTERVAL")[-1].interval_us == -1


def test_groups_of_older_ground_stations_set_rates() -> None:
    with Rig(vehicle="copter") as rig:
        request = mav.MAVLink_request_data_stream_message
        rig.client.send(request(1, 1, mav.MAV_DATA_STREAM_ALL, 4, 1))
        rig.run(1.0)
        rig.client.heard.clear()
        rig.run(2.0)
        for name in ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SYS_STATUS", "VFR_HUD", "ATTITUDE"):
            assert len(rig.client.take(name)) == 8, name
        rig.client.send(request(1, 1, mav.MAV_DATA_STREAM_POSITION, 0, 0))
        rig.run(1.0)
        rig.client.heard.clear()
        rig.run(2.0)
        assert rig.client.take("LOCAL_POSITION_NED") == []
        assert len(rig.client.take("ATTITUDE")) == 8


def test_states_are_those_of_the_world_in_the_frames_of_the_wire() -> None:
    # Facing north-west, at (3, 8), a tenth of the charge gone.
    robot = RobotSpec(1, 3.0, 8.0, 0.75 * math.pi, battery=0.9)
    with Rig(robots=[robot]) as rig:
        rig.guided()
        rig.target(2.0, 9.0)
        rig.run(2.0)
        at = rig.autopilot.sample()
        assert rig.speed() == pytest.approx(0.22)

        def ask(name: str) -> mav.MAVLink_message:
            # Without an answer in between, so that it is of the same moment as what the test reads.
            rig.client.take(name)
            number = getattr(mav, f"MAVLINK_MSG_ID_{name}")
            rig.client.send(mav.MAVLink_command_long_message(1, 1, REQUEST, 0, number, 0, 0, 0, 0, 0, 0))
            rig.run(rig.period_s)
            return rig.client.take(name)[0]

        local = ask("LOCAL_POSITION_NED")
        moved_m = 0.22 * rig.period_s
        assert (local.x, local.y, local.z) == pytest.approx((at.y_m, at.x_m, 0.0), abs=1.1 * moved_m)
        assert (local.vx, local.vy, local.vz) == pytest.approx((at.north_m_s, at.east_m_s, 0.0), abs=1e-3)
        assert local.vx > 0.0 > local.vy
        attitude = ask("ATTITUDE")
        assert attitude.yaw == pytest.approx(-0.25 * math.pi, abs=1e-3)
        quaternion = ask("ATTITUDE_QUATERNION")
        assert 2.0 * math.atan2(quaternion.q4, quaternion.q1) == pytest.approx(attitude.yaw, abs=1e-3)
        globe = ask("GLOBAL_POSITION_INT")
        x_m, y_m = Origin().local_m(globe.lat, globe.lon)
        now = rig.autopilot.sample()
        assert (x_m, y_m) == pytest.approx((now.x_m, now.y_m), abs=0.02)
        assert globe.hdg == pytest.approx(31_500, abs=20)
        assert globe.alt == 488_000
        assert (globe.vx, globe.vy) == pytest.approx((16, -16), abs=1)
        hud = ask("VFR_HUD")
        assert hud.groundspeed == pytest.approx(0.22, abs=1e-3)
        assert hud.heading == 315
        home = ask("HOME_POSITION")
        assert (home.x, home.y, home.z) == pytest.approx((8.0, 3.0, 0.0))
        origin = ask("GPS_GLOBAL_ORIGIN")
        assert (origin.latitude, origin.longitude, origin.altitude) == (473_977_420, 85_455_940, 488_000)
        battery = ask("BATTERY_STATUS")
        charge = rig.autopilot.sample().charge
        assert battery.battery_remaining == int(100.0 * charge)
        assert battery.current_consumed == pytest.approx(10_000 * (1.0 - charge), abs=1.0)
        status = ask("SYS_STATUS")
        assert status.battery_remaining == battery.battery_remaining
        assert status.onboard_control_sensors_health & mav.MAV_SYS_STATUS_PREARM_CHECK
        assert ask("EXTENDED_SYS_STATE").landed_state == mav.MAV_LANDED_STATE_ON_GROUND
        assert ask("GPS_RAW_INT").fix_type == mav.GPS_FIX_TYPE_RTK_FIXED
        before_ms = rig.autopilot.boot_ms
        assert ask("SYSTEM_TIME").time_boot_ms == before_ms
        target = ask("POSITION_TARGET_LOCAL_NED")
        assert (target.x, target.y) == pytest.approx((9.0, 2.0))
        assert ask("MISSION_CURRENT").mission_state == mav.MISSION_STATE_NO_MISSION


def test_what_it_does_not_know_is_not_made_up() -> None:
    with Rig(boot_s=42.0) as rig:
        rig.run(4.0)
        for number in (LOCAL, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN):
            assert rig.command(REQUEST, number) == FAILED
        assert rig.command(mav.MAV_CMD_GET_HOME_POSITION) == FAILED
        rig.run(42.0)
        assert rig.command(mav.MAV_CMD_GET_HOME_POSITION) == ACCEPTED
        assert rig.client.take("HOME_POSITION")
        assert rig.command(REQUEST, mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED) == FAILED


def test_timesync_and_ping_are_answered() -> None:
    with Rig() as rig:
        rig.run(3.0)
        rig.client.send(mav.MAVLink_timesync_message(0, 123_456_789))
        rig.client.send(mav.MAVLink_ping_message(77, 5, 0, 0))
        # Answers of others are not answered.
        rig.client.send(mav.MAVLink_timesync_message(99, 5))
        rig.client.send(mav.MAVLink_ping_message(78, 6, 255, 190))
        rig.run(rig.period_s)
        (sync,) = rig.client.take("TIMESYNC")
        assert sync.ts1 == 123_456_789
        assert 0.0 <= sync.tc1 / 1e9 - (rig.autopilot.now_s - rig.period_s) <= rig.period_s + 1e-6
        (ping,) = rig.client.take("PING")
        assert (ping.time_usec, ping.seq, ping.target_system, ping.target_component) == (77, 5, 255, 190)
