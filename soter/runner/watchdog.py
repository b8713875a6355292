"""Ends a run whose mission code does not come back: in virtual time the physics waits for it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any, Final, Self

from soter.errors import RunFailed

LIMIT_S: Final = 2.0
"""Host time that one handler may take in virtual time."""

_LOOK_S: Final = 0.25
_SIGNAL: Final = signal.SIGALRM


class HandlerWatchdog:
    """Interrupts the main thread when one handler runs for longer than `LIMIT_S`. A context manager.

    The interruption is a `RunFailed` inside the handler. The machine that it belongs to fails by it, which the runtime
    reports as any failure; `check()` then ends the run, whoever caught the exception.

    Only code that the interpreter runs, or that waits in a system call, can be interrupted; a library that computes
    without returning ends the run as soon as it returns.

    Args:
        current: names the handler that runs, or None; readable from any thread.
        progress: a number that changes whenever a tick has passed.
    """

    def __init__(self, current: Callable[[], str | None], progress: Callable[[], int]) -> None:
        self._current: Final = current
        self._progress: Final = progress
        self._done: Final = threading.Event()
        self._armed = threading.current_thread() is threading.main_thread()
        self._main_id: Final = threading.main_thread().ident or 0
        self._blamed = ""
        self._thread: Final = threading.Thread(target=self._watch, name="handler-watchdog", daemon=True)
        self._previous: Any = None

    def __enter__(self) -> Self:
        if self._armed:
            self._previous = signal.signal(_SIGNAL, self._end_run)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        if self._armed:
            self._thread.join()
            signal.signal(_SIGNAL, self._previous)

    def check(self) -> None:
        """End the run if a handler had to be interrupted.

        Raises:
            RunFailed: names the handler.
        """
        if self._blamed:
            raise RunFailed(self._blamed)

    def _watch(self) -> None:
        seen, since_s = -1, 0.0
        while not self._done.wait(_LOOK_S):
            progress, handler, now_s = self._progress(), self._current(), time.perf_counter()
            if handler is None or progress != seen:
                seen, since_s = progress, now_s
            elif now_s - since_s >= LIMIT_S:
                self._blamed = f"handler {handler} has blocked the mission for {LIMIT_S:g} s of host time"
                signal.pthread_kill(self._main_id, _SIGNAL)
                return

    def _end_run(self, number: int, frame: FrameType | None) -> None:
        raise RunFailed(self._blamed)
