"""One end of an LCM bus: channels that are heard, and messages that are said."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

import lcm

from soter.errors import RobotUnavailable

GROUP: Final = "239.255.76.67"
_LOOK_S: Final = 0.05
_QUEUE: Final = 500


class Bus:
    """LCM over UDP multicast. `say` may be called from any thread, the rest from one.

    An `lcm.LCM` has a thread and sockets of its own until nobody refers to it any more: nobody else is given it.

    Args:
        url: of the bus, as LCM has it.
        hears: by channel, who takes what comes there.

    Raises:
        RobotUnavailable: there is no such bus on this host.
    """

    def __init__(self, url: str, hears: Mapping[str, Callable[[bytes], object]]) -> None:
        try:
            opened = lcm.LCM(url)
            for channel, hear in hears.items():
                _subscribe(opened, channel, hear)
        except RuntimeError as failure:
            raise RobotUnavailable(
                f"LCM cannot open {url}: {failure}; it needs a route for multicast: "
                "`ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo`"
            ) from failure
        self._lcm: lcm.LCM | None = opened
        self._thread: threading.Thread | None = None
        self._ended = False

    def say(self, channel: str, message: bytes) -> None:
        """Send a message; one that cannot be sent is dropped."""
        opened = self._lcm
        if opened is not None:
            with suppress(RuntimeError):
                opened.publish(channel, message)

    def fileno(self) -> int:
        """Return what `select` sees that something has come by."""
        assert self._lcm is not None
        return self._lcm.fileno()

    def hear(self) -> None:
        """Take what has come, without waiting."""
        assert self._lcm is not None
        while self._lcm.handle_timeout(0) > 0:
            pass

    def listen(self, name: str) -> None:
        """Hear in a thread of its own from now on."""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the threads and close the sockets. Idempotent."""
        self._ended = True
        if self._thread is not None:
            self._thread.join()
        # LCM's own thread and sockets go with the object.
        self._lcm = None

    def _run(self) -> None:
        while not self._ended:
            if select.select([self], [], [], _LOOK_S)[0]:
                self.hear()


def free_url() -> str:
    """Return the address of a bus that nobody is on, and whose messages do not leave this host."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"udpm://{GROUP}:{probe.getsockname()[1]}?ttl=0"


def _subscribe(opened: lcm.LCM, channel: str, hear: Callable[[bytes], object]) -> None:
    def take(_: str, message: bytes) -> None:
        hear(message)

    # A full queue drops what is new, not what is old: it must never be full.
    opened.subscribe(channel, take).set_queue_capacity(_QUEUE)
