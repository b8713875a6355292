"""Reads and sends the item lists of a vehicle, its fence and its mission, by the mission protocol.

As in a preparation, nothing here blocks: each generator yields what it waits for, and its caller decides how long.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.link import AUTOPILOT
from soter.adapters.mavlink.vehicle import EVERYBODY, Vehicle
from soter.errors import RobotUnavailable

FENCE: Final[int] = mav.MAV_MISSION_TYPE_FENCE
MISSION: Final[int] = mav.MAV_MISSION_TYPE_MISSION

_ASK_AGAIN_S: Final = 1.0
"""An autopilot asks again after about the same time; if both ask at once items are repeated, which does no harm."""

_GIVEN_UP_S: Final = 10.0
"""Autopilots give up an upload after 8 s; until then, to begin a new one would confuse them."""

_MOST: Final = 10_000
"""More items than any autopilot has room for: a larger count is ignored."""

_HEARD: Final = ("MISSION_COUNT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ITEM_INT", "MISSION_ACK")
_KEPT: Final = 1000
_RESULTS: Final = {
    value: entry.name.removeprefix("MAV_MISSION_") for value, entry in mav.enums["MAV_MISSION_RESULT"].items()
}
_BEGIN_ANEW: Final = (mav.MAV_MISSION_OPERATION_CANCELLED, mav.MAV_MISSION_INVALID_SEQUENCE)


class Item(NamedTuple):
    """One item of a list.

    Attributes:
        command: a MAV_CMD.
        params: the command's first four parameters.
        lat_e7: latitude in 1e-7 degrees.
        lon_e7: longitude in 1e-7 degrees.
        z: height in metres, in the frame.
        frame: a MAV_FRAME.
    """

    command: int
    params: tuple[float, float, float, float]
    lat_e7: int
    lon_e7: int
    z: float = 0.0
    frame: int = mav.MAV_FRAME_GLOBAL

    def means(self, other: Item) -> bool:
        """Return whether both items mean the same; height and frame, which have no meaning for a fence, are ignored."""
        return self[:4] == other[:4]


class ItemLists:
    """One vehicle's lists. The receiving thread calls the hook; all else belongs to the supervisor's thread."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle: Final = vehicle
        self._heard: Final[deque[Any]] = deque(maxlen=_KEPT)
        for name in _HEARD:
            vehicle.inbox.hooks[name] = partial(self._hear, name)

    def _hear(self, name: str, message: Any, _received_s: float) -> None:
        if message.target_system in (EVERYBODY, self._vehicle.link.system):
            self._heard.append((name, message))

    def _said(self, kind: int) -> tuple[str, Any] | None:
        """Return the next unread message about a list, as name and message; None if there is none."""
        while self._heard:
            name, message = self._heard.popleft()
            if message.mission_type == kind:
                return name, message
        return None

    def _send(self, name: str, kind: int, **fields: Any) -> None:
        vehicle = self._vehicle
        whom = {"target_system": vehicle.system, "target_component": AUTOPILOT, "mission_type": kind}
        vehicle.send(KEEPER, name, {**whom, **fields})

    def upload(self, kind: int, items: Sequence[Item]) -> Generator[str, None, None]:
        """Send a list, and end once the vehicle has accepted it.

        Raises:
            RobotUnavailable: the vehicle does not accept it.
        """
        if len(items) > _MOST:
            raise RobotUnavailable(f"a list of {len(items)} items is more than a vehicle can take; allowed: {_MOST}")
        vehicle, asked_s, given = self._vehicle, -math.inf, 0
        self._heard.clear()
        while True:
            if vehicle.now_s - asked_s >= (_GIVEN_UP_S if given else _ASK_AGAIN_S):
                asked_s, given = vehicle.now_s, 0
                self._send("MISSION_COUNT", kind, count=len(items))
            while (said := self._said(kind)) is not None:
                name, message = said
                if name.startswith("MISSION_REQUEST") and message.seq < len(items):
                    asked_s, given = vehicle.now_s, max(given, message.seq + 1)
                    self._send_item(kind, message.seq, items[message.seq])
                elif name == "MISSION_ACK" and message.type in _BEGIN_ANEW:
                    asked_s, given = -math.inf, 0
                elif name == "MISSION_ACK" and message.type != mav.MAV_MISSION_ACCEPTED:
                    result = _RESULTS.get(message.type, f"result {message.type}")
                    raise RobotUnavailable(f"it does not take a list of {len(items)} items: {result}")
                elif name == "MISSION_ACK" and given == len(items):
                    return
            yield f"it to take a list of {len(items)} items, of which it has asked for {given}"

    def _send_item(self, kind: int, seq: int, item: Item) -> None:
        values = {f"param{number}": value for number, value in enumerate(item.params, start=1)}
        self._send(
            "MISSION_ITEM_INT", kind, seq=seq, frame=item.frame, command=item.command, current=0, autocontinue=1,
            **values, x=item.lat_e7, y=item.lon_e7, z=item.z,
        )  # fmt: skip

    def download(self, kind: int) -> Generator[str, None, list[Item]]:
        """Ask for a list, and return it."""
        vehicle, asked_s, count = self._vehicle, -math.inf, None
        items: list[Item] = []
        self._heard.clear()
        while count is None or len(items) < count:
            if vehicle.now_s - asked_s >= _ASK_AGAIN_S:
                asked_s = vehicle.now_s
                if count is None:
                    self._send("MISSION_REQUEST_LIST", kind)
                else:
                    self._send("MISSION_REQUEST_INT", kind, seq=len(items))
            while (said := self._said(kind)) is not None:
                name, message = said
                if name == "MISSION_COUNT" and count is None and message.count <= _MOST:
                    count, asked_s = message.count, -math.inf
                elif name == "MISSION_ITEM_INT" and message.seq == len(items):
                    params = (message.param1, message.param2, message.param3, message.param4)
                    items.append(Item(message.command, params, message.x, message.y, message.z, message.frame))
                    asked_s = -math.inf
            yield f"item {len(items)} of {count} that it holds" if count else "it to tell the size of its list"
        self._send("MISSION_ACK", kind, type=mav.MAV_MISSION_ACCEPTED)
        return items
