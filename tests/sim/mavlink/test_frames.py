"""The frames of the wire and of the world."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter_sim.mavlink.frames import Origin, turned_rad, wrapped_rad
from tests.sim.mavlink.client import Rig

metres = st.floats(-5_000.0, 5_000.0)


@given(st.floats(-85.0, 85.0), st.floats(-179.0, 179.0), metres, metres)
def test_there_and_back_is_the_same_place(lat_deg: float, lon_deg: float, x_m: float, y_m: float) -> None:
    origin = Origin(lat_deg, lon_deg, 0.0)
    # A unit of 1e-7 degrees is 11 mm along a meridian.
    assert origin.local_m(*origin.geodetic_e7(x_m, y_m)) == pytest.approx((x_m, y_m), abs=0.006)


def test_east_is_longitude_and_north_is_latitude() -> None:
    origin = Origin(60.0, 10.0, 0.0)
    lat_e7, lon_e7 = origin.geodetic_e7(0.0, 1113.1884502145034)
    assert (lat_e7, lon_e7) == (600_100_000, 100_000_000)
    # A degree of longitude is half as long there.
    lat_e7, lon_e7 = origin.geodetic_e7(1113.1884502145034, 0.0)
    assert lat_e7 == 600_000_000
    assert lon_e7 == pytest.approx(100_200_000, abs=1)


@pytest.mark.parametrize(
    ("heading_rad", "yaw_rad"),
    [(0.0, 0.5 * math.pi), (0.5 * math.pi, 0.0), (math.pi, -0.5 * math.pi), (-0.5 * math.pi, math.pi)],
)
def test_headings_and_yaws(heading_rad: float, yaw_rad: float) -> None:
    assert turned_rad(heading_rad) == pytest.approx(yaw_rad)
    assert turned_rad(turned_rad(heading_rad)) == pytest.approx(heading_rad)


@given(st.floats(-100.0, 100.0))
def test_angles_are_wrapped_into_one_turn(angle_rad: float) -> None:
    wrapped = wrapped_rad(angle_rad)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - angle_rad) == pytest.approx(1.0)


def test_another_origin_is_what_the_vehicle_says() -> None:
    origin = Origin.read("-33.918861,18.4233,10")
    with Rig(origin=origin) as rig:
        rig.run(2.0)
        globe = rig.client.take("GLOBAL_POSITION_INT")[-1]
        assert origin.local_m(globe.lat, globe.lon) == pytest.approx((5.0, 5.0), abs=0.01)
        assert globe.alt == 10_000
        local = rig.client.take("LOCAL_POSITION_NED")[-1]
        assert (local.x, local.y) == pytest.approx((5.0, 5.0))
