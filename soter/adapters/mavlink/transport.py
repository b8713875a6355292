"""Sends and receives bytes over UDP, TCP or a serial line. A bad link neither blocks nor raises.

A message is sent whole or dropped: the next message replaces it anyway.
"""

from __future__ import annotations

import errno
import ipaddress
import logging
import os
import select
import socket
import termios
import threading
import time
import tty
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

from soter.errors import RobotUnavailable

_KINDS: Final = ("udpin", "udpout", "tcp", "serial")
_FORMS: Final = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"


@dataclass(frozen=True, slots=True)
class Address:
    """The address of vehicles, such as `udpin:127.0.0.1:14550`, `tcp:HOST:PORT` or `serial:/dev/ttyACM0:57600`.

    Attributes:
        kind: "udpin" (they send to us), "udpout" (we send to them first), "tcp" (they listen) or "serial".
        host: a name or address; for "serial" the device.
        port: the port; for "serial" the baud rate.
    """

    kind: str
    host: str
    port: int

    @staticmethod
    def parse(text: str) -> Address:
        """Return the address of a connection string; MAVSDK's form, `udpin://HOST:PORT`, is read as well.

        Raises:
            ValueError: the text is no connection string; the message says what is allowed.
        """
        kind, _, rest = text.partition(":")
        host, _, number = rest.removeprefix("//").rpartition(":")
        if kind not in _KINDS or not host:
            raise ValueError(f"'{text}' is no connection, allowed: {_FORMS}")
        most = 4_000_000 if kind == "serial" else 65535
        if not (number.isascii() and number.isdecimal() and 1 <= int(number) <= most):
            what = "baud rate" if kind == "serial" else "port"
            raise ValueError(f"'{text}' has the {what} '{number}', allowed: 1 to {most}")
        return Address(kind, host, int(number))

    @property
    def is_local(self) -> bool:
        """Whether only this host, or the other end of a cable, can send on this connection."""
        if self.kind == "serial" or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"

    @property
    def mavsdk_url(self) -> str:
        """The address as MAVSDK writes it."""
        kind = "tcpout" if self.kind == "tcp" else self.kind
        return f"{kind}://{self.host}:{self.port}"


logger = logging.getLogger(__name__)

Peer = tuple[str, int] | None
"""The sender of a datagram; None on a stream, which has only one other end."""

_LARGEST: Final = 65536
_BUFFER_BYTES: Final = 1 << 20
_PENDING_MOST: Final = 1 << 14
_RETRY_S: Final = 0.5


class Transport(ABC):
    """One socket or line. `receive` is called by one thread, `send` by one other; `close` after both have ended."""

    @abstractmethod
    def receive(self, wait_s: float) -> list[tuple[bytes, Peer]]:
        """Wait at most `wait_s`, and return the data that has arrived; empty while there is no link."""

    @abstractmethod
    def send(self, packet: bytes, peer: Peer) -> None:
        """Send a packet if that is possible now."""

    @abstractmethod
    def close(self) -> None:
        """Close the socket or line. Idempotent."""


def open_transport(address: Address) -> Transport:
    """Open the transport of an address.

    Raises:
        RobotUnavailable: the address cannot be opened; a missing TCP server is no error, but tried again.
    """
    if address.kind in ("udpin", "udpout"):
        return UdpTransport(address)
    return StreamTransport(address)


class UdpTransport(Transport):
    """Datagrams on a socket that vehicles send to, or to an address on which they listen."""

    def __init__(self, address: Address) -> None:
        self._remote: Peer = None
        try:
            family, _, _, _, place = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as failure:
            raise RobotUnavailable(f"connection '{address}' cannot be opened: {failure}") from failure
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            if address.kind == "udpin":
                self._socket.bind(place)
            else:
                self._remote = (str(place[0]), int(place[1]))
        except OSError as failure:
            self._socket.close()
            advice = "; end the other program that listens there" if failure.errno == errno.EADDRINUSE else ""
            raise RobotUnavailable(f"connection '{address}' cannot be opened: {failure}{advice}") from failure

    def receive(self, wait_s: float) -> list[tuple[bytes, Peer]]:
        if not select.select([self._socket], [], [], wait_s)[0]:
            return []
        arrived: list[tuple[bytes, Peer]] = []
        while len(arrived) < 256:
            try:
                arrived.append(self._socket.recvfrom(_LARGEST))
            except BlockingIOError:
                break
            except OSError as failure:
                # A port without a listener answers with an error. A vehicle that comes back is heard again.
                logger.debug("not received: %s", failure)
        return arrived

    def send(self, packet: bytes, peer: Peer) -> None:
        to = peer or self._remote
        if to is None:
            return
        try:
            self._socket.sendto(packet, to)
        except OSError as failure:
            logger.debug("not sent: %s", failure)

    def close(self) -> None:
        self._socket.close()


class StreamTransport(Transport):
    """A TCP connection to a vehicle, or a serial line; opened again whenever it is lost.

    The receiving thread opens and closes; the sending one only uses what is open.
    """

    def __init__(self, address: Address) -> None:
        self._address = address
        self._line: _Line | None = None
        self._tried_s = -_RETRY_S

    def receive(self, wait_s: float) -> list[tuple[bytes, Peer]]:
        line = self._line
        if line is None:
            line = self._line = self._open(wait_s)
            if line is None:
                return []
        data = line.read(wait_s)
        if data is None:
            self._line = None
            line.close()
            return []
        return [(data, None)] if data else []

    def send(self, packet: bytes, peer: Peer) -> None:
        line = self._line
        if line is not None:
            line.write(packet)

    def close(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None

    def _open(self, wait_s: float) -> _Line | None:
        now_s = time.perf_counter()
        if now_s - self._tried_s < _RETRY_S:
            time.sleep(wait_s)
            return None
        self._tried_s = now_s
        try:
            if self._address.kind == "tcp":
                return _connected(self._address)
            return _serial(self._address)
        except OSError as failure:
            logger.debug("connection '%s' is not there: %s", self._address, failure)
            return None


class _Line:
    def __init__(self, descriptor: int) -> None:
        self._descriptor: Final = descriptor
        self._pending = b""
        self._broken = False
        # A descriptor that is closed during a write may by then belong to another file.
        self._lock: Final = threading.Lock()
        os.set_blocking(descriptor, False)

    def read(self, wait_s: float) -> bytes | None:
        """Return what has arrived; None if the line is lost."""
        if self._broken:
            return None
        if not select.select([self._descriptor], [], [], wait_s)[0]:
            return b""
        try:
            return os.read(self._descriptor, _LARGEST) or None
        except BlockingIOError:
            return b""
        except OSError as failure:
            logger.debug("not received: %s", failure)
            return None

    def write(self, packet: bytes) -> None:
        """Send a packet whole, or drop it."""
        with self._lock:
            if len(self._pending) > _PENDING_MOST or self._broken:
                return
            self._pending += packet
            try:
                self._pending = self._pending[os.write(self._descriptor, self._pending) :]
            except BlockingIOError:
                return
            except OSError as failure:
                logger.debug("not sent: %s", failure)
                # The receiving thread closes it.
                self._broken = True

    def close(self) -> None:
        with self._lock:
            self._broken = True
            os.close(self._descriptor)


def _connected(address: Address) -> _Line:
    connected = socket.create_connection((address.host, address.port), timeout=_RETRY_S)
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return _Line(connected.detach())


def _serial(address: Address) -> _Line:
    speed = getattr(termios, f"B{address.port}", None)
    if speed is None:
        raise OSError(f"{address.port} is no baud rate of this host")
    descriptor = os.open(address.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        tty.setraw(descriptor)
        settings = termios.tcgetattr(descriptor)
        settings[4] = settings[5] = speed
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)
    except termios.error as failure:
        os.close(descriptor)
        raise OSError(str(failure)) from failure
    return _Line(descriptor)
