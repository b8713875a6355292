"""What is wrong with real autopilots, as the simulated ones have it with `like`. In the test's own time."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.kinds import Mode
from soter_sim.mavlink.simulation import Settings
from tests.sim.mavlink.client import FAILED, VELOCITY, Rig

STANDS = VELOCITY & ~mav.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
HOLD = 4


def rover() -> Rig:
    rig = Rig(like="ardurover")
    rig.run(2.5)
    rig.guided()
    return rig


def heading(rig: Rig) -> float:
    return rig.simulation.world.truth.pose(1)[2]


def test_at_rest_its_estimate_moves() -> None:
    with rover() as rig:
        for _ in range(30):
            rig.run(1.0)
            seen = rig.autopilot.sample()
            assert 0.025 <= math.hypot(seen.east_m_s, seen.north_m_s) <= 0.03
            assert 0.0 <= math.dist((seen.x_m, seen.y_m), rig.at()) <= 0.3
        assert rig.at() == (5.0, 5.0)


@pytest.mark.parametrize(("mask", "turns"), [(VELOCITY, True), (STANDS, False)])
def test_a_velocity_of_nothing_turns_it_to_the_north_unless_a_yaw_rate_is_given(mask: int, turns: bool) -> None:
    with rover() as rig:
        rig.velocity(0.0, 0.0, mask=mask)
        rig.run(2.0)
        assert heading(rig) == pytest.approx(0.5 * math.pi if turns else 0.0, abs=0.05)
        assert rig.at() == (5.0, 5.0)


def test_to_a_near_place_it_does_not_get_fast_and_comes_there_slowly() -> None:
    with rover() as rig:
        rig.target(5.06, 5.0)
        fastest = 0.0
        for _ in range(round(1.0 / rig.period_s)):
            rig.run(rig.period_s)
            fastest = max(fastest, rig.speed())
        assert fastest <= 0.13
        rig.run(0.5)
        assert rig.speed() > 0.0


def test_that_its_gps_is_gone_it_notices_late_and_then_holds() -> None:
    with rover() as rig:
        rig.client.send(mav.MAVLink_param_set_message(1, 1, b"SIM_GPS_DISABLE", 1.0, mav.MAV_PARAM_TYPE_INT32))
        rig.run(6.5)
        seen = rig.autopilot.sample()
        assert math.dist((seen.x_m, seen.y_m), rig.at()) > 0.4
        assert (rig.autopilot.mode.value, rig.autopilot.ready) == ("GUIDED", True)
        assert rig.autopilot.boot_ms - rig.autopilot.fix_ms > 6000
        rig.run(1.0)
        assert (rig.autopilot.mode.value, rig.autopilot.ready, rig.autopilot.failed) == ("HOLD", False, "EKF")
        assert "EKF failsafe" in rig.client.texts()
        rig.client.send(mav.MAVLink_param_set_message(1, 1, b"SIM_GPS_DISABLE", 0.0, mav.MAV_PARAM_TYPE_INT32))
        rig.run(0.2)
        # It does not go on by itself.
        assert (rig.autopilot.mode.value, rig.autopilot.ready, rig.autopilot.failed) == ("HOLD", True, None)


def test_it_does_not_arm_as_soon_as_it_is_ready() -> None:
    with Rig(like="arducopter", vehicle="copter") as rig:
        assert rig.autopilot.ready
        assert rig.arm() == FAILED
        assert "Need Position" in "".join(rig.client.texts())
        rig.run(2.5)
        rig.fly()


@pytest.mark.parametrize("wind_m_s", [0.0, 5.0])
def test_wind_sways_a_copter(wind_m_s: float) -> None:
    with Rig(like="arducopter", vehicle="copter") as rig:
        rig.client.send(mav.MAVLink_param_set_message(1, 1, b"SIM_WIND_SPD", wind_m_s, mav.MAV_PARAM_TYPE_REAL32))
        rig.run(2.5)
        rig.fly()
        rig.target(5.0, 5.0, 1.0)
        off_m = []
        for _ in range(24):
            rig.run(0.25)
            off_m.append(math.dist(rig.at(), (5.0, 5.0)))
        assert max(off_m) == pytest.approx(0.04 * wind_m_s * math.sqrt(2.0), abs=0.1)


def test_a_copter_is_like_no_rover() -> None:
    with pytest.raises(ValueError, match="like is 'ardurover', allowed for a copter: arducopter"):
        Settings(vehicle="copter", like="ardurover", tcp=(0,))


def parameter(rig: Rig, name: bytes, value: float) -> None:
    rig.client.send(mav.MAVLink_param_set_message(1, 1, name, value, mav.MAV_PARAM_TYPE_REAL32))
    rig.run(2.0 * rig.period_s)


def said(rig: Rig, message_id: int, name: str) -> mav.MAVLink_message:
    rig.command(mav.MAV_CMD_REQUEST_MESSAGE, message_id)
    return rig.client.take(name)[-1]


def test_its_gps_says_how_far_it_is_off() -> None:
    with rover() as rig:
        assert said(rig, mav.MAVLINK_MSG_ID_GPS_RAW_INT, "GPS_RAW_INT").h_acc == 300
        parameter(rig, b"SIM_GPS1_ACC", 5.0)
        assert said(rig, mav.MAVLINK_MSG_ID_GPS_RAW_INT, "GPS_RAW_INT").h_acc == 5000


def test_another_ekf_has_its_origin_where_the_vehicle_is_when_it_is_chosen() -> None:
    with rover() as rig:
        first = said(rig, mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, "GPS_GLOBAL_ORIGIN")
        for ekf, origin_m in ((2.0, 5.0), (3.0, 0.0)):
            parameter(rig, b"AHRS_EKF_TYPE", ekf)
            at = said(rig, mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED, "LOCAL_POSITION_NED")
            assert (at.x, at.y) == pytest.approx((5.0 - origin_m, 5.0 - origin_m), abs=0.15)
            now = said(rig, mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, "GPS_GLOBAL_ORIGIN")
            assert (now.latitude - first.latitude) * 0.0111319 == pytest.approx(origin_m, abs=0.02)
        rig.target(5.06, 5.0)
        rig.run(3.0)
        assert rig.at() == pytest.approx((5.06, 5.0), abs=0.1)


def boat() -> Rig:
    rig = Rig(like="ardurover-boat")
    rig.autopilot.parameters.set("SIM_TIDE_SPD", 0.2)
    rig.autopilot.parameters.set("SIM_TIDE_DIR", 270.0)
    rig.run(2.5)
    assert rig.at() == (5.0, 5.0), "it is moored until it is armed"
    rig.guided()
    return rig


def drifts_to_m(rig: Rig, seconds: float) -> float:
    """Return how far east a boat gets within a time, in which it keeps to its line."""
    most_m = 0.0
    for _ in range(round(seconds / rig.period_s)):
        rig.run(rig.period_s)
        most_m = max(most_m, rig.at()[0] - 5.0)
        assert rig.at()[1] == pytest.approx(5.0, abs=0.3)
    return most_m


def test_a_boat_drifts_within_its_radius_and_is_driven_back() -> None:
    with boat() as rig:
        rig.autopilot.parameters.set("LOIT_RADIUS", 0.5)
        assert 0.5 <= drifts_to_m(rig, 30.0) <= 1.0
        # LOITER holds it, too, where it is then; HOLD lets it go.
        rig.autopilot.set_mode(Mode.LOITER, "test")
        assert drifts_to_m(rig, 30.0) <= 2.0
        rig.autopilot.set_mode(Mode.HOLD, "test")
        assert drifts_to_m(rig, 30.0) >= 6.0


def test_a_boat_is_held_once_it_has_been_told_nothing_for_three_seconds() -> None:
    with boat() as rig:
        for _ in range(10):
            rig.velocity(0.0, 0.0, mask=STANDS)
            rig.run(1.0)
        drifted_m = rig.at()[0] - 5.0
        assert drifted_m == pytest.approx(2.0, abs=0.1)
        assert 0.4 <= drifts_to_m(rig, 30.0) - drifted_m <= 0.8


def test_a_boat_has_the_kinematic_engine_only() -> None:
    with pytest.raises(ValueError, match="engine is 'pybullet', allowed for a boat: kinematic"):
        Settings(like="ardurover-boat", engine="pybullet", tcp=(0,))
