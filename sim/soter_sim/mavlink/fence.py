"""The fence that a vehicle holds, whoever commands it: polygons and circles, as in ArduPilot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.frames import Origin
from soter_sim.mavlink.mission import Item

_POLYGONS: Final = {
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES: Final = {
    mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}
_CORNERS_LEAST: Final = 3

AREAS: Final = 4
"""The bit of FENCE_TYPE for polygons and circles."""

FENCE: Final = "Fence"
"""Name of the fail-safe that takes over a vehicle outside its fence."""


class Fence:
    """A fence's items.

    Attributes:
        items: the items as received.
        enabled: whether the fence is checked.
    """

    def __init__(self) -> None:
        self.items: tuple[Item, ...] = ()
        self.enabled = False

    @staticmethod
    def fault(items: Sequence[Item]) -> int | None:
        """Return why a vehicle refuses items, as a MAV_MISSION_RESULT; None if it does not."""
        seq = 0
        while seq < len(items):
            item, first = items[seq], items[seq].params[0]
            if item.command in _CIRCLES:
                if not 0.0 < first < math.inf:
                    return int(mav.MAV_MISSION_INVALID_PARAM1)
                seq += 1
                continue
            if item.command not in _POLYGONS:
                return int(mav.MAV_MISSION_UNSUPPORTED)
            if not _CORNERS_LEAST <= first <= len(items) - seq or first != int(first):
                return int(mav.MAV_MISSION_INVALID_PARAM1)
            corners = items[seq : seq + int(first)]
            if any((each.command, each.params[0]) != (item.command, first) for each in corners):
                return int(mav.MAV_MISSION_INVALID)
            seq += int(first)
        return None

    def left(self, x_m: float, y_m: float, origin: Origin) -> bool:
        """Return whether a place is outside an inclusion area, or inside an exclusion area."""
        seq = 0
        while seq < len(self.items):
            item = self.items[seq]
            if item.command in _CIRCLES:
                inside = math.dist((x_m, y_m), origin.local_m(item.x, item.y)) <= item.params[0]
                wanted = _CIRCLES[item.command]
                seq += 1
            else:
                count = int(item.params[0])
                inside = _inside(x_m, y_m, [origin.local_m(each.x, each.y) for each in self.items[seq : seq + count]])
                wanted = _POLYGONS[item.command]
                seq += count
            if inside is not wanted:
                return True
        return False


def _inside(x_m: float, y_m: float, corners: Sequence[tuple[float, float]]) -> bool:
    """Return whether a ray from a place crosses a polygon's edges an odd number of times."""
    inside = False
    for (ax_m, ay_m), (bx_m, by_m) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (ay_m > y_m) != (by_m > y_m) and x_m < ax_m + (y_m - ay_m) / (by_m - ay_m) * (bx_m - ax_m):
            inside = not inside
    return inside
