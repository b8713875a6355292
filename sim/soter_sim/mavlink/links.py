"""Links to the vehicles: UDP towards a ground station, or a TCP server. On this host only."""

from __future__ import annotations

import logging
import selectors
import socket
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.channel import Channel, Source
from soter_sim.mavlink.stream import HOST, Connection, Server

logger = logging.getLogger(__name__)

_LARGEST: Final = 65536
_AT_ONCE: Final = 256

Hear = Callable[[Channel, Source, mav.MAVLink_message], None]
"""Takes a received message."""


class Link(Protocol):
    """A link: an address and its channels."""

    @property
    def address(self) -> str:
        """The address for a ground station, in pymavlink's form."""

    @property
    def channels(self) -> Iterable[Channel]:
        """The channels of the present peers."""

    def close(self) -> None:
        """Close the sockets."""


class UdpLink:
    """Sends to a port of this host on which a ground station listens, as ArduPilot's simulator does.

    Args:
        selector: calls registered callbacks when there is something to read.
        hear: takes the messages.
        port: the ground station's port.
        key: key for signing, or None.
    """

    def __init__(self, selector: selectors.BaseSelector, hear: Hear, port: int, key: bytes | None) -> None:
        self.address: Final = f"udpin:{HOST}:{port}"
        self._selector, self._hear = selector, hear
        self._peer = (HOST, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((HOST, 0))
        selector.register(self._socket, selectors.EVENT_READ, self._read)
        self.channels: Final = (Channel(self._write, key, datagrams=True),)

    def close(self) -> None:
        self._selector.unregister(self._socket)
        self._socket.close()

    def _write(self, packet: bytes) -> None:
        try:
            self._socket.sendto(packet, self._peer)
        except OSError as failure:
            # Nobody listens yet, or the buffer is full: a radio would lose it too.
            logger.debug("not sent: %s", failure)

    def _read(self, _events: int) -> None:
        (channel,) = self.channels
        # At most this many at a time, so that a flood cannot stop the world.
        for _ in range(_AT_ONCE):
            try:
                data, peer = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError as failure:
                # A packet to a port without a listener comes back as an error.
                logger.debug("not received: %s", failure)
                continue
            if peer == self._peer:
                for source, message in channel.parse(data):
                    self._hear(channel, source, message)


class TcpLink:
    """Listens on a port of this host for any number of ground stations.

    Args:
        selector: calls registered callbacks when there is something to read or room to write.
        hear: takes the messages.
        port: port to listen on; 0 for any free one.
        key: key for signing, or None.

    Raises:
        OSError: the port is taken.
    """

    def __init__(self, selector: selectors.BaseSelector, hear: Hear, port: int, key: bytes | None) -> None:
        self._hear, self._key = hear, key
        self._by_connection: dict[Connection, Channel] = {}
        self._server = Server(selector, port, opened=self._opened, received=self._received, gone=self._gone)
        self.address: Final = f"tcp:{HOST}:{self._server.port}"

    @property
    def channels(self) -> Iterable[Channel]:
        return tuple(self._by_connection.values())

    def close(self) -> None:
        self._server.close()

    def _opened(self, connection: Connection) -> None:
        self._by_connection[connection] = Channel(connection.write, self._key, datagrams=False)

    def _received(self, connection: Connection, data: bytes) -> None:
        channel = self._by_connection[connection]
        for source, message in channel.parse(data):
            self._hear(channel, source, message)

    def _gone(self, connection: Connection) -> None:
        self._by_connection.pop(connection).closed = True
