"""The mission protocol: upload, download, clear, set the current item."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Channel, Source
from soter_sim.mavlink.commands import may_command
from soter_sim.mavlink.mission import MOST_ITEMS, Item
from soter_sim.mavlink.telemetry import Message

_ASK_AGAIN_S: Final = 1.0
_GIVE_UP_S: Final = 8.0
_E7: Final = 1e7
_DEGREES_MOST: Final = 180.0


@dataclass(slots=True)
class _Upload:
    channel: Channel
    by: Source
    count: int
    asked_s: float
    heard_s: float
    items: list[Item] = field(default_factory=list)


class MissionProtocol:
    """One vehicle's side of it. An upload that fails, or is given up, leaves the mission as it was.

    Args:
        autopilot: whose mission it is.
        transmit: sends a message to everybody.
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
        if kind != mav.MAV_MISSION_TYPE_MISSION:
            self._acknowledge(channel, by, mav.MAV_MISSION_UNSUPPORTED, kind)
        elif not may_command(self._autopilot, by) or (upload is not None and upload.by != by):
            self._acknowledge(channel, by, mav.MAV_MISSION_DENIED)
        elif message.count > MOST_ITEMS:
            self._acknowledge(channel, by, mav.MAV_MISSION_NO_SPACE)
        elif message.count == 0:
            self._finish(_Upload(channel, by, 0, now_s, now_s))
        else:
            self._upload = _Upload(channel, by, message.count, now_s, now_s)
            self._ask(self._upload)

    def item_int(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_ITEM_INT."""
        self._take(channel, by, message, message.x, message.y)

    def item_float(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_ITEM, which has degrees where the other has whole numbers."""
        for degrees, fault in (
            (message.x, mav.MAV_MISSION_INVALID_PARAM5_X),
            (message.y, mav.MAV_MISSION_INVALID_PARAM6_Y),
        ):
            # Written so that NaN fails too.
            if not -_DEGREES_MOST <= degrees <= _DEGREES_MOST:
                self._upload = None
                self._acknowledge(channel, by, fault)
                return
        self._take(channel, by, message, round(message.x * _E7), round(message.y * _E7))

    def _take(self, channel: Channel, by: Source, message: Message, x: int, y: int) -> None:
        upload = self._upload
        if upload is None or upload.by != by:
            self._acknowledge(channel, by, mav.MAV_MISSION_ERROR)
            return
        upload.heard_s = self._autopilot.now_s
        if message.seq > len(upload.items):
            self._acknowledge(channel, by, mav.MAV_MISSION_INVALID_SEQUENCE)
            return
        if message.seq == len(upload.items):
            params = (message.param1, message.param2, message.param3, message.param4)
            item = Item(message.frame, message.command, params, x, y, message.z, message.autocontinue)
            # The first is home, which the vehicle knows better.
            fault = item.fault(self._autopilot.kind, self._autopilot.origin) if message.seq else None
            if fault is not None:
                self._upload = None
                self._acknowledge(channel, by, fault)
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
            mav.MAVLink_mission_request_int_message(*upload.by, len(upload.items), mav.MAV_MISSION_TYPE_MISSION),
        )

    def _finish(self, upload: _Upload) -> None:
        self._upload = None
        self._autopilot.mission.replace(tuple(upload.items[1:]))
        self._acknowledge(upload.channel, upload.by, mav.MAV_MISSION_ACCEPTED)

    def look_after(self) -> None:
        """Ask again for an item that does not come, or give up; called once in each period."""
        upload, now_s = self._upload, self._autopilot.now_s
        if upload is None:
            return
        if upload.channel.closed or not 0.0 <= now_s - upload.heard_s < _GIVE_UP_S:
            self._upload = None
            self._acknowledge(upload.channel, upload.by, mav.MAV_MISSION_OPERATION_CANCELLED)
        elif now_s - upload.asked_s >= _ASK_AGAIN_S:
            self._ask(upload)

    # --- download -------------------------------------------------------------------------------------------

    def request_list(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_REQUEST_LIST: say how many items there are, home included."""
        kind, items = message.mission_type, self._autopilot.mission.items
        count = len(items) + 1 if items and kind == mav.MAV_MISSION_TYPE_MISSION else 0
        channel.send(self._autopilot.id, mav.MAVLink_mission_count_message(*by, count, kind))

    def request_int(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_REQUEST_INT."""
        item = self._asked_for(channel, by, message)
        if item is not None:
            current = int(message.seq != 0 and message.seq == self._autopilot.mission.current)
            channel.send(
                self._autopilot.id,
                mav.MAVLink_mission_item_int_message(
                    *by, message.seq, item.frame, item.command, current, item.autocontinue, *item.params,
                    item.x, item.y, item.z, mav.MAV_MISSION_TYPE_MISSION,
                ),
            )  # fmt: skip

    def request_float(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_REQUEST, the older form."""
        item = self._asked_for(channel, by, message)
        if item is not None:
            current = int(message.seq != 0 and message.seq == self._autopilot.mission.current)
            channel.send(
                self._autopilot.id,
                mav.MAVLink_mission_item_message(
                    *by, message.seq, item.frame, item.command, current, item.autocontinue, *item.params,
                    item.x / _E7, item.y / _E7, item.z, mav.MAV_MISSION_TYPE_MISSION,
                ),
            )  # fmt: skip

    def _asked_for(self, channel: Channel, by: Source, message: Message) -> Item | None:
        autopilot = self._autopilot
        if message.mission_type != mav.MAV_MISSION_TYPE_MISSION:
            self._acknowledge(channel, by, mav.MAV_MISSION_UNSUPPORTED, message.mission_type)
            return None
        if message.seq == 0 and autopilot.mission.items:
            x_m, y_m, z_m = autopilot.home or (0.0, 0.0, 0.0)
            lat_e7, lon_e7 = autopilot.origin.geodetic_e7(x_m, y_m)
            alt_m = autopilot.origin.alt_m + z_m
            nothing = (0.0, 0.0, 0.0, 0.0)
            return Item(mav.MAV_FRAME_GLOBAL, mav.MAV_CMD_NAV_WAYPOINT, nothing, lat_e7, lon_e7, alt_m, 1)
        item = autopilot.mission.item(message.seq)
        if item is None:
            self._acknowledge(channel, by, mav.MAV_MISSION_INVALID_SEQUENCE)
        return item

    # --- the rest -------------------------------------------------------------------------------------------

    def clear(self, channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_CLEAR_ALL."""
        result = mav.MAV_MISSION_ACCEPTED
        if not may_command(self._autopilot, by):
            result = mav.MAV_MISSION_DENIED
        elif message.mission_type in (mav.MAV_MISSION_TYPE_MISSION, mav.MAV_MISSION_TYPE_ALL):
            self._upload = None
            self._autopilot.mission.replace(())
        self._acknowledge(channel, by, result, message.mission_type)

    def set_current(self, _channel: Channel, by: Source, message: Message) -> None:
        """Take MISSION_SET_CURRENT: everybody is told the current item, which is the old one if that cannot be."""
        if may_command(self._autopilot, by) and not self._autopilot.mission.go_to(message.seq):
            self._autopilot.say(mav.MAV_SEVERITY_WARNING, f"Refused: no mission item {message.seq}")

    def _acknowledge(self, channel: Channel, to: Source, result: int, kind: int = mav.MAV_MISSION_TYPE_MISSION) -> None:
        channel.send(self._autopilot.id, mav.MAVLink_mission_ack_message(*to, result, kind))
