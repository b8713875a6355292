"""Copters on the wire: take-off, flight, landing, and what they refuse."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.frames import Origin
from tests.sim.mavlink.client import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Rig
from tests.sim.worlds import from_segment

TAKE_OFF = mav.MAV_CMD_NAV_TAKEOFF
LOITER, RTL, LAND, BRAKE = 5, 6, 9, 17


def landed_state(rig: Rig) -> int:
    """What EXTENDED_SYS_STATE says."""
    assert rig.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE) == ACCEPTED
    return int(rig.client.take("EXTENDED_SYS_STATE")[-1].landed_state)


def test_it_takes_off_flies_somewhere_and_lands() -> None:
    with Rig(vehicle="copter") as rig:
        assert landed_state(rig) == mav.MAV_LANDED_STATE_ON_GROUND
        rig.fly(1.5)
        assert landed_state(rig) == mav.MAV_LANDED_STATE_IN_AIR
        start, end = rig.at(), (6.5, 5.8)
        rig.target(*end, 2.0)
        for _ in range(round(15.0 / rig.period_s)):
            rig.run(rig.period_s)
            off_m, beyond_m = from_segment(*rig.at(), start, end)
            assert off_m <= 0.02
            assert beyond_m <= 0.01
        assert math.dist(rig.at(), end) < 0.05
        assert rig.autopilot.sample().z_m == pytest.approx(2.0, abs=0.05)
        assert rig.mode(LAND) == ACCEPTED
        rig.run(1.0)
        assert landed_state(rig) == mav.MAV_LANDED_STATE_LANDING
        rig.until(lambda: not rig.autopilot.armed, 20.0)
        assert rig.autopilot.sample().z_m == 0.0
        assert math.dist(rig.at(), end) < 0.05


def test_targets_before_the_take_off_are_ignored() -> None:
    with Rig(vehicle="copter") as rig:
        rig.guided()
        rig.target(6.0, 6.0, 1.0)
        lat_e7, lon_e7 = Origin().geodetic_e7(6.0, 6.0)
        assert rig.command_int(mav.MAV_CMD_DO_REPOSITION, -1, 1, x=lat_e7, y=lon_e7, z=489.0) == DENIED
        rig.run(2.0)
        assert rig.autopilot.landed
        assert rig.at() == (5.0, 5.0)


def test_take_off_is_refused_where_it_cannot_be() -> None:
    with Rig(vehicle="copter") as rig:
        assert rig.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 1.0) == FAILED
        rig.guided()
        for bad in (0.0, -1.0, math.nan, math.inf):
            assert rig.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, bad) == DENIED
        assert rig.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 1.0) == ACCEPTED
        rig.run(5.0)
        assert rig.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 1.0) == FAILED
    with Rig() as rig:
        rig.guided()
        assert rig.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 1.0) == UNSUPPORTED


def test_it_disarms_by_itself_on_the_ground_and_not_at_all_in_flight() -> None:
    with Rig(vehicle="copter") as rig:
        rig.guided()
        took_s = rig.until(lambda: not rig.autopilot.armed, 20.0)
        assert took_s == pytest.approx(10.0, abs=0.2)
        rig.fly()
        assert rig.disarm() == FAILED
        assert "Disarm: flying" in rig.client.texts()
        rig.run(15.0)
        assert rig.autopilot.armed
        assert rig.autopilot.sample().z_m == pytest.approx(1.0, abs=0.02)
        assert rig.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == FAILED


def test_it_arms_in_some_modes_only() -> None:
    with Rig(vehicle="copter") as rig:
        for mode in (LAND, BRAKE, RTL):
            rig.mode(mode)
            assert rig.arm() == FAILED
        for mode in (0, LOITER, 4):
            rig.mode(mode)
            assert rig.arm() == ACCEPTED
            assert rig.disarm() == ACCEPTED


@pytest.mark.parametrize("mode", [BRAKE, LOITER, 0])
def test_other_modes_stop_it_in_the_air(mode: int) -> None:
    with Rig(vehicle="copter") as rig:
        rig.fly()
        rig.target(9.0, 5.0, 1.0)
        rig.run(3.0)
        assert rig.autopilot.sample().east_m_s == pytest.approx(0.22)
        before_m = rig.at()[0]
        assert rig.mode(mode) == ACCEPTED
        rig.run(2.0)
        sample = rig.autopilot.sample()
        assert (sample.east_m_s, sample.north_m_s, sample.up_m_s) == (0.0, 0.0, 0.0)
        assert rig.at()[0] - before_m < 0.22**2 / (2 * 2.0) + 0.22 * 3 * rig.period_s
        assert sample.z_m == pytest.approx(1.0, abs=0.02)


def test_rtl_goes_up_goes_home_lands_and_disarms() -> None:
    with Rig(vehicle="copter") as rig:
        rig.fly(0.5)
        rig.target(6.0, 5.0, 0.5)
        rig.run(8.0)
        highest_m = 0.0
        assert rig.mode(RTL) == ACCEPTED
        while rig.autopilot.armed:
            rig.run(rig.period_s)
            highest_m = max(highest_m, rig.autopilot.sample().z_m)
        assert highest_m == pytest.approx(1.0, abs=0.1)
        assert rig.at() == pytest.approx((5.0, 5.0), abs=0.1)


def test_velocities_move_it_in_three_dimensions_and_turn_it() -> None:
    with Rig(vehicle="copter") as rig:
        rig.fly()
        rig.velocity(0.1, 0.2, 0.1, mask=0x0DC7 & ~0x0800, yaw_rate=-0.5)
        rig.run(1.0)
        sample = rig.autopilot.sample()
        assert sample[4:8] == pytest.approx((0.1, 0.2, 0.1, 0.5), abs=0.01)
        rig.run(3.0)
        assert rig.autopilot.sample()[4:8] == pytest.approx((0.0, 0.0, 0.0, 0.0))


def test_a_yaw_is_turned_to() -> None:
    with Rig(vehicle="copter") as rig:
        rig.fly()
        rig.target(6.0, 5.0, 1.0, mask=0x0DF8 & ~0x0400, yaw=-0.5 * math.pi)
        rig.run(10.0)
        # West by the compass.
        assert abs(rig.autopilot.sample().heading_rad) == pytest.approx(math.pi, abs=0.02)


def test_the_lease_stops_a_copter_too() -> None:
    with Rig(vehicle="copter") as rig:
        rig.fly()
        assert rig.master(255, 190) == ACCEPTED
        rig.target(9.0, 5.0, 1.0)
        rig.run(1.0)
        sample = rig.autopilot.sample()
        assert sample.east_m_s == 0.0
        assert sample.z_m == pytest.approx(1.0, abs=0.02)
        assert rig.command(mav.MAV_CMD_NAV_LAND) == ACCEPTED
        rig.until(lambda: not rig.autopilot.armed, 20.0)


def test_an_empty_battery_brings_it_down() -> None:
    with Rig(vehicle="copter") as rig:
        rig.fly()
        rig.simulation.world.bodies.charge[0] = 0.001
        rig.target(9.0, 5.0, 1.0)
        rig.until(lambda: rig.autopilot.landed, 20.0)
        assert rig.simulation.world.truth.report().count("battery") == 1
