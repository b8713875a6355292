"""OFFBOARD, as PX4's documentation has it: targets have to come before the mode, and it ends with them."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.sim.mavlink.client import ACCEPTED, FAILED, UNSUPPORTED, Rig

OFFBOARD, HOLD = 6 << 16, 4 << 16 | 3 << 24


def stream(rig: Rig, seconds: float, up_m: float = 0.0) -> None:
    """Send a place above where it began, ten times a second."""
    for _ in range(round(10.0 * seconds)):
        rig.target(5.0, 5.0, up_m)
        rig.run(0.1)


def mode_and_status(rig: Rig) -> tuple[int, int]:
    rig.run(1.5)
    beat = rig.client.take("HEARTBEAT")[-1]
    assert beat.autopilot == mav.MAV_AUTOPILOT_PX4
    return beat.custom_mode, beat.system_status


def test_it_begins_once_targets_have_come_for_a_second_takes_off_by_them_and_holds_when_they_end() -> None:
    with Rig(vehicle="copter", like="px4") as rig:
        assert rig.mode(6) == FAILED
        stream(rig, 0.5)
        assert rig.mode(6) == FAILED
        stream(rig, 1.1)
        assert rig.mode(6) == ACCEPTED
        assert rig.arm() == ACCEPTED
        assert rig.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0) == UNSUPPORTED
        stream(rig, 8.0, up_m=1.0)
        assert rig.autopilot.sample().z_m == pytest.approx(1.0, abs=0.05)
        rig.client.take("HEARTBEAT")
        assert mode_and_status(rig) == (HOLD, mav.MAV_STATE_CRITICAL)
        assert any("offboard signal lost" in text for text in rig.client.texts())
        stream(rig, 1.1, up_m=1.0)
        # It does not come back by itself.
        assert rig.autopilot.mode.value == "LOITER"
        assert rig.mode(6) == ACCEPTED


def test_targets_that_come_seldom_do_not_begin_it() -> None:
    with Rig(vehicle="copter", like="px4") as rig:
        for _ in range(5):
            rig.target(5.0, 5.0, 0.0)
            rig.run(0.6)
        assert rig.mode(6) == FAILED


def test_its_ekf_says_that_it_is_constant_on_the_ground_and_has_no_figure_of_a_compass() -> None:
    with Rig(vehicle="copter", like="px4") as rig:
        rig.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS)
        assert rig.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT) == FAILED
        (status,) = rig.client.take("ESTIMATOR_STATUS")
        assert status.flags == 831 | mav.ESTIMATOR_CONST_POS_MODE
        assert math.isnan(status.mag_ratio)
