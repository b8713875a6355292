"""The workspace as the vehicle's own fence: sent, read back, and in force. Simulated vehicles, in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.fence import fence_items
from soter.adapters.mavlink.frames import GeoPoint, geodetic_e7, local_m
from soter.adapters.mavlink.item_lists import FENCE, ItemLists
from soter.adapters.mavlink.options import MavlinkConfig
from soter.errors import RobotUnavailable
from soter.geometry.cells import pack
from soter.geometry.grid import GridMap
from soter.geometry.site import Site, SitePlan
from soter.sdk import Fleet
from soter_sim.mavlink.kinds import Mode
from tests.adapters.mavlink.virtual import VirtualBackend, VirtualConfig, Wire
from tests.adapters.velocity_controlled.driving import ROOM, SPECS

HERE = GeoPoint(-33.9, 151.2, 10.0)
ONE = ROOM.with_robots(1)
CORNERS = [(0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0)]


@contextmanager
def opened(happens: Callable[[Wire], object] = lambda _: None, **given: Any) -> Iterator[tuple[Fleet, Wire]]:
    config = VirtualConfig(workspace=ONE, upload_fence=True, **given)
    with VirtualBackend().open(config, SPECS[:1]) as fleet:
        wire = VirtualBackend.wire
        happens(wire)
        yield fleet, wire


def corners(wire: Wire) -> list[tuple[float, float]]:
    autopilot = wire.autopilot(1)
    return [autopilot.origin.local_m(item.x, item.y) for item in autopilot.fence.items]


@pytest.mark.parametrize("origin", [None, {"lat_deg": -33.9, "lon_deg": 179.99999, "alt_m": 10.0}])
@pytest.mark.parametrize("like", [None, "ardurover"])
def test_it_holds_the_workspace_and_looks_at_it(origin: dict[str, float] | None, like: str | None) -> None:
    noise = {"speed_noise_m_s": 0.15} if like else {}
    with opened(origin=origin, like=like, promise=noise) as (fleet, wire):
        fleet.robots[0].init(60.0)
        assert corners(wire) == [pytest.approx(corner, abs=0.007) for corner in CORNERS]
        assert wire.autopilot(1).fence.enabled
        assert wire.autopilot(1).armed


def test_it_stops_a_vehicle_that_somebody_else_sends_over_it() -> None:
    with opened() as (fleet, wire):
        robot = fleet.robots[0]
        robot.init(20.0)
        robot.close(5.0)
        # SOTER has let go of it.
        for number, *params in (
            (mav.MAV_CMD_DO_SET_MODE, 1.0, 15.0), (mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
        ):  # fmt: skip
            wire.command(1, number, *params)
        target = mav.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x0DF8, 2.5, -3.0, *[0.0] * 9)
        for _ in range(400):
            wire.other(target)
            wire.sleep(0.05)
        assert wire.autopilot(1).mode is Mode.HOLD
        assert -0.1 < wire.world.truth.pose(1)[0] < 0.0


def reports_only(wire: Wire) -> None:
    wire.autopilot(1).parameters.set("FENCE_ACTION", 0)


def ignores_polygons(wire: Wire) -> None:
    wire.autopilot(1).parameters.set("FENCE_TYPE", 3)


@pytest.mark.parametrize(
    ("happens", "says"),
    [
        (reports_only, r"its FENCE_ACTION is 0: .* or upload_fence = false"),
        (ignores_polygons, r"its FENCE_TYPE is 3: .* a sum with 4 in it"),
    ],
)
def test_a_fence_that_would_do_nothing_is_refused_before_anything_is_armed(
    happens: Callable[[Wire], object], says: str
) -> None:
    with opened(happens) as (fleet, wire):
        with pytest.raises(RobotUnavailable, match=says):
            fleet.robots[0].init(20.0)
        assert not wire.autopilot(1).armed


def test_a_fence_that_is_not_kept_as_it_was_sent_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened() as (fleet, wire):
        autopilot = wire.autopilot(1)

        class Coarse(type(autopilot.fence)):  # type: ignore[misc]
            """Keeps less than it was sent."""

            def __setattr__(self, name: str, value: Any) -> None:
                value = tuple(each._replace(x=each.x // 100 * 100) for each in value) if name == "items" else value
                super().__setattr__(name, value)

        monkeypatch.setattr(autopilot, "fence", Coarse())
        with pytest.raises(RobotUnavailable, match=r"it was sent a fence of 4 items, and holds another one, of 4"):
            fleet.robots[0].init(20.0)
        assert not autopilot.armed


def test_lost_messages_are_asked_for_again() -> None:
    lost: list[int] = []

    def loses(wire: Wire) -> None:
        station = wire._stations[0]
        for name in ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_INT", "MISSION_REQUEST_LIST"):
            handler = station._handlers[name]
            first: list[int] = []

            def once(*given: Any, handler: Any = handler, first: list[int] = first) -> None:
                first.append(1)
                if len(first) % 2:
                    lost.append(1)
                else:
                    handler(*given)

            station._handlers[name] = once

    with opened(loses) as (fleet, wire):
        fleet.robots[0].init(60.0)
        assert corners(wire) == [pytest.approx(corner, abs=0.007) for corner in CORNERS]
        assert len(lost) > 8


def test_who_holds_it_already_is_sent_nothing() -> None:
    sent: list[Any] = []

    def holds(wire: Wire) -> None:
        autopilot = wire.autopilot(1)
        autopilot.fence.items = tuple(autopilot_item(item) for item in fence_items(ONE, GeoPoint(*autopilot.origin)))
        station = wire._stations[0]
        station._handlers["MISSION_COUNT"] = lambda *given: sent.append(given)

    def autopilot_item(item: Any) -> Any:
        from soter_sim.mavlink.mission import Item

        return Item(item.frame, item.command, item.params, item.lat_e7, item.lon_e7, item.z, 1)

    with opened(holds) as (fleet, wire):
        fleet.robots[0].init(20.0)
        assert wire.autopilot(1).fence.enabled
    assert not sent


def test_it_is_read_back_once_in_each_life_of_the_vehicle() -> None:
    with opened() as (fleet, wire):
        robot, asked = fleet.robots[0], list[Any]()
        robot.init(20.0)
        handlers = wire._stations[0]._handlers
        read = handlers["MISSION_REQUEST_LIST"]

        def counted(*given: Any) -> None:
            asked.append(given)
            read(*given)

        handlers["MISSION_REQUEST_LIST"] = counted

        def live(seconds: float) -> None:
            for _ in range(round(seconds / 0.05)):
                robot.read_state()
                wire.sleep(0.05)

        wire.cut.add(1)
        live(5.0)
        wire.cut.clear()
        live(10.0)
        assert (robot._preparation.ready, asked) == (True, [])  # type: ignore[attr-defined]
        autopilot = wire.autopilot(1)
        autopilot.armed, autopilot.fence.items = False, ()
        assert autopilot.reboot() is None
        live(20.0)
        assert robot._preparation.ready  # type: ignore[attr-defined]
        assert asked
        assert len(autopilot.fence.items) == len(CORNERS)
        assert autopilot.fence.enabled


def test_after_a_reboot_that_moves_the_origin_it_is_where_it_was() -> None:
    with opened() as (fleet, wire):
        robot, autopilot = fleet.robots[0], wire.autopilot(1)
        robot.init(20.0)
        before = [(item.x, item.y) for item in autopilot.fence.items]
        autopilot.armed, autopilot.fence.items = False, ()
        autopilot.origin = autopilot.origin._replace(lat_deg=autopilot.origin.lat_deg + 2e-5)  # type: ignore[misc]
        assert autopilot.reboot() is None
        for _ in range(400):
            robot.read_state()
            wire.sleep(0.05)
        assert robot._preparation.ready  # type: ignore[attr-defined]
        assert [(item.x, item.y) for item in wire.autopilot(1).fence.items] == before


def test_of_a_map_exactly_what_is_occupied_is_kept_out() -> None:
    # A chess board, of which nothing can be put together.
    occupied = np.indices((100, 100)).sum(axis=0) % 2 == 1
    grid = GridMap(100, 100, 0.5, 0.0, 0.0, 0.0, pack(occupied))
    site = Site(SitePlan(fence=grid.ring(0, 0, 100, 100), around=(), areas=(), robots=ONE.robots, map=grid))
    items = fence_items(site, HERE)
    assert len(items) == 4 + 4 * np.count_nonzero(occupied)
    with opened() as (fleet, _), pytest.raises(RobotUnavailable, match=r"20004 items is more than .* allowed: 10000"):
        next(ItemLists(fleet.robots[0]._vehicle).upload(FENCE, items))  # type: ignore[attr-defined]


def test_a_workspace_without_any_boundary_has_no_fence() -> None:
    nothing = Site(SitePlan(fence=None, around=(), areas=(), robots=ONE.robots))
    with pytest.raises(ValidationError, match="neither an outer boundary nor keep-out areas"):
        MavlinkConfig(workspace=nothing, connection="udpin:127.0.0.1:14550", upload_fence=True)


@pytest.mark.parametrize("at", [(0.0, 0.0), (19.7, -3.4), (-10_000.0, 10_000.0)])
@pytest.mark.parametrize("lon_deg", [151.2, 179.99999, -180.0])
def test_places_go_to_the_earth_and_back(at: tuple[float, float], lon_deg: float) -> None:
    origin = HERE._replace(lon_deg=lon_deg)
    assert local_m(origin, *geodetic_e7(origin, *at)) == pytest.approx(at, abs=0.007)
