"""Ends a run if foreign code does not return, since nothing else can happen in this process until it does."""

from __future__ import annotations

import logging
import math
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final, Self

from soter.errors import RunFailed

logger = logging.getLogger(__name__)

LIMIT_S: Final = 2.0
"""Host time that one handler may take in virtual time."""

SLOW_S: Final = 10.0
"""Host time that each other phase may take: the decisions of a tick, judging rules by truth, the end."""

GIVE_UP_S: Final = 3.0
"""If code catches every interruption for this long, the process ends."""

_LOOK_S: Final = 0.25
_SIGNAL: Final = signal.SIGALRM
_FAILED: Final = 3
"""Exit code of a run that failed; see `soter.cli.exits`."""


class CutOff(KeyboardInterrupt):
    """Raised in the main thread when a phase or handler takes too long.

    Like Ctrl-C, it is not caught as a failure of foreign code: if one call hangs, the next may hang too.
    """


class Watchdog:
    """Interrupts the main thread when one handler, or another part of a tick, takes too long. A context manager.

    It counts looks, not seconds: a process that was stopped for an hour has not been busy.

    Only Python code and system calls can be interrupted. If code catches the interruption and goes on, or waits in a
    library, the process ends. A library that computes without releasing the interpreter's lock cannot be ended at all.

    Attributes:
        handler: returns the name of the running handler, or None; called from a thread.
        ticks: how many ticks have passed.
        phase: what is being done, apart from the name of a handler, and the host time that it may take, handlers
            included; None if only handlers are watched.
        last_words: called before the process is ended, in a thread.
    """

    def __init__(self) -> None:
        self.handler: Callable[[], str | None] = lambda: None
        self.last_words: Callable[[], object] = lambda: None
        self.ticks = 0
        self.phase: tuple[str, float] | None = None
        self._done: Final = threading.Event()
        self._armed = threading.current_thread() is threading.main_thread()
        self._main_id: Final = threading.main_thread().ident or 0
        self._blamed = ""
        self._thread: Final = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._previous: Any = None

    def __enter__(self) -> Self:
        if self._armed:
            self._previous = signal.signal(_SIGNAL, self._interrupt)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        if self._armed:
            self._thread.join()
            signal.signal(_SIGNAL, self._previous)

    @contextmanager
    def over(self, name: str, limit_s: float) -> Iterator[None]:
        """Watch the body of the `with` statement as a phase."""
        self.phase = name, limit_s
        try:
            yield
        finally:
            self.phase = None

    def check(self) -> None:
        """End the run if anything had to be interrupted, even if foreign code caught the interruption.

        Raises:
            RunFailed: something was interrupted; names it.
        """
        if self._blamed:
            raise RunFailed(self._blamed)

    def _watch(self) -> None:
        seen, looks = None, 0
        while not self._done.wait(_LOOK_S):
            phase, handler = self.phase, self.handler()
            found = self.ticks, phase
            if (phase is None and handler is None) or found != seen:
                seen, looks = found, 0
                continue
            looks += 1
            what, limit_s = phase or ("", LIMIT_S)
            most = math.ceil(limit_s / _LOOK_S)
            if looks < most:
                continue
            if looks == most:
                what = what if handler is None else f"handler {handler}"
                self._blamed = f"{what} has blocked the mission for {limit_s:g} s of host time"
            if looks >= most + GIVE_UP_S / _LOOK_S:
                logger.critical("%s, and cannot be interrupted: the process ends", self._blamed)
                self.last_words()
                os._exit(_FAILED)
            signal.pthread_kill(self._main_id, _SIGNAL)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        where = "" if frame is None else f" ({Path(frame.f_code.co_filename).name}, line {frame.f_lineno})"
        raise CutOff(f"{self._blamed or 'another program has sent SIGALRM'}{where}")
