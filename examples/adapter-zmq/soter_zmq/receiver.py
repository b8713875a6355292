"""Hears everything that arrives, in one thread: what is newest is kept, nothing is queued."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

import zmq

from soter.clock import Clock

logger = logging.getLogger(__name__)

_LOOK_MS: Final = 50

Hear = Callable[[bytes, float], None]
"""Takes a message and the steady time at which it was received; raises ValueError for one that makes no sense."""


class Receiver:
    """A thread that hands every message to whom it is for.

    Args:
        context: for the sockets.
        clock: tells when a message was received.
        sources: addresses to listen to, and who hears what comes from there.
    """

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], clock: Clock, sources: Mapping[str, Hear]) -> None:
        self._clock: Final = clock
        self._done: Final = threading.Event()
        self._heard: Final = threading.Condition()
        self._hears: Final[dict[zmq.Socket[bytes], Hear]] = {}
        for address, hear in sources.items():
            socket = context.socket(zmq.SUB)
            # The socket keeps the last message only, so that who is slow hears what is new and not what is first.
            socket.setsockopt(zmq.CONFLATE, 1)
            socket.setsockopt(zmq.RECONNECT_IVL, 50)
            socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
            socket.setsockopt(zmq.SUBSCRIBE, b"")
            socket.connect(address)
            self._hears[socket] = hear
        self._thread: Final = threading.Thread(target=self._run, name="zmq-receiver", daemon=True)
        self._thread.start()

    def wait_for(self, predicate: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until something that was heard makes the predicate true; return whether it is."""
        with self._heard:
            return self._heard.wait_for(predicate, max(0.0, timeout_s))

    def close(self) -> None:
        """End the thread and close its sockets. Idempotent."""
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        poller = zmq.Poller()
        for socket in self._hears:
            poller.register(socket, zmq.POLLIN)
        try:
            while not self._done.is_set():
                for socket, _ in poller.poll(_LOOK_MS):
                    self._take(socket)
        finally:
            for socket in self._hears:
                socket.close()

    def _take(self, socket: zmq.Socket[Any]) -> None:
        try:
            message: bytes = socket.recv(zmq.NOBLOCK)
            received_s = self._clock.steady_s()
            self._hears[socket](message, received_s)
        except zmq.Again:
            return
        except ValueError as failure:
            # Whoever it is from goes on being old until it sends something better.
            logger.warning("a message that makes no sense was dropped: %s", failure)
            return
        with self._heard:
            self._heard.notify_all()
