"""TCP connections that never block: data that do not fit are dropped, and the world goes on."""

from __future__ import annotations

import logging
import selectors
import socket
from collections.abc import Callable
from typing import Final

logger = logging.getLogger(__name__)

HOST: Final = "127.0.0.1"
"""The only address that is used."""

_LARGEST: Final = 65536
_BUFFERED: Final = 1 << 16
_PENDING_MOST: Final = 1 << 16


class Connection:
    """One peer of a `Server`."""

    def __init__(self, server: Server, accepted: socket.socket) -> None:
        self._server = server
        self._socket = accepted
        self._pending = bytearray()
        accepted.setblocking(False)
        # A small buffer, so that a slow reader does not fall far behind.
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFERED)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        server.selector.register(accepted, selectors.EVENT_READ, self._ready)

    def write(self, data: bytes) -> None:
        """Send all of `data`, now or when there is room; drop all of it if the peer has not read for long."""
        if len(self._pending) > _PENDING_MOST or self._socket.fileno() < 0:
            return
        was_idle = not self._pending
        self._pending += data
        if was_idle:
            self._flush()

    def close(self) -> None:
        """Close the connection, and tell the server's owner. Idempotent."""
        if self._socket.fileno() >= 0:
            self._server.selector.unregister(self._socket)
            self._socket.close()
            self._server.gone(self)

    def _ready(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self._flush()
        if events & selectors.EVENT_READ and self._socket.fileno() >= 0:
            try:
                data = self._socket.recv(_LARGEST)
            except BlockingIOError:
                return
            except OSError as failure:
                logger.debug("a peer is gone: %s", failure)
                data = b""
            if data:
                self._server.received(self, data)
            else:
                self.close()

    def _flush(self) -> None:
        try:
            sent = self._socket.send(self._pending)
        except BlockingIOError:
            sent = 0
        except OSError as failure:
            logger.debug("a peer is gone: %s", failure)
            self.close()
            return
        del self._pending[:sent]
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if self._pending else 0)
        self._server.selector.modify(self._socket, events, self._ready)


class Server:
    """Listens on a port of this host.

    Args:
        selector: calls registered callbacks when there is something to read or room to write.
        port: port to listen on; 0 for any free one.
        opened: called with a new connection.
        received: called with a connection and the data received.
        gone: called with a connection that has ended.

    Attributes:
        port: the port that it listens on.

    Raises:
        OSError: the port is taken.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        port: int,
        *,
        opened: Callable[[Connection], None],
        received: Callable[[Connection, bytes], None],
        gone: Callable[[Connection], None],
    ) -> None:
        self.selector: Final = selector
        self.received: Final = received
        self._opened = opened
        self._gone = gone
        self._connections: list[Connection] = []
        try:
            self._socket = socket.create_server((HOST, port))
        except OSError as failure:
            raise OSError(
                f"port {port} of {HOST} cannot be listened on: {failure.strerror}; choose another"
            ) from failure
        self._socket.setblocking(False)
        self.port: Final[int] = self._socket.getsockname()[1]
        selector.register(self._socket, selectors.EVENT_READ, self._accept)

    def gone(self, connection: Connection) -> None:
        """Forget a connection that has ended."""
        self._connections.remove(connection)
        self._gone(connection)

    def close(self) -> None:
        """Close every connection, and stop listening."""
        for connection in [*self._connections]:
            connection.close()
        self.selector.unregister(self._socket)
        self._socket.close()

    def _accept(self, _events: int) -> None:
        try:
            accepted, _ = self._socket.accept()
        except OSError as failure:
            logger.debug("not accepted: %s", failure)
            return
        connection = Connection(self, accepted)
        self._connections.append(connection)
        self._opened(connection)
