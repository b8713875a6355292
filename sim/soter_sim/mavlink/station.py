"""One vehicle's messages: takes those that are for it, and sends those that are due."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Channel, Source, Streams
from soter_sim.mavlink.commands import DENIED, Command, carry_out, may_command, set_mode
from soter_sim.mavlink.failsafe import Failsafe
from soter_sim.mavlink.kinds import Mode
from soter_sim.mavlink.mission_protocol import MissionProtocol
from soter_sim.mavlink.parameter_protocol import ParameterProtocol
from soter_sim.mavlink.setpoint import Place, Velocity
from soter_sim.mavlink.targets import NotATarget, global_target, local_target
from soter_sim.mavlink.telemetry import BUILDERS, GROUPS, Message

_EVERYBODY: Final = 0

# MAVLink FTP: opcode and reason of a refusal, and the length of every packet.
_REFUSED: Final = 129
_NO_SUCH_OPERATION: Final = 7
_FILE_PAYLOAD: Final = 251


class Station:
    """Receives and sends the messages of an autopilot.

    Args:
        autopilot: the autopilot.
        channels: returns all channels.
        transmit: sends a message to all of them.
        most_hz: highest rate of a message.
        clock_s: returns the world's time, also between control periods.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        channels: Callable[[], Iterable[Channel]],
        transmit: Callable[[Message], None],
        most_hz: float,
        clock_s: Callable[[], float],
    ) -> None:
        self.autopilot: Final = autopilot
        self._channels = channels
        self._transmit = transmit
        self._most_hz = most_hz
        self._clock_s = clock_s
        self._booted_s = autopilot.booted_s
        self._parameters = ParameterProtocol(autopilot, transmit)
        self._mission = MissionProtocol(autopilot, transmit)
        self._failsafe = Failsafe(autopilot)
        self._announced: dict[int, tuple[int, ...]] = {}
        self._handlers: Final[dict[str, Callable[[Channel, Source, Message], None]]] = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._local_target,
            "SET_POSITION_TARGET_GLOBAL_INT": self._global_target,
            "HEARTBEAT": self._heartbeat,
            "REQUEST_DATA_STREAM": self._request_data_stream,
            "PARAM_REQUEST_LIST": self._parameters.request_list,
            "PARAM_REQUEST_READ": self._parameters.request_read,
            "PARAM_SET": self._parameters.set,
            "MISSION_COUNT": self._mission.count,
            "MISSION_ITEM_INT": self._mission.item_int,
            "MISSION_ITEM": self._mission.item_float,
            "MISSION_REQUEST_LIST": self._mission.request_list,
            "MISSION_REQUEST_INT": self._mission.request_int,
            "MISSION_REQUEST": self._mission.request_float,
            "MISSION_CLEAR_ALL": self._mission.clear,
            "MISSION_SET_CURRENT": self._mission.set_current,
            "FILE_TRANSFER_PROTOCOL": self._refuse_file,
            "TIMESYNC": self._timesync,
            "PING": self._ping,
        }

    def hear(self, channel: Channel, by: Source, message: Message) -> None:
        """Take a message; ignore those for others, and unknown ones."""
        handler = self._handlers.get(message.get_type())
        if handler is None or not self.autopilot.heard:
            return
        if getattr(message, "target_system", _EVERYBODY) in (_EVERYBODY, self.autopilot.id):
            self._open(channel)
            handler(channel, by, message)

    def tick(self, world_s: float) -> None:
        """Update the autopilot, and send the messages that are due; called after each control period."""
        autopilot = self.autopilot
        autopilot.tick(world_s)
        if autopilot.booted_s != self._booted_s:
            # A reboot forgets all requests.
            self._booted_s = autopilot.booted_s
            self._announced.clear()
            for channel in self._channels():
                channel.streams.pop(autopilot.id, None)
        if not autopilot.heard:
            return
        self._failsafe.look()
        self._mission.look_after()
        self._announce()
        for channel in self._channels():
            for message_id in self._open(channel).due(autopilot.now_s):
                message = BUILDERS[message_id](autopilot)
                if message is not None:
                    channel.send(autopilot.id, message)
        self._parameters.send_due()

    def _announce(self) -> None:
        """Broadcast changes that must not be known late."""
        autopilot = self.autopilot
        guided = autopilot.guided
        for message_id, value in (
            (mav.MAVLINK_MSG_ID_HEARTBEAT, (autopilot.kind.numbers[autopilot.mode], int(autopilot.armed))),
            (mav.MAVLINK_MSG_ID_NAMED_VALUE_INT, (*guided.master, int(guided.alive(autopilot.now_s)))),
            (mav.MAVLINK_MSG_ID_MISSION_CURRENT, (autopilot.mission.current, len(autopilot.mission.items))),
        ):
            known = self._announced.get(message_id, value)
            self._announced[message_id] = value
            message = BUILDERS[message_id](autopilot) if value != known else None
            if message is not None:
                self._transmit(message)

    def _open(self, channel: Channel) -> Streams:
        streams = channel.streams.get(self.autopilot.id)
        if streams is None:
            streams = channel.streams[self.autopilot.id] = Streams(dict(self.autopilot.kind.streams_hz))
        return streams

    # --- commands -------------------------------------------------------------------------------------------

    def _command_long(self, channel: Channel, by: Source, message: Message) -> None:
        params = (message.param1, message.param2, message.param3, message.param4)
        self._carry_out(
            Command(message.command, by, channel, params, message.param5, message.param6, message.param7, None)
        )

    def _command_int(self, channel: Channel, by: Source, message: Message) -> None:
        params = (message.param1, message.param2, message.param3, message.param4)
        self._carry_out(Command(message.command, by, channel, params, message.x, message.y, message.z, message.frame))

    def _carry_out(self, command: Command) -> None:
        result = carry_out(self.autopilot, command, self._most_hz)
        self._acknowledge(command.channel, command.by, command.number, result)
        # After the acknowledgement, as in autopilots.
        self._announce()

    def _acknowledge(self, channel: Channel, to: Source, number: int, result: int) -> None:
        channel.send(self.autopilot.id, mav.MAVLink_command_ack_message(number, result, 0, 0, *to))

    def _set_mode(self, channel: Channel, by: Source, message: Message) -> None:
        autopilot = self.autopilot
        stops = any(message.custom_mode == autopilot.kind.numbers[mode] for mode in autopilot.kind.stops)
        result = DENIED
        if message.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED and may_command(autopilot, by, stops=stops):
            result = set_mode(autopilot, message.custom_mode, f"asked for by {by}")
        self._acknowledge(channel, by, mav.MAVLINK_MSG_ID_SET_MODE, result)
        self._announce()

    # --- targets --------------------------------------------------------------------------------------------

    def _local_target(self, _channel: Channel, by: Source, message: Message) -> None:
        self._take_target(by, message, local_target)

    def _global_target(self, _channel: Channel, by: Source, message: Message) -> None:
        self._take_target(by, message, global_target)

    def _take_target(
        self, by: Source, message: Message, read: Callable[[Autopilot, Message], Place | Velocity]
    ) -> None:
        autopilot = self.autopilot
        autopilot.offboard.hear(autopilot.now_s)
        # A PX4 takes off by a target.
        grounded = autopilot.kind.flies and autopilot.landed and not autopilot.kind.is_px4
        # As on any autopilot, a target at the wrong time is not answered.
        if autopilot.mode is not Mode.GUIDED or not autopilot.armed or grounded:
            return
        try:
            target = read(autopilot, message)
        except NotATarget as failure:
            autopilot.say(mav.MAV_SEVERITY_WARNING, f"Ignored a target: {failure}")
            return
        autopilot.guided.give(by, target, autopilot.now_s, message.get_seq())

    # --- links ----------------------------------------------------------------------------------------------

    def _heartbeat(self, _channel: Channel, by: Source, _message: Message) -> None:
        self._failsafe.heard(by)

    def _request_data_stream(self, channel: Channel, _by: Source, message: Message) -> None:
        hz = min(float(message.req_message_rate), self._most_hz) if message.start_stop else 0.0
        streams = self._open(channel)
        for message_id in GROUPS.get(message.req_stream_id, ()):
            streams.set(message_id, 1.0 / hz if hz > 0.0 else None)

    def _refuse_file(self, channel: Channel, by: Source, message: Message) -> None:
        """Refuse a request for files, so that its sender does not wait for them."""
        seq, session, operation = struct.unpack_from("<HBB", bytes(message.payload))
        refusal = struct.pack(
            "<HBBBBBxIB", (seq + 1) % 65536, session, _REFUSED, 1, operation, 0, 0, _NO_SUCH_OPERATION
        )
        payload = refusal.ljust(_FILE_PAYLOAD, b"\0")
        channel.send(self.autopilot.id, mav.MAVLink_file_transfer_protocol_message(0, *by, payload))

    # --- time -----------------------------------------------------------------------------------------------

    def _timesync(self, channel: Channel, _by: Source, message: Message) -> None:
        if message.tc1 == 0:
            now_ns = round(1e9 * (self._clock_s() - self.autopilot.booted_s))
            channel.send(self.autopilot.id, mav.MAVLink_timesync_message(now_ns, message.ts1))

    def _ping(self, channel: Channel, by: Source, message: Message) -> None:
        if message.target_system == _EVERYBODY:
            channel.send(self.autopilot.id, mav.MAVLink_ping_message(message.time_usec, message.seq, *by))
