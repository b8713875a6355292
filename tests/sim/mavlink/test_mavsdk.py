"""The vehicles as MAVSDK sees them: a client that was written for real ones."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from mavsdk import Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.action import Action, ActionResult
from mavsdk.plugins.telemetry import LandedState, Telemetry

from soter_sim.mavlink.frames import Origin
from tests.sim.mavlink.client import HOST
from tests.sim.mavlink.programs import vehicles
from tests.waiting import eventually

SPEEDUP = 5


@contextmanager
def connected(kind: str, vehicle: str) -> Iterator[tuple[Action, Telemetry]]:
    """Start vehicles and connect to the first that is heard."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        port = 0 if kind == "tcp" else int(probe.getsockname()[1])
    options = [f"--{kind}", str(port), "--vehicle", vehicle, "--speedup", str(SPEEDUP)]
    with vehicles(*options) as (_, ready):
        port = int(ready["links"][0].split(":")[2])
        configuration = Configuration.create_manual(245, 190, True)
        mavsdk = Mavsdk(configuration)
        try:
            scheme = "tcpout" if kind == "tcp" else "udpin"
            assert mavsdk.add_any_connection(f"{scheme}://{HOST}:{port}") == ConnectionResult.SUCCESS
            system = mavsdk.first_autopilot(10.0)
            assert system is not None
            telemetry = Telemetry(system)
            for set_rate in (
                telemetry.set_rate_position,
                telemetry.set_rate_position_velocity_ned,
                telemetry.set_rate_landed_state,
                telemetry.set_rate_battery,
                telemetry.set_rate_health,
                telemetry.set_rate_home,
            ):
                set_rate(10.0)
            assert eventually(telemetry.health_all_ok)
            assert eventually(lambda: telemetry.position().relative_altitude_m == 0.0)
            yield Action(system), telemetry
        finally:
            mavsdk.destroy()
            configuration.destroy()


def north_east(telemetry: Telemetry) -> tuple[float, float]:
    """Where the vehicle says that it is."""
    position = telemetry.position_velocity_ned().position
    return position.north_m, position.east_m


def somewhere_near(telemetry: Telemetry) -> tuple[float, float, float, float]:
    """A place one metre north-east of the vehicle: north, east, latitude, longitude."""
    assert eventually(lambda: math.isfinite(north_east(telemetry)[0]) and north_east(telemetry) != (0.0, 0.0))
    north_m, east_m = north_east(telemetry)
    lat_e7, lon_e7 = Origin().geodetic_e7(east_m + 0.7, north_m + 0.7)
    return north_m + 0.7, east_m + 0.7, lat_e7 / 1e7, lon_e7 / 1e7


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_a_copter_is_armed_takes_off_goes_somewhere_and_lands(kind: str) -> None:
    with connected(kind, "copter") as (action, telemetry):
        assert action.set_takeoff_altitude(1.5) == ActionResult.SUCCESS
        assert action.arm() == ActionResult.SUCCESS
        assert action.takeoff() == ActionResult.SUCCESS
        assert eventually(lambda: abs(telemetry.position().relative_altitude_m - 1.5) < 0.05)
        assert eventually(lambda: telemetry.landed_state() == LandedState.IN_AIR)
        north_m, east_m, lat_deg, lon_deg = somewhere_near(telemetry)
        altitude_m = telemetry.position().absolute_altitude_m
        assert action.goto_location(lat_deg, lon_deg, altitude_m, math.nan) == ActionResult.SUCCESS
        assert eventually(lambda: math.dist(north_east(telemetry), (north_m, east_m)) < 0.05)
        assert action.hold() == ActionResult.SUCCESS
        assert action.land() == ActionResult.SUCCESS
        assert eventually(lambda: not telemetry.armed())
        assert eventually(lambda: telemetry.landed_state() == LandedState.ON_GROUND)


def test_a_rover_is_armed_goes_somewhere_and_is_disarmed() -> None:
    with connected("udp", "rover") as (action, telemetry):
        assert action.arm() == ActionResult.SUCCESS
        assert eventually(telemetry.armed)
        north_m, east_m, lat_deg, lon_deg = somewhere_near(telemetry)
        assert action.goto_location(lat_deg, lon_deg, 488.0, math.nan) == ActionResult.SUCCESS
        assert eventually(lambda: math.dist(north_east(telemetry), (north_m, east_m)) < 0.05)
        assert eventually(lambda: telemetry.battery().remaining_percent > 0.0)
        assert action.hold() == ActionResult.SUCCESS
        assert action.disarm() == ActionResult.SUCCESS
        assert eventually(lambda: not telemetry.armed())
