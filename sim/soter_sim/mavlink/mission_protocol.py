"""The mission protocol, for missions and for fences: upload, download, clear, set the current item."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Channel, Source
from soter_sim.mavlink.commands import may_command
from soter_sim.mavlink.fence import Fence
from soter_sim.mavlink.mission import MOST_ITEMS, Item
from soter_sim.mavlink.telemetry import Message

_ASK_AGAIN_S: Final = 1.0
_GIVE_UP_S: Final = 8.0
_E7: Final = 1e7
_DEGREES_MOST: Final = 180.0
_MISSION: Final[int] = mav.MAV_MISSION_TYPE_MISSION
_FENCE: Final[int] = mav.MAV_MISSION_TYPE_FENCE


@dataclass(slots=True)
class _Upload:
    channel: Channel
    by: Source
    kind: int
    count: int
    asked_s: float
    heard_s: float
    items: list[Item] = field(default_factory=list)


class MissionProtocol:
    """One vehicle's side of the mission protocol. An upload that fails, or is given up, changes nothing.

    Args:
        autopilot: holds the mission and the fence.
        transmit: broadcasts a message.
    """

    def __init__(self, autopilot: Autopilot, transmit: Callable[[Message], None]) -> None:
        self._autopilot = autopilot
        self._transmit = transmit
        self._upload: _Upload | None = None

    # --- upload ---------------------------------------------------------------------------------------------

    def count(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_COUNT: the beginning of an upload."""
        kind, now_s = message.mission_type, self._autopilot.now_s
        upload = self._upload
        if kind not in (_MISSION, _FENCE):
            self._acknowledge(channel, by, mav.MAV_MISSION_UNSUPPORTED, kind)
        elif not may_command(self._autopilot, by) or (upload is not None and upload.by != by):
            self._acknowledge(channel, by, mav.MAV_MISSION_DENIED, kind)
        elif message.count > MOST_ITEMS:
            self._acknowledge(channel, by, mav.MAV_MISSION_NO_SPACE, kind)
        elif message.count == 0:
            self._finish(_Upload(channel, by, kind, 0, now_s, now_s))
        else:
            self._upload = _Upload(channel, by, kind, message.count, now_s, now_s)
            self._ask(self._upload)

    def item_int(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_ITEM_INT."""
        self._take(channel, by, message, message.x, message.y)

    def item_float(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_ITEM, which has degrees as floats instead of whole numbers."""
        for degrees, fault in (
            (message.x, mav.MAV_MISSION_INVALID_PARAM5_X),
            (message.y, mav.MAV_MISSION_INVALID_PARAM6_Y),
        ):
            # Written so that NaN fails too.
            if not -_DEGREES_MOST <= degrees <= _DEGREES_MOST:
                self._upload = None
                self._acknowledge(channel, by, fault, message.mission_type)
                return
        self._take(channel, by, message, round(message.x * _E7), round(message.y * _E7))

    def _take(self, channel: Channel, by: Source, message: Message, x: int, y: int) -> None:
        upload = self._upload
        if upload is None or (upload.by, upload.kind) != (by, message.mission_type):
            self._acknowledge(channel, by, mav.MAV_MISSION_ERROR, message.mission_type)
            return
        upload.heard_s = self._autopilot.now_s
        if message.seq > len(upload.items):
            self._acknowledge(channel, by, mav.MAV_MISSION_INVALID_SEQUENCE, upload.kind)
            return
        if message.seq == len(upload.items):
            params = (message.param1, message.param2, message.param3, message.param4)
            item = Item(message.frame, message.command, params, x, y, message.z, message.autocontinue)
            # A mission's first item is home, which is ignored; a fence is checked as a whole.
            looked_at = upload.kind == _MISSION and message.seq
            fault = item.fault(self._autopilot.kind, self._autopilot.origin) if looked_at else None
            if fault is not None:
                self._upload = None
                self._acknowledge(channel, by, fault, upload.kind)
                return
            upload.items.append(item)
        if len(upload.items) == upload.count:
            self._finish(upload)
        else:
            self._ask(upload)

    def _ask(self, upload: _Upload) -> None:
        upload.asked_s = self._autopilot.now_s
        upload.channel.send(
            self._autopilot.id,
            mav.MAVLink_mission_request_int_message(*upload.by, len(upload.items), upload.kind),
        )

    def _finish(self, upload: _Upload) -> None:
        self._upload = None
        fault = Fence.fault(upload.items) if upload.kind == _FENCE else None
        if fault is None:
            self._replace(upload.kind, tuple(upload.items))
        self._acknowledge(upload.channel, upload.by, mav.MAV_MISSION_ACCEPTED if fault is None else fault, upload.kind)

    def _replace(self, kind: int, items: tuple[Item, ...]) -> None:
        if kind == _FENCE:
            self._autopilot.fence.items = items
        else:
            self._autopilot.mission.replace(items[1:])

    def look_after(self) -> None:
        """Request a missing item again, or give up; called once in each period."""
        upload, now_s = self._upload, self._autopilot.now_s
        if upload is None:
            return
        if upload.channel.closed or not 0.0 <= now_s - upload.heard_s < _GIVE_UP_S:
            self._upload = None
            self._acknowledge(upload.channel, upload.by, mav.MAV_MISSION_OPERATION_CANCELLED, upload.kind)
        elif now_s - upload.asked_s >= _ASK_AGAIN_S:
            self._ask(upload)

    # --- download -------------------------------------------------------------------------------------------

    def request_list(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_REQUEST_LIST: send the number of items, home included."""
        kind = message.mission_type
        channel.send(self._autopilot.id, mav.MAVLink_mission_count_message(*by, len(self._held(kind)), kind))

    def request_int(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_REQUEST_INT."""
        self._send_asked_for(channel, by, message, mav.MAVLink_mission_item_int_message)

    def request_float(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_REQUEST, the older form."""
        self._send_asked_for(channel, by, message, mav.MAVLink_mission_item_message, _E7)

    def _send_asked_for(
        self, channel: Channel, by: Source, message: Message, build: Callable[..., Message], unit: float | None = None
    ) -> None:
        """Send the requested item; its place in 1e-7 degrees, or in a unit of this many of them."""
        item = self._asked_for(channel, by, message)
        if item is not None:
            x, y = (item.x, item.y) if unit is None else (item.x / unit, item.y / unit)
            channel.send(self._autopilot.id, build(
                *by, message.seq, item.frame, item.command, self._is_current(message), item.autocontinue, *item.params,
                x, y, item.z, message.mission_type,
            ))  # fmt: skip

    def _asked_for(self, channel: Channel, by: Source, message: Message) -> Item | None:
        kind = message.mission_type
        if kind not in (_MISSION, _FENCE):
            self._acknowledge(channel, by, mav.MAV_MISSION_UNSUPPORTED, kind)
            return None
        held = self._held(kind)
        if message.seq >= len(held):
            self._acknowledge(channel, by, mav.MAV_MISSION_INVALID_SEQUENCE, kind)
            return None
        return held[int(message.seq)]

    def _held(self, kind: int) -> Sequence[Item]:
        """Return the vehicle's items of a kind, numbered as in messages: a mission begins with home."""
        autopilot = self._autopilot
        if kind == _FENCE:
            return autopilot.fence.items
        if kind != _MISSION or not autopilot.mission.items:
            return ()
        x_m, y_m, z_m = autopilot.home or (0.0, 0.0, 0.0)
        lat_e7, lon_e7 = autopilot.origin.geodetic_e7(x_m, y_m)
        alt_m, nothing = autopilot.origin.alt_m + z_m, (0.0, 0.0, 0.0, 0.0)
        home = Item(mav.MAV_FRAME_GLOBAL, mav.MAV_CMD_NAV_WAYPOINT, nothing, lat_e7, lon_e7, alt_m, 1)
        return home, *autopilot.mission.items

    def _is_current(self, message: Message) -> int:
        of_mission = message.mission_type == _MISSION and message.seq != 0
        return int(of_mission and message.seq == self._autopilot.mission.current)

    # --- the rest -------------------------------------------------------------------------------------------

    def clear(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_CLEAR_ALL."""
        result = mav.MAV_MISSION_ACCEPTED
        if not may_command(self._autopilot, by):
            result = mav.MAV_MISSION_DENIED
        else:
            for kind in (_MISSION, _FENCE):
                if message.mission_type in (kind, mav.MAV_MISSION_TYPE_ALL):
                    self._upload = None
                    self._replace(kind, ())
        self._acknowledge(channel, by, result, message.mission_type)

    def set_current(self, _channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_SET_CURRENT: broadcast the current item, which is the old one if the request is refused."""
        if may_command(self._autopilot, by) and not self._autopilot.mission.go_to(message.seq):
            self._autopilot.say(mav.MAV_SEVERITY_WARNING, f"Refused: no mission item {message.seq}")

    def _acknowledge(self, channel: Channel, to: Source, result: int, kind: int) -> None:
        channel.send(self._autopilot.id, mav.MAVLink_mission_ack_message(*to, result, kind))
