"""A bad link, for tests: a relay between an adapter and vehicles that delays, loses, repeats and swaps datagrams."""

from __future__ import annotations

import heapq
import math
import random
import select
import socket
import threading
import time
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

_HOST: Final = "127.0.0.1"
_LOOK_S: Final = 0.02
_LARGEST: Final = 65536
_SYSTEM_AT: Final = 5
_EVERYBODY: Final = 0


class Relay:
    """Passes datagrams on, both ways, in a thread of its own.

    Args:
        adapter_port: on which the adapter listens.

    Attributes:
        port: to which the vehicles send.
        delay_s: every datagram is delivered so much later, in host time.
        loss: this share of all datagrams is lost.
        duplicate: this share is delivered twice.
        reorder: this share is delivered after the one that followed.
        cut: system ids of vehicles to and from which nothing gets through; what is for everybody does not either.
    """

    def __init__(self, adapter_port: int) -> None:
        self.delay_s = self.loss = self.duplicate = self.reorder = 0.0
        self.cut: frozenset[int] = frozenset()
        self._random: Final = random.Random(0)
        self._vehicles = self._bound()
        self._adapter = self._bound()
        self.port: Final[int] = self._vehicles.getsockname()[1]
        self._parser: Final = mav.MAVLink(None)
        self._parser.robust_parsing = True
        self._up: Final = _Way(self._adapter, (_HOST, adapter_port))
        self._down: Final = _Way(self._vehicles, None)
        self._done: Final = threading.Event()
        self._thread: Final = threading.Thread(target=self._run, name="mavlink-relay", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the sockets. Idempotent."""
        self._done.set()
        self._thread.join()
        self._vehicles.close()
        self._adapter.close()

    def _bound(self) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.bind((_HOST, 0))
        opened.setblocking(False)
        return opened

    def _run(self) -> None:
        while not self._done.is_set():
            next_s = min(self._up.next_s, self._down.next_s)
            wait_s = min(_LOOK_S, max(0.0, next_s - time.perf_counter()))
            for ready in select.select([self._vehicles, self._adapter], [], [], wait_s)[0]:
                self._take(ready)
            self._up.deliver()
            self._down.deliver()

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
                self._down.to = peer
            system = datagram[_SYSTEM_AT] if upwards else self._addressee(datagram)
            if not (self.cut and (system in self.cut or system == _EVERYBODY)):
                self._pass(self._up if upwards else self._down, datagram)

    def _addressee(self, datagram: bytes) -> int:
        for message in self._parser.parse_buffer(datagram) or ():
            return int(getattr(message, "target_system", _EVERYBODY))
        return _EVERYBODY

    def _pass(self, way: _Way, datagram: bytes) -> None:
        chance = self._random.random
        if chance() < self.loss:
            return
        times = 2 if chance() < self.duplicate else 1
        if chance() < self.reorder and way.held is None:
            way.held = datagram
            return
        for _ in range(times):
            way.add(datagram, self.delay_s)
        if way.held is not None:
            way.add(way.held, self.delay_s)
            way.held = None


class _Way:
    """One direction.

    Attributes:
        to: where it leads.
        held: what is delivered after the datagram that follows, or None.
    """

    def __init__(self, source: socket.socket, to: tuple[str, int] | None) -> None:
        self.to = to
        self.held: bytes | None = None
        self._socket: Final = source
        self._queue: Final[list[tuple[float, int, bytes]]] = []
        self._count = 0

    @property
    def next_s(self) -> float:
        """When the next datagram is to be delivered."""
        return self._queue[0][0] if self._queue else math.inf

    def add(self, datagram: bytes, delay_s: float) -> None:
        """Deliver a datagram so much later."""
        self._count += 1
        heapq.heappush(self._queue, (time.perf_counter() + delay_s, self._count, datagram))

    def deliver(self) -> None:
        """Deliver what is due."""
        while self.next_s <= time.perf_counter():
            datagram = heapq.heappop(self._queue)[2]
            if self.to is not None:
                try:
                    self._socket.sendto(datagram, self.to)
                except OSError:
                    continue
