"""What programs on a robot have in common: how they end, and how they are scheduled. Standard library only."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

LEAVE_S: Final = 5.0
"""For so long a program may take leave of those that it has links to."""


class Ending:
    """Notices when a program is to end: a request to terminate, Ctrl-C, or the end of its parent.

    Args:
        parent: the process id of the parent to end with, or None.
    """

    def __init__(self, parent: int | None = None) -> None:
        self._parent = parent
        self._asked = threading.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            # Not an exception: it could come where a library ignores it.
            signal.signal(number, lambda *_: self._asked.set())

    def __call__(self) -> bool:
        """Return whether it is to end now."""
        return self._asked.is_set() or (self._parent is not None and os.getppid() != self._parent)


@contextmanager
def killed_after(limit_s: float) -> Iterator[None]:
    """Have the kernel end this program if what is done within takes longer.

    For what a library does at its end, which may never come: Fast DDS can wait for a callback, busily and with the
    interpreter in its hands, when several programs leave at once. No handler in Python would run then.

    Args:
        limit_s: a robot is at rest before it begins, so nothing waits for it.
    """
    before = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def favour() -> None:
    """Schedule all threads before what is not real-time, where the kernel allows it: what stops a robot comes first.

    So are threads that they start later, as libraries do when a link breaks and is made anew.
    """
    with suppress(OSError):
        for task in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(1))
