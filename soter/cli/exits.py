"""How commands end: the exit codes, and one clear message instead of a traceback."""

from __future__ import annotations

import os
import signal
import stat
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum
from types import FrameType
from typing import Annotated, Any, Final, Self

import typer

from soter.cli.option import switch
from soter.cli.plain import FULL, behind, plain
from soter.errors import BackendError, ConfigError, IllFormedModule, SoterError


class ExitCode(IntEnum):
    """The exit codes of `soter run`.

    An interrupted run exits with 128 and the signal's number, as shells have it: 130 for Ctrl-C.
    """

    OK = 0
    VIOLATION = 1
    BAD_INPUT = 2
    RUN_FAILED = 3
    INTERRUPTED = 130


Force = Annotated[bool, switch("--force", "Replace files that are there already.")]
"""An option of every command that writes files."""


def complain(message: str) -> None:
    """Write a message for the user to standard error, in one piece and without wrapping it."""
    # If standard error is gone, only the exit code remains.
    with suppress(OSError):
        typer.secho("error: ", fg=typer.colors.RED, bold=True, nl=False, file=behind(sys.stderr))
        typer.echo(plain(message), err=True)


def complain_of_room(failure: OSError) -> None:
    """Write a message that a disk is full."""
    complain(f"nothing more can be written: {failure.strerror}; make room, or write elsewhere")


@contextmanager
def guard() -> Iterator[None]:
    """Turn the exceptions of a command into a message and an exit code."""
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
        # `StopSignals.raising` passes the signal's number.
        raise typer.Exit(128 + failure.args[0] if failure.args else ExitCode.INTERRUPTED) from failure
    except typer.Exit:
        raise
    except Exception as failure:
        if isinstance(failure, OSError) and failure.errno in FULL:
            complain_of_room(failure)
        elif isinstance(failure, ImportError) and (hint := _missing(failure)):
            complain(hint)
            raise typer.Exit(ExitCode.BAD_INPUT) from failure
        else:
            with suppress(OSError):
                typer.echo(plain(traceback.format_exc()), err=True, nl=False)
            complain(
                "this is a fault of SOTER or of an adapter, not of your input; please report it with the lines above"
            )
        # Python itself would exit with 1, which stands for a violation.
        raise typer.Exit(ExitCode.RUN_FAILED) from failure


def _missing(failure: ImportError) -> str:
    """Return how to install a missing library of an extra; empty for other libraries."""
    from soter.registry import install_hint

    hint = install_hint(failure.name or "")
    return f"a library that this needs cannot be imported ({failure}); install it with: {hint}" if hint else ""


class StopSignals:
    """Notes the first Ctrl-C, request to terminate or loss of the terminal, so that the run can stop its robots.

    A second signal is not caught.

    A context manager, and a callable that returns whether to stop. Signal handlers are changed only in the main thread,
    since no other may.

    Attributes:
        received: the number of the received signal, or None.
    """

    SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def __init__(self) -> None:
        self.received: int | None = None
        self._before: dict[signal.Signals, Any] = {}
        self._raises = False

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Raise KeyboardInterrupt once a signal is received, or was before: for code that waits without polling."""
        self._raises = True
        try:
            if self.received is not None:
                raise KeyboardInterrupt(self.received)
            yield
        finally:
            self._raises = False

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            # A process that was started to outlive its terminal, as by nohup, keeps ignoring that signal.
            wanted = [
                each for each in self.SIGNALS if each != signal.SIGHUP or signal.getsignal(each) != signal.SIG_IGN
            ]
            self._before = {number: signal.signal(number, self._note) for number in wanted}
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def __call__(self) -> bool:
        return self.received is not None

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.received = number
        self._restore()
        if number == signal.SIGHUP:
            _let_go_of_terminal()
        if self._raises:
            raise KeyboardInterrupt(number)

    def _restore(self) -> None:
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)


def _let_go_of_terminal() -> None:
    """Redirect output from a terminal that has gone to nowhere, so that the remaining work cannot fail by writing."""
    for fd in (sys.stdout.fileno(), sys.stderr.fileno()):
        if stat.S_ISCHR(os.fstat(fd).st_mode) and not os.isatty(fd):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, fd)
            os.close(nowhere)
