"""A bad link, for tests: a relay between an adapter and its robots that delays, loses, repeats and swaps messages."""

from __future__ import annotations

import heapq
import math
import random
import threading
import time
from collections.abc import Callable, Mapping
from typing import Final

import zmq

_LOOK_S: Final = 0.02


class Relay:
    """Passes messages on, both ways, in a thread of its own.

    Args:
        endpoints: by robot, where it really listens and reports.

    Attributes:
        endpoints: by robot, where the relay takes its place.
        delay_s: every message is delivered so much later.
        loss: this share of all messages is lost.
        duplicate: this share is delivered twice.
        reorder: this share is delivered after the one that followed.
        cut: robots whose messages are all lost.
    """

    def __init__(self, endpoints: Mapping[int, Mapping[str, str]]) -> None:
        self.delay_s = self.loss = self.duplicate = self.reorder = 0.0
        self.cut: frozenset[int] = frozenset()
        self.endpoints: Final[dict[int, dict[str, str]]] = {}
        self._random: Final = random.Random(0)
        self._context: Final = zmq.Context()
        # From the first, for every socket: set when sockets are closed it has let the library hang, once in some 200.
        self._context.linger = 0
        self._lines: Final[list[_Line]] = []
        for robot_id, real in endpoints.items():
            command_in, report_out = self._bound(zmq.PULL), self._bound(zmq.PUB)
            self.endpoints[robot_id] = {
                "command": command_in.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0"),
                "report": report_out.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0"),
            }
            command_out, report_in = self._context.socket(zmq.PUSH), self._context.socket(zmq.SUB)
            report_in.setsockopt(zmq.SUBSCRIBE, b"")
            command_out.connect(real["command"])
            report_in.connect(real["report"])
            self._lines.append(_Line(robot_id, command_in, command_out))
            self._lines.append(_Line(robot_id, report_in, report_out))
        self._done: Final = threading.Event()
        self._thread: Final = threading.Thread(target=self._run, name="zmq-relay", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the sockets. Idempotent."""
        self._done.set()
        self._thread.join()
        self._context.destroy()

    def _bound(self, kind: int) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.bind("tcp://127.0.0.1:*")
        return socket

    def _run(self) -> None:
        poller = zmq.Poller()
        for line in self._lines:
            poller.register(line.source, zmq.POLLIN)
        while not self._done.is_set():
            next_s = min((line.next_s for line in self._lines), default=math.inf)
            poller.poll(math.ceil(1000.0 * min(_LOOK_S, max(0.0, next_s - time.perf_counter()))))
            for line in self._lines:
                line.pass_on(self._deliveries, self.delay_s)

    def _deliveries(self, line: _Line) -> tuple[int, bool]:
        """Return how often a message is to be delivered, and whether after the one that follows."""
        chance = self._random.random
        if line.robot_id in self.cut or chance() < self.loss:
            return 0, False
        return 2 if chance() < self.duplicate else 1, chance() < self.reorder


class _Line:
    """One way between one robot and its adapter."""

    def __init__(self, robot_id: int, source: zmq.Socket[bytes], sink: zmq.Socket[bytes]) -> None:
        self.robot_id: Final = robot_id
        self.source: Final = source
        self._sink: Final = sink
        self._queue: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._held: bytes | None = None

    @property
    def next_s(self) -> float:
        """When the next message is to be delivered."""
        return self._queue[0][0] if self._queue else math.inf

    def pass_on(self, deliveries: Callable[[_Line], tuple[int, bool]], delay_s: float) -> None:
        """Take what has arrived, and deliver what is due."""
        while True:
            try:
                message = self.source.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            times, held = deliveries(self)
            if times and held and self._held is None:
                self._held = message
                continue
            for _ in range(times):
                self._add(message, delay_s)
            if times and self._held is not None:
                self._add(self._held, delay_s)
                self._held = None
        while self.next_s <= time.perf_counter():
            try:
                self._sink.send(heapq.heappop(self._queue)[2], zmq.NOBLOCK)
            except zmq.Again:
                continue

    def _add(self, message: bytes, delay_s: float) -> None:
        self._count += 1
        heapq.heappush(self._queue, (time.perf_counter() + delay_s, self._count, message))
