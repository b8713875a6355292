"""Hears everything that arrives, in one thread: what is newest is kept, nothing is queued."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

import zmq

_LOOK_MS: Final = 50


def opened(context: zmq.Context[zmq.Socket[bytes]], kind: int, address: str) -> zmq.Socket[bytes]:
    """Return a socket that keeps the last message only, so that who is slow hears what is new and not what is first."""
    socket = context.socket(kind)
    socket.setsockopt(zmq.CONFLATE, 1)
    socket.setsockopt(zmq.RECONNECT_IVL, 50)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
    if kind == zmq.SUB:
        socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.connect(address)
    return socket


class Receiver:
    """A thread that hands every message to whom it is for.

    Args:
        context: for the sockets.
        sources: addresses to listen to, and who hears what comes from there.
    """

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], sources: Mapping[str, Callable[[bytes], None]]) -> None:
        self._done: Final = threading.Event()
        self._hears: Final = {opened(context, zmq.SUB, address): hear for address, hear in sources.items()}
        self._thread: Final = threading.Thread(target=self._run, name="zmq-receiver", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close its sockets. Idempotent."""
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        poller = zmq.Poller()
        for socket in self._hears:
            poller.register(socket, zmq.POLLIN)
        while not self._done.is_set():
            for socket, _ in poller.poll(_LOOK_MS):
                with suppress(zmq.Again):
                    self._hears[socket](socket.recv(zmq.NOBLOCK))
        for socket in self._hears:
            socket.close()
