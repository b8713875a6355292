"""Fail-safes of the vehicle itself."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.sdk.values import RobotSpec
from tests.sim.mavlink.client import ACCEPTED, Rig

INT = mav.MAV_PARAM_TYPE_INT32


def write(rig: Rig, **values: float) -> None:
    """Set parameters."""
    for name, value in values.items():
        rig.client.send(mav.MAVLink_param_set_message(1, 1, name.encode(), value, INT))
    rig.run(rig.period_s)
    for name, value in values.items():
        assert rig.autopilot.parameters[name] == value


def beat(rig: Rig, duration_s: float) -> None:
    """Send heartbeats of a ground station."""
    for _ in range(round(duration_s)):
        rig.client.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3))
        rig.run(1.0)


def test_without_a_fail_safe_it_drives_on_when_the_ground_station_is_gone() -> None:
    with Rig() as rig:
        beat(rig, 2.0)
        rig.guided()
        rig.target(15.0, 5.0)
        rig.run(20.0)
        assert rig.speed() > 0.2
        assert rig.autopilot.mode.value == "GUIDED"


def test_a_rover_holds_when_its_ground_station_is_gone_and_stays_so() -> None:
    with Rig() as rig:
        write(rig, FS_GCS_ENABLE=1)
        rig.guided()
        rig.target(15.0, 5.0)
        # Whom it has never heard it does not miss.
        rig.run(7.0)
        assert rig.speed() > 0.2
        beat(rig, 3.0)
        took_s = rig.until(lambda: rig.autopilot.mode.value == "HOLD", 10.0)
        assert 3.9 <= took_s <= 5.1
        rig.run(1.0)
        assert rig.speed() == 0.0
        assert "GCS Failsafe" in rig.client.texts()
        assert rig.client.take("HEARTBEAT")[-1].system_status == mav.MAV_STATE_CRITICAL
        beat(rig, 3.0)
        assert "GCS Failsafe Cleared" in rig.client.texts()
        assert rig.autopilot.mode.value == "HOLD"
        assert rig.client.take("HEARTBEAT")[-1].system_status == mav.MAV_STATE_ACTIVE
        assert rig.mode(15) == ACCEPTED


def test_heartbeats_of_others_do_not_count() -> None:
    with Rig() as rig:
        write(rig, FS_GCS_ENABLE=1)
        rig.guided()
        beat(rig, 2.0)
        other = rig.connect(42, 1)
        for _ in range(7):
            other.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3))
            rig.run(1.0)
        assert rig.autopilot.mode.value == "HOLD"


def test_a_copter_comes_home_and_lands_when_its_ground_station_is_gone() -> None:
    with Rig(vehicle="copter") as rig:
        write(rig, FS_GCS_ENABLE=1)
        rig.fly()
        beat(rig, 2.0)
        rig.target(6.0, 6.0, 1.0)
        rig.until(lambda: rig.autopilot.mode.value == "RTL", 10.0)
        rig.until(lambda: not rig.autopilot.armed, 40.0)
        assert rig.autopilot.landed
        assert abs(rig.at()[0] - 5.0) < 0.1
        assert abs(rig.at()[1] - 5.0) < 0.1


def test_a_low_battery_brings_a_rover_home_and_a_critical_one_holds_it() -> None:
    robot = RobotSpec(1, 5.0, 5.0, 0.0, battery=0.5, drive_s=200.0, idle_s=7200.0)
    with Rig(robots=[robot]) as rig:
        write(rig, BATT_LOW_MAH=4800, BATT_FS_LOW_ACT=1, BATT_CRT_MAH=4700, BATT_FS_CRT_ACT=2)
        rig.guided()
        rig.target(15.0, 5.0)
        rig.until(lambda: rig.autopilot.mode.value == "RTL", 20.0)
        assert {"Battery 1 is low", "Battery Failsafe"} <= set(rig.client.texts())
        rig.until(lambda: rig.autopilot.mode.value == "HOLD", 20.0)
        assert "Battery 1 is critical" in rig.client.texts()
        rig.run(2.0)
        # It happens once: who knows better may go on.
        assert rig.mode(15) == ACCEPTED
        rig.run(2.0)
        assert rig.autopilot.mode.value == "GUIDED"


def test_a_battery_that_only_warns() -> None:
    with Rig(robots=[RobotSpec(1, 5.0, 5.0, 0.0, battery=0.4)], vehicle="copter") as rig:
        write(rig, BATT_LOW_MAH=5000)
        rig.guided()
        rig.run(1.0)
        assert "Battery 1 is low" in rig.client.texts()
        assert rig.autopilot.mode.value == "GUIDED"


def test_a_copter_lands_when_its_battery_is_low() -> None:
    robot = RobotSpec(1, 5.0, 5.0, 0.0, battery=0.5, drive_s=400.0, idle_s=7200.0)
    with Rig(robots=[robot], vehicle="copter") as rig:
        write(rig, BATT_LOW_MAH=4700, BATT_FS_LOW_ACT=1)
        rig.fly()
        rig.until(lambda: rig.autopilot.mode.value == "LAND", 30.0)
        rig.until(lambda: not rig.autopilot.armed, 30.0)


def test_a_fail_safe_comes_before_a_keeper() -> None:
    with Rig() as rig:
        write(rig, FS_GCS_ENABLE=1)
        rig.guided()
        beat(rig, 1.0)
        for _ in range(7):
            rig.master(255, 190)
            rig.run(1.0)
        assert rig.autopilot.mode.value == "HOLD"
