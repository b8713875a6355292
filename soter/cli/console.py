"""Where commands write to: for people, and for programs."""

from __future__ import annotations

import os
import sys
from typing import IO

from rich.console import Console


class HumanConsole(Console):
    """A rich console that loses its reader without losing the run."""

    def on_broken_pipe(self) -> None:
        """Be silent from now on: whoever read the progress has left, the robots have not."""
        self.quiet = True
        _discard(self.file)


def make_console(*, stderr: bool = False) -> HumanConsole:
    """Return a console on standard output or standard error.

    What goes into a file or a pipe has no colours and no control characters, unless FORCE_COLOR asks for them.
    """
    return HumanConsole(stderr=stderr, highlight=False, markup=False, emoji=False)


def emit(text: str) -> None:
    """Write a line for a program to standard output; one that has stopped reading does not end the command."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _discard(sys.stdout)


def _discard(stream: IO[str]) -> None:
    """Let what a stream still holds, and all that is written to it from now on, go nowhere."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, stream.fileno())
    os.close(devnull)


def is_live(console: Console) -> bool:
    """Return whether a display on this console may overwrite itself: it is a terminal that can move its cursor."""
    return console.file.isatty() and not console.is_dumb_terminal
