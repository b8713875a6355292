"""The parameter protocol: list, read, set."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import isfinite
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Channel, Source
from soter_sim.mavlink.commands import may_command
from soter_sim.mavlink.telemetry import Message

_LISTED_PER_PERIOD: Final = 10
_BY_NAME: Final = -1


class ParameterProtocol:
    """One vehicle's side of the parameter protocol.

    Args:
        autopilot: holds the parameters.
        transmit: broadcasts a message.
    """

    def __init__(self, autopilot: Autopilot, transmit: Callable[[Message], None]) -> None:
        self._autopilot = autopilot
        self._transmit = transmit
        self._wanted: deque[tuple[Channel, int]] = deque()

    def request_list(self, channel: Channel, _by: Source, _message: Message) -> None:
        """Take PARAM_REQUEST_LIST: send all parameters, a few in each period, so that none is lost."""
        self._wanted = deque(each for each in self._wanted if each[0] is not channel)
        self._wanted.extend((channel, index) for index in range(len(self._autopilot.parameters.names)))

    def request_read(self, channel: Channel, _by: Source, message: Message) -> None:
        """Take PARAM_REQUEST_READ; an unknown parameter is not answered."""
        names = self._autopilot.parameters.names
        if message.param_index == _BY_NAME:
            if message.param_id in names:
                channel.send(self._autopilot.id, self._value(names.index(message.param_id)))
        elif 0 <= message.param_index < len(names):
            channel.send(self._autopilot.id, self._value(message.param_index))

    def set(self, _channel: Channel, by: Source, message: Message) -> None:
        """Take PARAM_SET: broadcast the value, which is the old one if the new one is not allowed."""
        autopilot, name, value = self._autopilot, message.param_id, message.param_value
        if name not in autopilot.parameters.names:
            return
        if may_command(autopilot, by):
            # The value is a 32-bit float; round it to the digits that were meant.
            refusal = autopilot.parameters.set(name, float(f"{value:.7g}") if isfinite(value) else value)
            if refusal is not None:
                autopilot.say(mav.MAV_SEVERITY_WARNING, f"Refused: {refusal}")
        self._transmit(self._value(autopilot.parameters.names.index(name)))

    def send_due(self) -> None:
        """Go on sending a requested list; called once in each period."""
        for _ in range(min(_LISTED_PER_PERIOD, len(self._wanted))):
            channel, index = self._wanted.popleft()
            if not channel.closed:
                channel.send(self._autopilot.id, self._value(index))

    def _value(self, index: int) -> Message:
        parameters = self._autopilot.parameters
        name = parameters.names[index]
        return mav.MAVLink_param_value_message(
            name.encode(), parameters[name], parameters.known[name].mav_type, len(parameters.names), index
        )
