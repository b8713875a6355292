"""What the processes of live views share: how they begin, follow a recording, and end."""

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
"""Address space that a view may take."""

LOOK_S: Final = 0.05
"""Host time between two looks at a recording that has not grown."""

_PATH_BYTES: Final = 1 << 16


class Screen(Protocol):
    """Shows a run to its viewers; made with a port of 127.0.0.1, 0 for one that is free, or it raises OSError."""

    @property
    def port(self) -> int:
        """The TCP port on 127.0.0.1; viewers can connect as soon as this object exists."""

    def show(self, recording: GrowingRecording) -> None:
        """Show a run until its recording ends.

        Raises:
            BadRecording: it is damaged.
        """

    def pause(self) -> None:
        """Show what has come: there is nothing more for now."""

    def close(self) -> None:
        """End, once those who look have been told all, or have had the time to be."""


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> NoReturn:
    """Be the process of a view, as `soter.isolation.child` starts it.

    Args:
        stdin: holds, pickled, the name of the class of its screen and the port.
        socket_fd: what the run says comes from there: where its recording is. It is closed when nobody is to be shown
            anything any more.
        lifeline_fd: its other end is closed when the run has died.
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
        # Until the run closes its end: it may keep what is shown for those who come when it has ended.
        while link.recv(_PATH_BYTES):
            pass
        screen.close()
    except Exception as failure:  # noqa: BLE001 - whatever it is, the run is told before this process ends
        why = (failure.strerror if isinstance(failure, OSError) else None) or str(failure) or repr(failure)
        link.send(FAILED + why.encode(), socket.MSG_NOSIGNAL)
        os._exit(1)
    # Threads of viewers that do not read are not waited for.
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
