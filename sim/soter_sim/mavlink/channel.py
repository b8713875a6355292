"""One channel of MAVLink 2: bytes to messages and back, signed or not, and the streams sent on it."""

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
    """The sender of a message.

    Attributes:
        system: its system id.
        component: its component id.
    """

    system: int
    component: int

    def __str__(self) -> str:
        return f"{self.system}/{self.component}"


class Streams:
    """The streams of one vehicle on one channel: which messages it sends, and how often.

    Args:
        hz: by message, how many a second are sent at first.
    """

    def __init__(self, hz: dict[int, float]) -> None:
        self.period_s: Final = {message_id: 1.0 / each for message_id, each in hz.items()}
        self._due_s: Final[dict[int, float]] = {}

    def set(self, message_id: int, period_s: float | None) -> None:
        """Send a message every `period_s` of vehicle time from now on; None for never."""
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
                # Keep its phase, unless it is behind (a clock that was set, a control period longer than the interval).
                next_s = due_s + period_s
                self._due_s[message_id] = next_s if next_s > now_s + _ROUNDING_S else now_s + period_s
                yield message_id


class Channel:
    """A peer on the other side of a link, and the state of the connection with it.

    Args:
        write: takes a packet; must not block.
        key: key of 32 bytes that signs packets sent, and without whose signature received ones are dropped; or None.
        datagrams: whether bytes come in datagrams of whole packets; else as a stream.

    Attributes:
        streams: by vehicle, the messages that it sends unasked.
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
        """Yield the messages in received bytes; drop those that are damaged, unknown or wrongly signed."""
        parser = self._parser
        try:
            messages = parser.parse_buffer(data) or ()
        except Exception:
            # Otherwise the parser would read the same bytes again with the next ones.
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
            # The parser keeps all bytes until a message ends where a packet does, which may never happen.
            del parser.buf[: parser.buf_index]
            parser.buf_index = 0

    def _forget(self) -> None:
        parser = self._parser
        parser.buf, parser.buf_index, parser.expected_length = bytearray(), 0, _SHORTEST_FRAME

    def send(self, system_id: int, message: mav.MAVLink_message) -> None:
        """Send a message of a vehicle."""
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
