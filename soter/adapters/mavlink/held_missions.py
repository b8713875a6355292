"""Reads the missions that ground stations have sent to vehicles, as places in the workspace."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.frames import GeoPoint, local_m
from soter.adapters.mavlink.item_lists import MISSION, Item, ItemLists
from soter.adapters.mavlink.link import MavlinkLink
from soter.adapters.mavlink.vehicle import Vehicle, place_of
from soter.errors import RobotUnavailable
from soter.geometry.earth import Projection
from soter.sdk import MAX_COORDINATE_M, HeldMission

_PLACES: Final = (
    mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_SPLINE_WAYPOINT, mav.MAV_CMD_NAV_LOITER_TIME,
    mav.MAV_CMD_NAV_LOITER_UNLIM,
)  # fmt: skip
_ON_EARTH: Final = (
    mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)  # fmt: skip
_LOOK_S: Final = 0.01
_ASK_S: Final = 1.0


def read_missions(
    link: MavlinkLink, robot_ids: Sequence[int], origin: GeoPoint | Projection | None, timeout_s: float
) -> dict[int, HeldMission]:
    """Return the missions that vehicles hold. Nothing else is asked of them, and nothing is armed.

    Args:
        link: started, with an inbox for each vehicle.
        robot_ids: the vehicles' ids.
        origin: of the workspace; None for the origin of each vehicle's EKF.
        timeout_s: for all vehicles together.

    Raises:
        RobotUnavailable: a vehicle does not answer in time.
    """
    clock, found = link.clock, dict[int, HeldMission]()
    asked = {robot_id: _asked(Vehicle(link, robot_id), origin) for robot_id in robot_ids}
    until_s, beaten_s = clock.steady_s() + timeout_s, -math.inf
    while asked:
        if clock.steady_s() - beaten_s >= _ASK_S:
            beaten_s = clock.steady_s()
            for robot_id in asked:
                link.beat(robot_id)
        for robot_id, steps in [*asked.items()]:
            try:
                lacks = next(steps)
            except StopIteration as end:
                found[robot_id] = end.value
                del asked[robot_id]
                continue
            if clock.steady_s() > until_s:
                raise RobotUnavailable(f"robot {robot_id}: within {timeout_s:g} s it lacked {lacks}")
        clock.sleep_until(clock.now() + _LOOK_S)
    return found


def _asked(vehicle: Vehicle, origin: GeoPoint | Projection | None) -> Generator[str, None, HeldMission]:
    while vehicle.heartbeat is None:
        yield "a heartbeat"
    asked_s = -math.inf
    while origin is None:
        said = vehicle.heard_since("GPS_GLOBAL_ORIGIN", -math.inf)
        origin = None if said is None else place_of(said)
        if origin is None:
            if vehicle.now_s - asked_s >= _ASK_S:
                asked_s = vehicle.now_s
                vehicle.ask_once(KEEPER, mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
            yield "the origin of its EKF"
    items = yield from ItemLists(vehicle).download(MISSION)
    # ArduPilot's first item is the home position.
    return _mission([*enumerate(items)][0 if vehicle.kind.is_px4 else 1 :], origin)


def _mission(items: Sequence[tuple[int, Item]], origin: GeoPoint | Projection) -> HeldMission:
    points, left_out = [], []
    for number, item in items:
        known = mav.enums["MAV_CMD"].get(item.command)
        said = f"{number}: {item.command if known is None else known.name}"
        if item.command not in _PLACES or item.frame not in _ON_EARTH or not (item.lat_e7 or item.lon_e7):
            left_out.append(said)
            continue
        point = local_m(origin, item.lat_e7, item.lon_e7)
        if max(map(abs, point)) <= MAX_COORDINATE_M:
            points.append(point)
        else:
            left_out.append(f"{said}, {math.hypot(*point) / 1000.0:.0f} km away")
    return HeldMission(tuple(points), tuple(left_out))
