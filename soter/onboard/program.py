"""Common parts of programs on a robot: their end, and their scheduling. Standard library only."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

LEAVE_S: Final = 5.0
"""How long a program may take to close its links."""


class Ending:
    """Notices when a program is to end: a request to terminate, Ctrl-C, or the end of its parent.

    Args:
        parent: the process id of the parent to end with, or None.
    """

    def __init__(self, parent: int | None = None) -> None:
        self._parent = parent
        self._asked = threading.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            # Not an exception, which a library could swallow.
            signal.signal(number, lambda *_: self._asked.set())

    def __call__(self) -> bool:
        """Return whether the program is to end now."""
        return self._asked.is_set() or (self._parent is not None and os.getppid() != self._parent)


@contextmanager
def killed_after(limit_s: float) -> Iterator[None]:
    """Have the kernel kill this program if the body of the `with` statement takes longer.

    For the shutdown of a library that may hang: when several programs leave at once, Fast DDS can wait for a callback
    busily and with the interpreter locked, so that no Python signal handler would run.

    Args:
        limit_s: the time limit; the robot is at rest already.
    """
    before = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def favour() -> None:
    """Give all threads real-time priority, if the kernel allows it: the code that stops a robot comes first.

    Threads that they start later inherit it, such as those of libraries that renew a broken link.
    """
    with suppress(OSError):
        for task in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(1))
