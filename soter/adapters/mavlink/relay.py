"""A bad link, for tests: a relay between an adapter and vehicles, datagram by datagram."""

from __future__ import annotations

import select
import socket
import threading
from contextlib import suppress
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.conformance import ImpairedRelay, Line

_HOST: Final = "127.0.0.1"
_LOOK_S: Final = 0.02
_LARGEST: Final = 65536
_SYSTEM_AT: Final = 5
_EVERYBODY: Final = 0


class Relay(ImpairedRelay):
    """Passes datagrams on, both ways. What is for everybody gets through to nobody while any vehicle is cut off.

    Args:
        adapter_port: on which the adapter listens.

    Attributes:
        port: to which the vehicles send.
    """

    def __init__(self, adapter_port: int) -> None:
        self._vehicles: Final = _bound()
        self._adapter: Final = _bound()
        self.port: Final[int] = self._vehicles.getsockname()[1]
        self._parser: Final = mav.MAVLink(None)
        self._parser.robust_parsing = True
        self._peer: tuple[str, int] | None = None
        # Vehicles share a link, so that they share its order too. Who is cut off is looked up in each datagram.
        self._up: Final = Line(_EVERYBODY, lambda datagram: _send(self._adapter, datagram, (_HOST, adapter_port)))
        self._down: Final = Line(_EVERYBODY, lambda datagram: _send(self._vehicles, datagram, self._peer))
        super().__init__()
        self._ended: Final = threading.Event()
        self._hearing: Final = threading.Thread(target=self._hear, name="mavlink-relay", daemon=True)
        self._hearing.start()

    def close(self) -> None:
        self._ended.set()
        self._hearing.join()
        super().close()
        self._vehicles.close()
        self._adapter.close()

    def _hear(self) -> None:
        while not self._ended.is_set():
            for ready in select.select([self._vehicles, self._adapter], [], [], _LOOK_S)[0]:
                self._take(ready)

    def _take(self, ready: socket.socket) -> None:
        upwards = ready is self._vehicles
        while True:
            try:
                datagram, peer = ready.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError:
                # The other side is not there: what was sent to it came back as an error.
                continue
            if upwards:
                self._peer = peer
            system = datagram[_SYSTEM_AT] if upwards else self._addressee(datagram)
            if not (self.cut and (system in self.cut or system == _EVERYBODY)):
                self.pass_on(self._up if upwards else self._down, datagram)

    def _addressee(self, datagram: bytes) -> int:
        for message in self._parser.parse_buffer(datagram) or ():
            return int(getattr(message, "target_system", _EVERYBODY))
        return _EVERYBODY


def _bound() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind((_HOST, 0))
    opened.setblocking(False)
    return opened


def _send(source: socket.socket, datagram: bytes, to: tuple[str, int] | None) -> None:
    if to is not None:
        # Nobody may be there to take it.
        with suppress(OSError):
            source.sendto(datagram, to)
