"""The vehicle's own fence: a second line of defence around the same workspace, in the vehicle itself.

It is the workspace's outer boundary and keep-out areas, without any margin: SOTER's own rules keep the vehicle off it,
and it acts if SOTER or the link has failed. An upload counts as done once the fence has been read back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.frames import GeoPoint, geodetic_e7
from soter.adapters.mavlink.item_lists import FENCE, Item, ItemLists
from soter.adapters.mavlink.vehicle import RETRY_S, Vehicle
from soter.errors import RobotUnavailable
from soter.geometry.earth import Projection
from soter.geometry.site import Site
from soter.geometry.workspace import Point, Workspace

_ALL: Final = -1
_AREAS: Final = 4

# By parameter: the bits of which at least one must be set, and why.
_ARDUPILOT: Final = {
    "FENCE_ACTION": (
        _ALL,
        "it would only report that it has left its fence; allowed: an action that stops it",
    ),
    "FENCE_TYPE": (_AREAS, "it would not look at polygons; allowed: a sum with 4 in it"),
}
_PX4: Final = {"GF_ACTION": (_ALL, "it would do nothing about its fence; allowed: an action that stops it")}


def fence_items(workspace: Workspace, origin: GeoPoint | Projection) -> list[Item]:
    """Return the fence of a workspace as the items that a vehicle takes.

    Args:
        workspace: of any shape.
        origin: the workspace's origin on earth, on the vehicle's own sphere; or the workspace's projection.
    """
    fence, keep_outs = workspace.outlines()
    if isinstance(workspace, Site) and workspace.plan.map is not None:
        # Outlines of a map are for display, and may reach into free space.
        keep_outs = workspace.plan.map.rings()
    rings = [] if fence is None else [(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, fence)]
    rings += [(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION, ring) for ring in keep_outs]
    return [item for command, ring in rings for item in _polygon(command, ring, origin)]


def _polygon(command: int, ring: Sequence[Point], origin: GeoPoint | Projection) -> Iterator[Item]:
    for x_m, y_m in ring:
        yield Item(command, (float(len(ring)), 0.0, 0.0, 0.0), *geodetic_e7(origin, x_m, y_m))


def put_up(
    vehicle: Vehicle,
    lists: ItemLists,
    items: Sequence[Item],
    parameter: Callable[[str], Generator[str, None, float | None]],
) -> Iterator[str]:
    """Upload a fence to a vehicle and enable it, step by step; yield what the step waits for.

    Nothing is sent to a vehicle that holds the fence already.

    Args:
        vehicle: the vehicle, heard of already.
        lists: its item lists.
        items: the fence.
        parameter: asks the vehicle for a parameter, and returns None if it does not answer.

    Raises:
        RobotUnavailable: the vehicle does not take the fence, does not hold it as sent, or would not act on it.
    """
    for name, (bits, why) in (_PX4 if vehicle.kind.is_px4 else _ARDUPILOT).items():
        value = yield from parameter(name)
        if value is not None and not (math.isfinite(value) and int(value) & bits):
            raise RobotUnavailable(f"its {name} is {value:g}: {why}, or upload_fence = false")
    held = yield from lists.download(FENCE)
    if not _same(held, items):
        yield from lists.upload(FENCE, items)
        held = yield from lists.download(FENCE)
        if not _same(held, items):
            raise RobotUnavailable(f"it was sent a fence of {len(items)} items, and holds another one, of {len(held)}")
    # PX4 enables a fence by itself.
    asked_s = -math.inf
    while not vehicle.kind.is_px4 and not _is_looked_at(vehicle):
        if vehicle.now_s - asked_s >= RETRY_S:
            asked_s = vehicle.now_s
            vehicle.command(KEEPER, mav.MAV_CMD_DO_FENCE_ENABLE, 1.0)
        yield "its fence to be on"


def _same(held: Sequence[Item], items: Sequence[Item]) -> bool:
    return len(held) == len(items) and all(map(Item.means, held, items))


def _is_looked_at(vehicle: Vehicle) -> bool:
    status = vehicle.heard_since("SYS_STATUS", -math.inf)
    return status is not None and bool(status.onboard_control_sensors_enabled & mav.MAV_SYS_STATUS_GEOFENCE)
