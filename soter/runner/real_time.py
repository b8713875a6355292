"""Real-time scheduling of this process, so that other work of the host does not delay ticks."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from soter.errors import ConfigError

_TASKS: Final = Path("/proc/self/task")
_LOWEST: Final = 1
_NORMAL: Final = 0


@contextmanager
def real_time(*, required: bool) -> Iterator[bool]:
    """Schedule all present threads in real time while the context lasts, and as before afterwards.

    All threads, because they share the interpreter's lock: a tick would have to wait for a thread that holds it and
    does not get to run. Threads and processes that they start meanwhile are scheduled as usual.

    Args:
        required: False to go on without real-time scheduling if the kernel does not allow it.

    Yields:
        Whether the threads are scheduled in real time.

    Raises:
        ConfigError: it is required, and the kernel does not allow it; the message says what to do.
    """
    try:
        _schedule(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, _LOWEST)
    except PermissionError as refused:
        if not required:
            yield False
            return
        raise ConfigError(
            "it is 'always', but the kernel does not let this user have real-time scheduling; give the process the "
            "capability CAP_SYS_NICE or a limit of real-time priority (ulimit -r 1), or set it to 'auto'",
            key="isolation.real_time",
        ) from refused
    try:
        yield True
    finally:
        _schedule(os.SCHED_OTHER, _NORMAL)


def _schedule(policy: int, priority: int) -> None:
    for task in _TASKS.iterdir():
        with suppress(ProcessLookupError):
            os.sched_setscheduler(int(task.name), policy, os.sched_param(priority))
