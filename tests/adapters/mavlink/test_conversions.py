"""What is converted between SOTER and autopilots: frames, modes, addresses, charges."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.frames import Frame, GeoPoint, turned_rad
from soter.adapters.mavlink.legs import TargetLeg, reach_m
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.sampling import ChargeFilter
from soter.adapters.mavlink.transport import Address
from soter.adapters.mavlink.vehicle import kind_of, px4_mode
from soter.errors import RobotUnavailable
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Link, RobotState, Waypoint

ROOM = Workspace(4.0, 4.0, (), (RobotPlace(1, 1.0, 1.0, Box(0.9, 0.9, 1.1, 1.1)),))


def state(x_m: float, y_m: float, heading_rad: float = 0.0) -> RobotState:
    return RobotState(1, 0.0, 0.0, x_m, y_m, 0.0, heading_rad, 0.0, 0.0, 0.0, None, None, None, Link.UP)


# --- frames --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("heading_deg", "yaw_deg"), [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (-90.0, 180.0), (30.0, 60.0)]
)
def test_east_is_a_yaw_of_ninety_degrees(heading_deg: float, yaw_deg: float) -> None:
    assert math.degrees(turned_rad(math.radians(heading_deg))) == pytest.approx(yaw_deg)
    assert math.degrees(turned_rad(math.radians(yaw_deg))) == pytest.approx(heading_deg)


def test_without_an_origin_the_ekf_has_it() -> None:
    frame = Frame.between(None, GeoPoint(47.0, 8.0, 500.0), 0.0)
    assert frame.to_ned(3.0, 2.0, 1.0) == (2.0, 3.0, -1.0)
    assert frame.from_ned(2.0, 3.0, -1.0) == (3.0, 2.0, 1.0)


def test_an_ekf_that_woke_up_elsewhere_is_shifted() -> None:
    workspace, ekf = GeoPoint(47.0, 8.0, 500.0), GeoPoint(47.0001, 8.0001, 502.0)
    frame = Frame.between(workspace, ekf, 0.0)
    assert frame.north_m == pytest.approx(11.13, abs=0.01)
    assert frame.east_m == pytest.approx(11.13 * math.cos(math.radians(47.0)), abs=0.01)
    assert frame.up_m == pytest.approx(2.0)
    place = (4.0, 5.0, 1.0)
    assert frame.from_ned(*frame.to_ned(*place)) == pytest.approx(place)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_date_line_may_pass_between_the_workspace_and_an_ekf(side: float) -> None:
    frame = Frame.between(GeoPoint(-17.0, side * 179.9999, 0.0), GeoPoint(-17.0, side * -179.9999, 0.0), 0.0)
    assert frame.east_m == pytest.approx(side * 22.26 * math.cos(math.radians(17.0)), abs=0.01)


def test_copters_fly_in_a_plane_above_the_ground() -> None:
    frame = Frame.between(None, GeoPoint(47.0, 8.0, 500.0), 1.5)
    assert frame.to_ned(0.0, 0.0, 0.0) == (0.0, 0.0, -1.5)
    assert frame.from_ned(0.0, 0.0, -2.0) == (0.0, 0.0, 0.5)


# --- modes ---------------------------------------------------------------------------------------------------


def test_the_same_number_is_hold_on_one_and_guided_on_another() -> None:
    rover = kind_of(mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
    copter = kind_of(mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
    assert (rover.mode_name(4), copter.mode_name(4)) == ("HOLD", "GUIDED")
    assert (rover.guided, rover.stop, copter.guided, copter.stop) == (15, 4, 4, 17)
    assert rover.mode_params(15) == (1.0, 15.0, 0.0)
    assert rover.mode_name(99) == "mode 99"


def test_px4_packs_two_modes_into_one() -> None:
    copter = kind_of(mav.MAV_TYPE_HEXAROTOR, mav.MAV_AUTOPILOT_PX4)
    assert copter.is_px4
    assert copter.guided == px4_mode(6) == 6 << 16
    assert copter.mode_params(copter.stop) == (1.0, 4.0, 3.0)
    assert copter.mode_name(copter.guided) == "OFFBOARD"


@pytest.mark.parametrize(
    ("vehicle", "autopilot"),
    [
        (mav.MAV_TYPE_FIXED_WING, mav.MAV_AUTOPILOT_ARDUPILOTMEGA),
        (mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID),
        (mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_GENERIC),
    ],
)
def test_what_cannot_be_commanded_is_refused(vehicle: int, autopilot: int) -> None:
    with pytest.raises(RobotUnavailable, match="rovers and multicopters"):
        kind_of(vehicle, autopilot)


def test_boats_drift_where_they_have_stopped_and_are_refused_where_their_autopilot_does_not_hold_them() -> None:
    assert kind_of(mav.MAV_TYPE_SURFACE_BOAT, mav.MAV_AUTOPILOT_ARDUPILOTMEGA).drifts
    with pytest.raises(RobotUnavailable, match="it is a boat, which drifts"):
        kind_of(mav.MAV_TYPE_SURFACE_BOAT, mav.MAV_AUTOPILOT_PX4)


# --- connections and options ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "address", "url"),
    [
        ("udpin:127.0.0.1:14550", Address("udpin", "127.0.0.1", 14550), "udpin://127.0.0.1:14550"),
        ("udpout://localhost:1", Address("udpout", "localhost", 1), "udpout://localhost:1"),
        ("tcp:127.0.0.1:5760", Address("tcp", "127.0.0.1", 5760), "tcpout://127.0.0.1:5760"),
        ("serial:/dev/ttyACM0:57600", Address("serial", "/dev/ttyACM0", 57600), "serial:///dev/ttyACM0:57600"),
    ],
)
def test_connections_are_read(text: str, address: Address, url: str) -> None:
    assert Address.parse(text) == address
    assert address.is_local
    assert address.mavsdk_url == url


@pytest.mark.parametrize(
    "text", ["", "udp:127.0.0.1:1", "udpin:14550", "tcp:host:", "tcp:h:0", "tcp:h:70000", "tcp:h:x"]
)
def test_what_is_no_connection_says_what_is_allowed(text: str) -> None:
    with pytest.raises(ValueError, match="allowed"):
        Address.parse(text)


def test_a_connection_that_leaves_this_host_has_to_be_signed(tmp_path: object) -> None:
    with pytest.raises(ValidationError, match="nothing is signed"):
        MavlinkConfig(workspace=ROOM, connection="udpin:0.0.0.0:14550")
    assert MavlinkConfig(workspace=ROOM, connection="udpin:0.0.0.0:14550", unsigned=True).connection is not None
    assert MavlinkConfig(workspace=ROOM, connection="udpin:127.0.0.1:14550").passphrase_file is None


def test_the_truth_is_told_on_this_host_only() -> None:
    with pytest.raises(ValidationError, match="own host only"):
        MavlinkConfig(workspace=ROOM, truth="192.168.0.7:99")


def test_what_moves_given_vehicles_is_no_engine_of_ours() -> None:
    assert MavlinkConfig(workspace=ROOM).engine == "kinematic"
    assert MavlinkConfig(workspace=ROOM, connection="udpin:127.0.0.1:14550").engine is None
    with pytest.raises(ValidationError, match="engine is for simulated vehicles"):
        MavlinkConfig(workspace=ROOM, connection="udpin:127.0.0.1:14550", engine="kinematic")


def test_a_voltage_that_falls_while_charging_is_refused() -> None:
    with pytest.raises(ValidationError, match="empty_v"):
        MavlinkConfig.model_validate({"workspace": ROOM, "voltage": {"empty_v": 12.0, "full_v": 11.0}})


def test_what_is_promised_grows_with_the_speed_up() -> None:
    slow, fast = MavlinkConfig(workspace=ROOM).promised(), MavlinkConfig(workspace=ROOM, speedup=2.0).promised()
    assert fast.jitter_s == 2.0 * slow.jitter_s
    # The vehicle's own periods are in its own time.
    assert fast.latency_s - slow.setpoint_period_s == pytest.approx(2.0 * (slow.latency_s - slow.setpoint_period_s))
    assert fast.lease_s == slow.lease_s


def test_rigid_bodies_are_commanded_and_heard_less_often() -> None:
    points, bodies = (
        MavlinkConfig(workspace=ROOM).promised(),
        MavlinkConfig(workspace=ROOM, engine="pybullet").promised(),
    )
    assert bodies.setpoint_period_s == 0.05
    assert bodies.latency_s - points.latency_s == pytest.approx(0.03)
    assert bodies.sample_age_s - points.sample_age_s == pytest.approx(0.03)


def test_a_real_vehicle_promises_what_is_configured() -> None:
    config = MavlinkConfig.model_validate({"workspace": ROOM, "promise": {"v_max_m_s": 2.0, "reverses": False}})
    assert (config.promised().v_max_m_s, config.promised().reverses) == (2.0, False)
    with pytest.raises(ValidationError):
        MavlinkConfig.model_validate({"workspace": ROOM, "promise": {"v_max_m_s": float("nan")}})


# --- charge --------------------------------------------------------------------------------------------------


def said(percent: int, volts: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(battery_remaining=percent, voltage_battery=int(volts * 1e3))


def test_whole_percents_fall_no_faster_than_the_battery_can() -> None:
    charge = ChargeFilter(drive_s=1800.0)
    assert charge.read(said(80), 10.0) == 0.80
    # A percent less is said at once; it comes over the 18 s that driving takes for it.
    assert charge.read(said(79), 10.1) == pytest.approx(0.80 - 0.1 / 1800.0)
    assert charge.read(said(79), 19.0) == pytest.approx(0.80 - 9.0 / 1800.0)
    assert charge.read(said(79), 100.0) == 0.79


def test_a_charge_that_rises_is_believed_at_once_and_one_that_collapses_too() -> None:
    charge = ChargeFilter(drive_s=1800.0)
    charge.read(said(50), 0.0)
    assert charge.read(said(60), 1.0) == 0.60
    assert charge.read(said(40), 2.0) == 0.40


def test_a_sample_from_before_does_not_raise_a_charge() -> None:
    charge = ChargeFilter(drive_s=1800.0)
    charge.read(said(80), 10.0)
    assert charge.read(said(79), 9.0) == 0.80


def test_an_unknown_charge_is_none_unless_the_voltage_tells() -> None:
    assert ChargeFilter(1800.0).read(None, 0.0) is None
    assert ChargeFilter(1800.0).read(said(-1, 11.0), 0.0) is None
    assert ChargeFilter(1800.0, 10.0, 12.0).read(said(-1, 11.0), 0.0) == pytest.approx(0.5)
    assert ChargeFilter(1800.0, 10.0, 12.0).read(said(-1, 65.535), 0.0) is None
    assert ChargeFilter(1800.0, 10.0, 12.0).read(said(-1, 9.0), 0.0) == 0.0


# --- the carrot ----------------------------------------------------------------------------------------------


def test_the_carrot_stays_within_reach_and_on_the_line() -> None:
    leg = TargetLeg(0.0, 0.0, 0.0, Waypoint(3.0, 4.0))
    assert leg.ahead(state(0.0, 0.0), 0.5) == pytest.approx((0.3, 0.4, 0.0))
    # A vehicle that strays is led back to the line, no further ahead than it may go.
    assert leg.ahead(state(0.6 - 0.08, 0.8 + 0.06), 0.5) == pytest.approx((0.9, 1.2, 0.0))
    assert leg.ahead(state(2.9, 3.9), 0.5) == pytest.approx((3.0, 4.0, 0.0))


def test_the_carrot_of_no_way_is_the_target() -> None:
    assert TargetLeg(1.0, 1.0, 0.0, Waypoint(1.0, 1.0)).ahead(state(1.0, 1.0), 0.5) == (1.0, 1.0, 0.0)


def test_a_vehicle_that_hears_nothing_more_is_at_rest_on_its_carrot_when_the_lease_has_ended() -> None:
    v_m_s, brake_m_s2, lease_s = 0.22, 1.0, 0.15
    ahead_m = reach_m(v_m_s, brake_m_s2, lease_s)
    assert ahead_m == pytest.approx(v_m_s * lease_s + v_m_s**2 / 2.0)
    assert reach_m(v_m_s, brake_m_s2, 0.0) == pytest.approx(v_m_s**2 / 2.0)


def test_copters_turn_before_they_fly() -> None:
    leg = TargetLeg(1.0, 1.0, 0.0, Waypoint(1.0, 3.0, speed_m_s=0.1))
    turning = leg.looking_ahead(state(1.0, 1.0, 0.0))
    assert (turning.x_m, turning.y_m, turning.speed_m_s) == (1.0, 1.0, 0.1)
    assert turning.heading_rad == pytest.approx(math.pi / 2.0)
    flying = leg.looking_ahead(state(1.0, 1.0, math.pi / 2.0))
    assert (flying.x_m, flying.y_m) == (1.0, 3.0)
    with_heading = TargetLeg(1.0, 1.0, 0.0, Waypoint(1.0, 3.0, heading_rad=0.3))
    assert with_heading.looking_ahead(state(1.0, 1.0)) is with_heading.target
