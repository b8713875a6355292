"""What autopilots make of places on earth on their spheres, and workspaces on the ellipsoid.

The autopilots' arithmetic is done a second time here, in the precision in which they do it; pymap3d is the judge.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.adapters.mavlink.frames import EarthFrame, GeoPoint, frame_of, geodetic_e7, local_m
from soter.geometry.earth import FARTHEST_M, Projection
from soter.geometry.site import GeoOrigin
from soter_sim.mavlink.frames import Globe, GlobeReckoning

pymap3d = pytest.importorskip("pymap3d")
vincenty = pytest.importorskip("pymap3d.vincenty")

FACTOR = np.float32(0.011131884502145034)
RIGHT_ANGLES = 2e-5
"""North and east of a vehicle are at right angles to so many radians where the largest site ends, on the plane."""

latitudes = st.floats(-80.0, 80.0)
longitudes = st.one_of(st.floats(-180.0, 180.0), st.sampled_from([179.9, -179.95]))
metres = st.floats(-20_000.0, 20_000.0)
places = st.tuples(metres, metres)
turns = st.floats(-math.pi, math.pi)


def on_plane(origin: GeoOrigin, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    east, north, _ = pymap3d.geodetic2enu(lat_deg, lon_deg, 0.0, origin.lat_deg, origin.lon_deg, 0.0)
    return float(east), float(north)


def whole(lat_deg: float, lon_deg: float) -> tuple[int, int]:
    return round(lat_deg * 1e7), round(math.remainder(lon_deg, 360.0) * 1e7)


def shrunk(lat_e7: float) -> np.float32:
    return np.float32(np.cos(np.float32(lat_e7 * math.radians(1e-7))))


def apart_e7(lon_e7: float, lon_0_e7: float) -> float:
    return math.remainder(lon_e7 - lon_0_e7, 3.6e9)


def ardupilot(
    ekf_e7: tuple[int, int], moved_e7: tuple[int, int], at_e7: tuple[float, float]
) -> tuple[np.float32, np.float32]:
    """Return LOCAL_POSITION_NED of an ArduPilot whose EKF has moved its inner origin to near the vehicle."""

    def between(a: tuple[float, float], b: tuple[float, float]) -> tuple[np.float32, np.float32]:
        east = np.float32(apart_e7(b[1], a[1])) * FACTOR * shrunk((a[0] + b[0]) / 2.0)
        return np.float32(b[0] - a[0]) * FACTOR, east

    first, second = between(ekf_e7, moved_e7), between(moved_e7, at_e7)
    return first[0] + second[0], first[1] + second[1]


def ardupilot_target(ekf_e7: tuple[int, int], north: float, east: float) -> tuple[float, float]:
    """Return the place on earth, in degrees, that an ArduPilot makes of a local one."""
    north_e7 = int(np.float32(north) * np.float32(89.83204953368922))
    east_e7 = int(np.float32(east) * np.float32(89.83204953368922) / shrunk(ekf_e7[0] + north_e7 // 2))
    return 1e-7 * (ekf_e7[0] + north_e7), 1e-7 * (ekf_e7[1] + east_e7)


def px4(lat_0: float, lon_0: float, lat_deg: float, lon_deg: float) -> tuple[np.float32, np.float32]:
    """Return LOCAL_POSITION_NED of a PX4."""
    lat, ref, lon = math.radians(lat_deg), math.radians(lat_0), math.radians(lon_deg - lon_0)
    arc = math.acos(min(1.0, math.sin(ref) * math.sin(lat) + math.cos(ref) * math.cos(lat) * math.cos(lon)))
    k = 6_371_000.0 * (arc / math.sin(arc) if arc > 0.0 else 1.0)
    north = k * (math.cos(ref) * math.sin(lat) - math.sin(ref) * math.cos(lat) * math.cos(lon))
    return np.float32(north), np.float32(k * math.cos(lat) * math.sin(lon))


def earth_frame(origin: GeoOrigin, ekf_e7: tuple[int, int], *, is_px4: bool) -> EarthFrame:
    there = GeoPoint(ekf_e7[0] * 1e-7, ekf_e7[1] * 1e-7, 0.0)
    frame = frame_of(Projection(origin, "test"), there, 0.0, is_px4=is_px4)
    assert isinstance(frame, EarthFrame)
    return frame


@given(latitudes, longitudes, places, places, st.floats(0.0, 20.0), turns)
def test_where_an_ardupilot_says_that_it_is_is_known_to_what_is_stated(
    lat_deg: float, lon_deg: float, at: tuple[float, float], ekf: tuple[float, float], speed_m_s: float, turn: float
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    project = Projection(origin, "test")
    lat, lon = project.place(*at)
    ekf_e7 = whole(*project.place(*ekf))
    # It has moved its inner origin a second ago.
    behind = at[0] - speed_m_s * math.cos(turn), at[1] - speed_m_s * math.sin(turn)
    moved_e7 = whole(*project.place(*behind))
    north, east = ardupilot(ekf_e7, moved_e7, (lat * 1e7, lon * 1e7))
    frame = earth_frame(origin, ekf_e7, is_px4=False)
    found = frame.from_ned(float(north), float(east), 0.0)
    bound_m = frame.sphere.error_m(math.hypot(north, east), speed_m_s)
    assert math.dist(found[:2], on_plane(origin, lat, lon)) <= bound_m
    # At a walk it is a hand's breadth where sites end, at latitude 80, and millimetres on a site of a kilometre.
    assert frame.sphere.error_m(500.0, 1.5) <= 0.004
    assert frame.sphere.error_m(FARTHEST_M, 1.5) <= 0.1


@given(latitudes, longitudes, places, places)
def test_where_a_px4_says_that_it_is_is_known_to_what_is_stated(
    lat_deg: float, lon_deg: float, at: tuple[float, float], ekf: tuple[float, float]
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    project = Projection(origin, "test")
    lat, lon = project.place(*at)
    lat_0, lon_0 = project.place(*ekf)
    north, east = px4(lat_0, lon_0, lat, lon)
    # It cuts its origin off to whole numbers.
    frame = earth_frame(origin, (int(lat_0 * 1e7), int(lon_0 * 1e7)), is_px4=True)
    found = frame.from_ned(float(north), float(east), 0.0)
    bound_m = frame.sphere.error_m(math.hypot(north, east), 0.0)
    assert math.dist(found[:2], on_plane(origin, lat, lon)) <= bound_m <= 0.04


@pytest.mark.parametrize("is_px4", [False, True], ids=["ardupilot", "px4"])
@given(latitudes, longitudes, places, places)
def test_there_and_back_is_the_same_place(
    is_px4: bool, lat_deg: float, lon_deg: float, at: tuple[float, float], ekf: tuple[float, float]
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    frame = earth_frame(origin, whole(*Projection(origin, "test").place(*ekf)), is_px4=is_px4)
    place = (*at, 3.0)
    assert frame.from_ned(*frame.to_ned(*place)) == pytest.approx(place, abs=1e-6)


@given(latitudes, longitudes, places, places)
def test_a_target_is_on_earth_where_it_is_in_the_workspace(
    lat_deg: float, lon_deg: float, at: tuple[float, float], ekf: tuple[float, float]
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    ekf_e7 = whole(*Projection(origin, "test").place(*ekf))
    frame = earth_frame(origin, ekf_e7, is_px4=False)
    north, east, _ = frame.to_ned(*at, 0.0)
    driven_to = on_plane(origin, *ardupilot_target(ekf_e7, north, east))
    # It cuts the target off to whole numbers, 11 mm each way.
    assert math.dist(driven_to, at) <= frame.sphere.error_m(math.hypot(north, east), 0.0) + 0.017


@given(latitudes, longitudes, places, turns)
def test_headings_and_velocities_are_those_of_the_ellipsoid(
    lat_deg: float, lon_deg: float, at: tuple[float, float], yaw_rad: float
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    frame = earth_frame(origin, whole(lat_deg, lon_deg), is_px4=False)
    lat, lon = frame.workspace.place(*at)
    ahead_lat, ahead_lon = vincenty.vreckon(lat, lon, 10.0, math.degrees(yaw_rad) % 360.0)
    ahead = on_plane(origin, float(ahead_lat), float(ahead_lon))
    way = (ahead[0] - at[0]) / 10.0, (ahead[1] - at[1]) / 10.0
    velocity = frame.to_velocity(at, math.cos(yaw_rad), math.sin(yaw_rad))
    assert velocity == pytest.approx(way, abs=1e-6)
    heading_rad = frame.to_heading_rad(at, yaw_rad)
    assert math.remainder(heading_rad - math.atan2(way[1], way[0]), math.tau) == pytest.approx(0.0, abs=1e-6)
    back_rad = frame.to_yaw_rad(at, heading_rad)
    assert math.remainder(back_rad - yaw_rad, math.tau) == pytest.approx(0.0, abs=RIGHT_ANGLES)


@given(latitudes, longitudes, places)
def test_fences_and_missions_are_where_they_are_on_earth(
    lat_deg: float, lon_deg: float, at: tuple[float, float]
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    project = Projection(origin, "test")
    lat_e7, lon_e7 = geodetic_e7(project, *at)
    assert abs(lon_e7) <= 1_800_000_000
    assert math.dist(on_plane(origin, lat_e7 * 1e-7, lon_e7 * 1e-7), at) <= 0.008
    assert math.dist(local_m(project, lat_e7, lon_e7), at) <= 0.008


@given(latitudes, longitudes, places, places, turns)
def test_the_simulated_vehicle_reckons_by_its_own_arithmetic_and_to_the_same(
    lat_deg: float, lon_deg: float, at: tuple[float, float], ekf: tuple[float, float], yaw_rad: float
) -> None:
    origin = GeoOrigin(lat_deg, lon_deg)
    reckoning = GlobeReckoning(Globe(lat_deg, lon_deg, 0.0), *ekf)
    frame = earth_frame(origin, reckoning.origin_e7, is_px4=False)
    east, north = reckoning.local_m(*at)
    assert frame.from_ned(north, east, 0.0)[:2] == pytest.approx(at, abs=1e-5)
    assert reckoning.world_m(east, north) == pytest.approx(at, abs=1e-5)
    turned_rad = frame.to_heading_rad(at, yaw_rad) - (0.5 * math.pi - yaw_rad) - reckoning.north_rad(*at)
    assert math.remainder(turned_rad, math.tau) == pytest.approx(0.0, abs=RIGHT_ANGLES)
