"""One conversation over MAVLink 2: bytes to messages and back, signed or not, and what is sent unasked."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

logger = logging.getLogger(__name__)

_ROUNDING_S: Final = 1e-6
_SHORTEST_FRAME: Final = 8
_COMPONENT: Final = mav.MAV_COMP_ID_AUTOPILOT1
# Signatures count units of 10 microseconds from the start of 2015.
_SIGNING_EPOCH_S: Final = 1_420_070_400
_SIGNING_PER_S: Final = 100_000


class Source(NamedTuple):
    """Who sent a message.

    Attributes:
        system: its system id.
        component: its component id.
    """

    system: int
    component: int

    def __str__(self) -> str:
        return f"{self.system}/{self.component}"


class Streams:
    """How often one vehicle sends which messages to one channel.

    Args:
        hz: messages and how many a second, at first.
    """

    def __init__(self, hz: dict[int, float]) -> None:
        self.period_s: Final = {message_id: 1.0 / each for message_id, each in hz.items()}
        self._due_s: Final[dict[int, float]] = {}

    def set(self, message_id: int, period_s: float | None) -> None:
        """Send a message once in `period_s` of vehicle time from now on; None: not at all."""
        self._due_s.pop(message_id, None)
        if period_s is None:
            self.period_s.pop(message_id, None)
        else:
            self.period_s[message_id] = period_s

    def due(self, now_s: float) -> Iterator[int]:
        """Yield the messages that are due at the vehicle's time `now_s`."""
        for message_id, period_s in self.period_s.items():
            due_s = self._due_s.get(message_id, now_s)
            if due_s <= now_s + _ROUNDING_S:
                # Kept in step, unless it is behind (a clock that was set, a period longer than was asked for).
                next_s = due_s + period_s
                self._due_s[message_id] = next_s if next_s > now_s + _ROUNDING_S else now_s + period_s
                yield message_id


class Channel:
    """A peer on the other side of a link, and the vehicles' conversation with it.

    Args:
        write: takes a packet; must not block.
        key: of 32 bytes: sign what is sent, and drop what is not signed with it.
        datagrams: the bytes come in datagrams, each of whole packets; else as a stream.

    Attributes:
        streams: by vehicle, what is sent unasked.
    """

    def __init__(self, write: Callable[[bytes], None], key: bytes | None, *, datagrams: bool) -> None:
        self._write = write
        self._key = key
        self._datagrams = datagrams
        self._parser = mav.MAVLink(None)
        self._parser.robust_parsing = True
        if key is not None:
            self._parser.signing.secret_key = key
            self._parser.signing.timestamp = _signing_time()
        self._senders: dict[int, mav.MAVLink] = {}
        self.streams: Final[dict[int, Streams]] = {}
        self.closed = False

    def parse(self, data: bytes) -> Iterator[tuple[Source, mav.MAVLink_message]]:
        """Yield the messages in what was received; what is damaged, unknown or wrongly signed is dropped."""
        parser = self._parser
        try:
            messages = parser.parse_buffer(data) or ()
        except Exception:
            # What it could not read would be read again with what comes next.
            self._forget()
            logger.exception("dropped: %d bytes", len(data))
            return
        for message in messages:
            name = message.get_type()
            if name == "BAD_DATA":
                logger.debug("dropped: %s", message.reason)
            elif not name.startswith("UNKNOWN"):
                yield Source(message.get_srcSystem(), message.get_srcComponent()), message
        if self._datagrams:
            # Half a packet must not swallow the next datagram.
            self._forget()
        else:
            # It keeps all that it has read until a message ends where a packet does, which need never be.
            del parser.buf[: parser.buf_index]
            parser.buf_index = 0

    def _forget(self) -> None:
        parser = self._parser
        parser.buf, parser.buf_index, parser.expected_length = bytearray(), 0, _SHORTEST_FRAME

    def send(self, system_id: int, message: mav.MAVLink_message) -> None:
        """Send a message in the name of a vehicle."""
        sender = self._senders.get(system_id)
        if sender is None:
            sender = self._senders[system_id] = mav.MAVLink(None, system_id, _COMPONENT)
            if self._key is not None:
                sender.signing.secret_key = self._key
                sender.signing.sign_outgoing = True
                sender.signing.timestamp = _signing_time()
        packet = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        self._write(packet)


def _signing_time() -> int:
    return int((time.time() - _SIGNING_EPOCH_S) * _SIGNING_PER_S)
