"""The process of a live view: how it begins, follows a recording, and ends."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import BinaryIO, Final, NoReturn, Protocol

from soter.isolation.child import die_with_parent, yield_to_others
from soter.live.view import FAILED, READY
from soter.record.follow import GrowingRecording

NICENESS: Final = 10
MEMORY_BYTES: Final = 2 << 30
"""Most address space of a view's process."""

LOOK_S: Final = 0.05
"""Host time between two looks at a recording that has not grown."""

_PATH_BYTES: Final = 1 << 16


class Screen(Protocol):
    """Shows a run to viewers. The class takes a port of 127.0.0.1, or 0 for a free one, and may raise OSError."""

    @property
    def port(self) -> int:
        """The TCP port on 127.0.0.1; viewers can connect as soon as this object exists."""

    def show(self, recording: GrowingRecording) -> None:
        """Show a run until its recording ends.

        Raises:
            BadRecording: the recording is damaged.
        """

    def pause(self) -> None:
        """Show all that was read: there is nothing more to read at the moment."""

    def close(self) -> None:
        """End, once viewers have received all, or have had enough time to."""


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> NoReturn:
    """Run the process of a view, as `soter.isolation.child` starts it.

    Args:
        stdin: holds, pickled, the name of the screen's class and the port.
        socket_fd: a socket on which the run sends the recording's path, and which it closes to end the view.
        lifeline_fd: a pipe whose other end is closed when the run has died.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(lifeline_fd)
    name, port = pickle.load(stdin)  # noqa: S301 - from the run
    make: Callable[[int], Screen] = resolve_name(name)
    yield_to_others(NICENESS, MEMORY_BYTES)
    link = socket.socket(fileno=socket_fd)
    try:
        screen = make(port)
        link.send(READY + str(screen.port).encode())
        _follow(link, screen)
        # Until the run closes its end: it may keep the view for viewers that come after the run's end.
        while link.recv(_PATH_BYTES):
            pass
        screen.close()
    except Exception as failure:  # noqa: BLE001 - whatever it is, the run is told before this process ends
        why = (failure.strerror if isinstance(failure, OSError) else None) or str(failure) or repr(failure)
        link.send(FAILED + why.encode(), socket.MSG_NOSIGNAL)
        os._exit(1)
    # Do not wait for the threads of viewers that do not read.
    os._exit(0)


def _follow(link: socket.socket, screen: Screen) -> None:
    path = link.recv(_PATH_BYTES)
    if not path:  # the run was refused
        return

    def ended() -> bool:
        try:
            return not link.recv(_PATH_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False

    def wait() -> None:
        screen.pause()
        time.sleep(LOOK_S)

    screen.show(GrowingRecording(Path(os.fsdecode(path)), ended, wait))
