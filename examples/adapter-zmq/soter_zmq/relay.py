"""A bad link, for tests: a relay between an adapter and its robots, message by message."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import Final

import zmq

from soter.conformance import ImpairedRelay, Line
from soter_zmq.robot import address

_LOOK_MS: Final = 20


class Relay(ImpairedRelay):
    """Passes messages on, both ways.

    Args:
        addresses: by robot, where it really listens and reports.

    Attributes:
        addresses: by robot, where the relay takes its place.
    """

    def __init__(self, addresses: Mapping[int, Mapping[str, str]]) -> None:
        super().__init__()
        self.addresses: Final[dict[int, dict[str, str]]] = {}
        self._context: Final = zmq.Context()
        # From the first, for every socket: set when sockets are closed it has let the library hang, once in some 200.
        self._context.linger = 0
        self._lines: Final[dict[zmq.Socket[bytes], Line]] = {}
        for robot_id, real in addresses.items():
            command_in, report_out = self._bound(zmq.PULL), self._bound(zmq.PUB)
            self.addresses[robot_id] = {"command": address(command_in), "report": address(report_out)}
            command_out, report_in = self._context.socket(zmq.PUSH), self._context.socket(zmq.SUB)
            report_in.setsockopt(zmq.SUBSCRIBE, b"")
            command_out.connect(real["command"])
            report_in.connect(real["report"])
            # A socket is for one thread at a time: those that hear are this class's, those that say the base's.
            self._lines[command_in] = Line(robot_id, partial(_send, command_out))
            self._lines[report_in] = Line(robot_id, partial(_send, report_out))
        self._ended: Final = threading.Event()
        self._hearing: Final = threading.Thread(target=self._hear, name="zmq-relay", daemon=True)
        self._hearing.start()

    def close(self) -> None:
        self._ended.set()
        self._hearing.join()
        super().close()
        self._context.destroy()

    def _bound(self, kind: int) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.bind("tcp://127.0.0.1:*")
        return socket

    def _hear(self) -> None:
        poller = zmq.Poller()
        for source in self._lines:
            poller.register(source, zmq.POLLIN)
        while not self._ended.is_set():
            for source, _ in poller.poll(_LOOK_MS):
                self.pass_on(self._lines[source], source.recv())


def _send(sink: zmq.Socket[bytes], message: bytes) -> None:
    # Nobody may be there to take it.
    with suppress(zmq.Again):
        sink.send(message, zmq.NOBLOCK)
