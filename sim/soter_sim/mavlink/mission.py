"""The mission that a vehicle holds for AUTO."""

from __future__ import annotations

from math import isfinite
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.frames import Origin
from soter_sim.mavlink.kinds import Kind

MOST_ITEMS: Final = 700
"""Most items that an autopilot has room for."""

_RELATIVE: Final = frozenset({mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_ABSOLUTE: Final = frozenset({mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT})

_WITH_PLACE: Final = frozenset({mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_LOITER_TIME, mav.MAV_CMD_NAV_LAND})
_FOR_ALL: Final = frozenset({
    mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_LOITER_TIME, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mav.MAV_CMD_NAV_DELAY, mav.MAV_CMD_DO_CHANGE_SPEED,
})  # fmt: skip
_FOR_FLYING: Final = frozenset({mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_LAND})
_FARTHEST_M: Final = 25_000.0


class Item(NamedTuple):
    """One item, as received.

    Attributes:
        frame: frame of the place.
        command: its MAV_CMD.
        params: its first four parameters.
        x: latitude in 1e-7 degrees.
        y: longitude in 1e-7 degrees.
        z: height in metres.
        autocontinue: kept for downloads only.
    """

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int

    @property
    def has_place(self) -> bool:
        """Whether it names a place; 0, 0 means where the vehicle is."""
        return self.command in _WITH_PLACE and (self.x != 0 or self.y != 0)

    def place(self, origin: Origin) -> tuple[float, float, float]:
        """Return its place in metres east, north and up."""
        x_m, y_m = origin.local_m(self.x, self.y)
        return x_m, y_m, self.z - (origin.alt_m if self.frame in _ABSOLUTE else 0.0)

    def fault(self, kind: Kind, origin: Origin) -> int | None:
        """Return why a vehicle refuses it, as a MAV_MISSION_RESULT; None if it does not."""
        if self.command not in (_FOR_ALL | _FOR_FLYING if kind.flies else _FOR_ALL):
            return int(mav.MAV_MISSION_UNSUPPORTED)
        if self.frame not in _RELATIVE | _ABSOLUTE and (self.has_place or self.command == mav.MAV_CMD_NAV_TAKEOFF):
            return int(mav.MAV_MISSION_UNSUPPORTED_FRAME)
        for index, value in enumerate(self.params[:3]):
            if not isfinite(value):
                return int(mav.MAV_MISSION_INVALID_PARAM1) + index
        # The fourth is a yaw, for which NaN means any.
        if not isfinite(self.z):
            return int(mav.MAV_MISSION_INVALID_PARAM7)
        if self.has_place:
            x_m, y_m, _ = self.place(origin)
            if abs(x_m) > _FARTHEST_M:
                return int(mav.MAV_MISSION_INVALID_PARAM6_Y)
            if abs(y_m) > _FARTHEST_M:
                return int(mav.MAV_MISSION_INVALID_PARAM5_X)
        return None


class Mission:
    """The items, numbered from 1; number 0 is home, as in ArduPilot.

    Attributes:
        items: the items.
        current: the number of the item that AUTO executes, or will begin with.
    """

    def __init__(self) -> None:
        self.items: tuple[Item, ...] = ()
        self.current = 0

    def replace(self, items: tuple[Item, ...]) -> None:
        """Replace the mission, and start at its beginning."""
        self.items = items
        self.current = 0

    def item(self, seq: int) -> Item | None:
        """Return the item with this number, or None."""
        return self.items[seq - 1] if 1 <= seq <= len(self.items) else None

    def go_to(self, seq: int) -> bool:
        """Go on with another item; return False, and change nothing, if there is none with this number."""
        if seq != 0 and self.item(seq) is None:
            return False
        self.current = seq
        return True

    def begin(self) -> None:
        """Start over if all items are done, else go on at the current one."""
        if self.current > len(self.items):
            self.current = 0
