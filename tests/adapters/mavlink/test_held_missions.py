"""Missions that vehicles hold are read, as a ground station has sent them, and flown on any backend."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav
from typer.testing import CliRunner

from soter.adapters.mavlink.authority import COMPONENTS
from soter.adapters.mavlink.frames import GeoPoint, geodetic_e7
from soter.adapters.mavlink.held_missions import read_missions
from soter.adapters.mavlink.item_lists import MISSION, Item, ItemLists
from soter.adapters.mavlink.link import Inbox, MavlinkLink
from soter.adapters.mavlink.pymavlink_link import PymavlinkLink
from soter.adapters.mavlink.simulator import MavlinkSimulator, free_port
from soter.adapters.mavlink.transport import Address
from soter.adapters.mavlink.vehicle import Vehicle
from soter.cli import app
from soter.clock import VehicleClock
from soter.config import load_mission
from soter.errors import RobotUnavailable
from soter.runner import run_mission
from soter.sdk import HeldMission, RuleLimits
from soter.sdk.wire import describe
from soter_sim.mavlink import mission as simulated
from soter_sim.mavlink.frames import Origin
from tests.adapters.mavlink.virtual import VirtualBackend, VirtualConfig, Wire
from tests.adapters.velocity_controlled.driving import ROOM, SPECS
from tests.project.source import ROOT

EXAMPLES = ROOT / "examples"
WAYPOINT, SPEED = mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_DO_CHANGE_SPEED
RELATIVE = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
ORIGIN = GeoPoint(*Origin())


def item(command: int, x_m: float = math.nan, y_m: float = math.nan) -> Item:
    place = (0, 0) if math.isnan(x_m) else geodetic_e7(ORIGIN, x_m, y_m)
    return Item(command, (0.0, 0.0, 0.0, 0.0), *place, 0.0, RELATIVE)


PLAN = [item(WAYPOINT, 2.5, 2.5), item(SPEED), item(WAYPOINT, 0.5, 4.0), item(WAYPOINT)]


@contextmanager
def virtual(**given: Any) -> Iterator[tuple[Wire, MavlinkLink]]:
    """Vehicles in virtual time that hold the plan, and the link to them."""
    config = VirtualConfig(workspace=ROOM, **given)
    with VirtualBackend().open(config, SPECS) as fleet:
        for autopilot in VirtualBackend.wire.autopilots:
            autopilot.mission.replace(
                tuple(
                    simulated.Item(each.frame, each.command, each.params, each.lat_e7, each.lon_e7, each.z, 1)
                    for each in PLAN
                )
            )
        yield VirtualBackend.wire, fleet.robots[0]._vehicle.link  # type: ignore[attr-defined]


def test_places_are_kept_and_the_rest_is_named() -> None:
    with virtual() as (wire, link):
        held = read_missions(link, [1, 2], None, 10.0)
        assert not any(autopilot.armed for autopilot in wire.autopilots)
    assert [*held] == [1, 2]
    for each in held.values():
        assert [*each.points] == [pytest.approx(point, abs=0.007) for point in [(2.5, 2.5), (0.5, 4.0)]]
        # The last has no place: it means where the vehicle is.
        assert each.left_out == ("2: MAV_CMD_DO_CHANGE_SPEED", "4: MAV_CMD_NAV_WAYPOINT")


def test_places_are_seen_from_the_workspace() -> None:
    # A workspace whose origin lies 3 m east and 2 m north of the EKF's.
    lat_e7, lon_e7 = geodetic_e7(ORIGIN, 3.0, 2.0)
    with virtual() as (_, link):
        held = read_missions(link, [1], GeoPoint(lat_e7 / 1e7, lon_e7 / 1e7, 0.0), 10.0)
    assert [*held[1].points] == [pytest.approx(point, abs=0.01) for point in [(-0.5, 0.5), (-2.5, 2.0)]]


def test_a_place_that_is_farther_than_anything_is_left_out() -> None:
    # A plan of another site, or of another origin.
    with virtual() as (_, link):
        held = read_missions(link, [1], ORIGIN._replace(lat_deg=-33.9, lon_deg=151.2), 10.0)
    assert held[1].points == ()
    assert held[1].left_out[0].startswith("1: MAV_CMD_NAV_WAYPOINT, 1")
    assert held[1].left_out[0].endswith(" km away")


def test_a_vehicle_that_holds_nothing_holds_nothing() -> None:
    with virtual() as (wire, link):
        wire.autopilot(1).mission.replace(())
        assert read_missions(link, [1], None, 10.0) == {1: HeldMission(())}


def test_one_that_does_not_answer_is_named_in_time() -> None:
    with virtual() as (wire, link):
        wire.cut.add(2)
        with pytest.raises(RobotUnavailable, match="robot 2: within 5 s it lacked a heartbeat"):
            read_missions(link, [1, 2], None, 5.0)
        assert wire.host_s < 6.0


# --- the command, over a real wire -----------------------------------------------------------------------------


@pytest.fixture
def connection() -> Iterator[str]:
    """Where two vehicles are, of which the first one holds the plan."""
    port = free_port()
    with closing(MavlinkSimulator(describe(ROOM, SPECS, RuleLimits()), port, "--boot", "0.2")):
        address = Address("udpin", "127.0.0.1", port)
        with closing(PymavlinkLink(VehicleClock(), address, 255, COMPONENTS)) as link:
            link.inboxes[1] = Inbox()
            link.start()
            vehicle = Vehicle(link, 1)
            while vehicle.heartbeat is None:
                link.clock.sleep_until(link.clock.now() + 0.01)
            for _ in ItemLists(vehicle).upload(MISSION, [item(WAYPOINT, 0.0, 0.0), *PLAN]):
                link.clock.sleep_until(link.clock.now() + 0.01)
        yield str(address)


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_a_plan_is_downloaded_and_flown(backend: str, connection: str, tmp_path: Path) -> None:
    target, record = tmp_path / "flown.toml", tmp_path / "held.json"
    given = ["--backend", backend, "--set", f"backends.{backend}.connection={connection}"]
    source = str(EXAMPLES / "surveillance.toml")
    done = CliRunner().invoke(app, ["download", source, *given, "-o", str(target), "--json", str(record)])
    assert done.exit_code == 0, done.output
    assert "robot 2 holds no place to go to" in done.output
    assert "left out: 2: MAV_CMD_DO_CHANGE_SPEED" in done.output
    assert '"format": "soter-download"' in record.read_text()
    flown = load_mission(target, {"backend": "kinematic", "duration_s": 120.0})
    assert flown.options["robots"]["1"] == [pytest.approx(point, abs=0.007) for point in [(2.5, 2.5), (0.5, 4.0)]]
    result = run_mission(flown).result
    assert (result.status, result.violated, result.targets_reached) == ("completed", False, 2)


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        ({"--backend": "mavlink"}, "give a connection to some"),
        ({"--backend": "kinematic"}, "its robots hold no missions of their own"),
    ],
)
def test_where_there_is_no_mission_to_be_had_that_is_said(overrides: Mapping[str, str], says: str) -> None:
    words = [word for pair in overrides.items() for word in pair]
    done = CliRunner().invoke(app, ["download", str(EXAMPLES / "surveillance.toml"), *words])
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())
