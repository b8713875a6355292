"""How commands end: the exit codes, and one clear message instead of a traceback."""

from __future__ import annotations

import errno
import signal
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType
from typing import Any, Final, Self

import typer

from soter.errors import BackendError, ConfigError, IllFormedModule, SoterError


class ExitCode(IntEnum):
    """What the exit code of `soter run` says.

    An interrupted run exits with 128 and the signal's number, as shells have it: 130 for Ctrl-C.
    """

    OK = 0
    VIOLATION = 1
    BAD_INPUT = 2
    RUN_FAILED = 3
    INTERRUPTED = 130


_FULL: Final = (errno.ENOSPC, errno.EDQUOT)
"""What the system says where a disk, or a user's share of it, is full."""


def complain(message: str) -> None:
    """Write a message for the user to standard error, in one piece and without wrapping it."""
    typer.secho("error: ", fg=typer.colors.RED, bold=True, nl=False, err=True)
    typer.echo(message, err=True)


@contextmanager
def guard() -> Iterator[None]:
    """Turn what can go wrong in a command into a message and an exit code."""
    try:
        yield
    except (ConfigError, BackendError, IllFormedModule) as failure:
        complain(str(failure))
        raise typer.Exit(ExitCode.BAD_INPUT) from failure
    except SoterError as failure:
        complain(str(failure))
        raise typer.Exit(ExitCode.RUN_FAILED) from failure
    except KeyboardInterrupt as failure:
        complain("interrupted")
        raise typer.Exit(ExitCode.INTERRUPTED) from failure
    except typer.Exit:
        raise
    except Exception as failure:
        if isinstance(failure, OSError) and failure.errno in _FULL:
            complain(f"nothing more can be written: {failure.strerror}; make room, or write elsewhere")
        else:
            traceback.print_exc()
            complain(
                "this is a fault of SOTER or of an adapter, not of your input; please report it with the lines above"
            )
        # Python itself would exit with 1, which stands for a violation.
        raise typer.Exit(ExitCode.RUN_FAILED) from failure


class StopSignals:
    """Notes the first Ctrl-C or request to terminate, so that the run can stop its robots; the next one is not caught.

    A context manager, and a callable that says whether to stop. It changes signal handlers only in the main thread,
    the only one that may.

    Attributes:
        received: the number of the signal that came, or None.
    """

    SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self.received: int | None = None
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in self.SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def __call__(self) -> bool:
        return self.received is not None

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.received = number
        self._restore()

    def _restore(self) -> None:
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)
