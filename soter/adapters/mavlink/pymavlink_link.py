"""MAVLink 2 by pymavlink: one thread receives and decodes; sending is done in the caller's thread."""

from __future__ import annotations

import hashlib
import logging
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.link import AUTOPILOT, DuplicateVehicle, Fields, Inbox, MavlinkLink
from soter.adapters.mavlink.transport import Address, Peer, Transport, open_transport
from soter.clock import Clock

logger = logging.getLogger(__name__)

SILENT_S: Final = 2.0
"""A vehicle silent for this time may come back from another address, as it does after a restart."""

_WAIT_S: Final = 0.05
_CLOSE_S: Final = 2.0
_TYPES: Final[Mapping[int, Any]] = mav.mavlink_map
_MESSAGES: Final = {each.msgname: each for each in _TYPES.values()}
_HEARTBEAT: Final[Fields] = {
    "type": mav.MAV_TYPE_GCS,
    "autopilot": mav.MAV_AUTOPILOT_INVALID,
    "base_mode": 0,
    "custom_mode": 0,
    "system_status": mav.MAV_STATE_ACTIVE,
    "mavlink_version": 3,
}

# Bytes of a MAVLink 1 and 2 frame besides the payload, and of a signature.
_MAVLINK_1: Final = 0xFE
_MAVLINK_2: Final = 0xFD
_EXTRA_1: Final = 8
_EXTRA_2: Final = 12
_SIGNATURE: Final = 13
_SHORTEST_FRAME: Final = _EXTRA_1

# Signatures count units of 10 microseconds from the start of 2015.
_SIGNING_EPOCH_S: Final = 1_420_070_400
_SIGNING_PER_S: Final = 100_000


def signing_key(passphrase: str) -> bytes:
    """Return the key derived from a passphrase in the way of ground stations."""
    return hashlib.sha256(passphrase.encode()).digest()


class PymavlinkLink(MavlinkLink):
    """A link whose messages pymavlink packs and parses.

    Args:
        clock: gives the times at which messages are received.
        address: of the vehicles.
        system: our system id.
        components: our component ids; the first of them sends heartbeats.
        key: 32 bytes that sign everything sent; messages not signed with them are dropped. None: nothing is signed.
    """

    def __init__(
        self, clock: Clock, address: Address, system: int, components: Sequence[int], key: bytes | None = None
    ) -> None:
        super().__init__(clock, system)
        self._address: Final = address
        self._key: Final = key
        self._voice: Final = components[0]
        self._senders: Final = {component: _codec(system, component, key) for component in components}
        self._peers: Final[dict[int, tuple[Peer, float]]] = {}
        self._parser: Final = _codec(0, 0, key)
        self._done: Final = threading.Event()
        self._transport: Transport | None = None
        self._thread: Final = threading.Thread(target=self._run, name="mavlink-link", daemon=True)

    def start(self) -> None:
        self._transport = open_transport(self._address)
        self._thread.start()

    def beat(self, system: int) -> None:
        self._send(system, self._voice, "HEARTBEAT", _HEARTBEAT)

    def close(self) -> None:
        self._done.set()
        if self._transport is not None:
            self._thread.join(_CLOSE_S)
            self._transport.close()
            self._transport = None

    def _send(self, system: int, component: int, name: str, fields: Fields) -> None:
        transport, sender = self._transport, self._senders[component]
        if transport is None:
            return
        values = {key: value.encode() if isinstance(value, str) else value for key, value in fields.items()}
        packet = _MESSAGES[name](**values).pack(sender)
        sender.seq = (sender.seq + 1) % 256
        agreed = self._peers.get(system)
        transport.send(packet, None if agreed is None else agreed[0])

    # --- the receiving thread ------------------------------------------------------------------------------

    def _run(self) -> None:
        transport = self._transport
        assert transport is not None
        while not self._done.is_set():
            for data, peer in transport.receive(_WAIT_S):
                try:
                    self._take(data, peer)
                except Exception as failure:  # noqa: BLE001 - it is noted
                    self._dropped(f"a packet from {_place(peer)}", failure)

    def _take(self, data: bytes, peer: Peer) -> None:
        received_s = self.clock.steady_s()
        inboxes = self.inboxes
        for message in self._stream(data) if peer is None else self._frames(data):
            name, header = message.msgname, message._header
            if header.srcComponent != AUTOPILOT or name not in _MESSAGES:
                continue
            inbox: Inbox | None = inboxes.get(header.srcSystem)
            if inbox is None:
                self.strangers.add(header.srcSystem)
            elif self._agreed(header.srcSystem, peer, received_s):
                inbox.put(name, message, received_s)

    def _agreed(self, system: int, peer: Peer, received_s: float) -> bool:
        """Return whether a message is from the vehicle's address: the first one heard, until that has fallen silent."""
        agreed = self._peers.get(system)
        if agreed is not None and agreed[0] != peer and received_s - agreed[1] < SILENT_S:
            before = self.duplicates.get(system)
            found = self.duplicates[system] = DuplicateVehicle(
                _place(agreed[0]), _place(peer), 1 if before is None else before.messages + 1, received_s
            )
            if before is None:
                logger.warning(
                    "system %d: heard at %s, which is used, and at %s; unless it has been restarted these are two "
                    "vehicles: give each vehicle a system id of its own", system, found.agreed, found.other,
                )  # fmt: skip
            return False
        if agreed is not None and agreed[0] != peer:
            logger.warning("system %d: silent at %s, and now at %s", system, _place(agreed[0]), _place(peer))
        self._peers[system] = peer, received_s
        return True

    def _stream(self, data: bytes) -> Sequence[Any]:
        parser = self._parser
        try:
            return parser.parse_buffer(data) or ()
        finally:
            # The parser keeps its input until a message ends where a packet ends, which may never happen.
            del parser.buf[: parser.buf_index]
            parser.buf_index = 0

    def _frames(self, datagram: bytes) -> Iterator[Any]:
        """Yield the messages of a datagram. It holds whole frames: no search for a start, and nothing to keep."""
        decode, begin, size = self._parser.decode, 0, len(datagram)
        while size - begin > _SHORTEST_FRAME:
            magic, length = datagram[begin], datagram[begin + 1]
            signed = magic == _MAVLINK_2 and datagram[begin + 2] & mav.MAVLINK_IFLAG_SIGNED
            end = begin + length + (_EXTRA_2 if magic == _MAVLINK_2 else _EXTRA_1) + (_SIGNATURE if signed else 0)
            if magic not in (_MAVLINK_1, _MAVLINK_2) or end > size:
                logger.debug("dropped: %d bytes that are no frame", size - begin)
                return
            try:
                yield decode(bytearray(datagram[begin:end]))
            except mav.MAVError as failure:
                logger.debug("dropped: %s", failure)
            begin = end


def _place(peer: Peer) -> str:
    return "the other end" if peer is None else f"{peer[0]}:{peer[1]}"


class _Codec(mav.MAVLink):
    """Packs and parses; ignores the time of a wrong signature: a forged one would make all later messages too old."""

    def check_signature(self, frame: bytearray, system: int, component: int) -> bool:
        """Return whether a frame was signed with our key, later than the one before."""
        stamps, sender = self.signing.stream_timestamps, (frame[-_SIGNATURE], system, component)
        before = stamps.get(sender)
        if super().check_signature(frame, system, component):
            return True
        if before is None:
            stamps.pop(sender, None)
        else:
            stamps[sender] = before
        return False


def _codec(system: int, component: int, key: bytes | None) -> mav.MAVLink:
    codec = _Codec(None, system, component)
    codec.robust_parsing = True
    if key is not None:
        codec.signing.secret_key = key
        codec.signing.sign_outgoing = True
        codec.signing.timestamp = int((time.time() - _SIGNING_EPOCH_S) * _SIGNING_PER_S)
    return codec
