"""What commands write, without anything in it that a terminal would obey.

Names of files, machines and robots, causes and texts of recordings are anybody's. Escape sequences in them would move
the cursor, retitle the window or answer for the user; marks of direction would show one name as another. All that
a command writes passes `plain`: what is printed by `emit` and `complain`, what rich renders (see `soter.cli.console`),
what is logged, and by `guard_streams` all the rest.
"""

from __future__ import annotations

import io
import logging
import os
import re
import sys
from typing import IO, Any, Final, TextIO

_UNSAFE: Final = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # C0 but tabulators and ends of lines, DEL, C1
    "\u00ad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff"  # directions, ends of lines, what is not seen
    "\ud800-\udfff\U000e0000-\U000e007f]"  # halves of characters, tags
)
_STYLE: Final = re.compile(r"(\x1b\[[0-9;]*m)")


def plain(text: str) -> str:
    """Return a text with what is not for eyes written out as JSON does, in which it then means the same as before."""
    return _UNSAFE.sub(_written_out, text)


def _written_out(found: re.Match[str]) -> str:
    code = found[0].encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{code[at : at + 4]}" for at in range(0, len(code), 4))


def emit(text: str) -> None:
    """Write a line to standard output; a reader that has left does not end the command."""
    try:
        print(plain(text), flush=True)
    except BrokenPipeError:
        discard(sys.stdout)


def discard(stream: IO[str]) -> None:
    """Let what a stream still holds, and all that is written to it from now on, go nowhere."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, stream.fileno())
    os.close(devnull)


class PlainStream(io.TextIOBase):
    """A text stream that writes through `plain`.

    Args:
        stream: where to.
        styled: whether colours pass, and nothing else: only where none can come from outside.
    """

    def __init__(self, stream: TextIO, *, styled: bool = False) -> None:
        self.stream: Final = stream
        self._styled: Final = styled

    def write(self, text: str) -> int:
        """Write a text; return its length."""
        parts = _STYLE.split(text) if self._styled else [text]
        self.stream.write("".join(part if at % 2 else plain(part) for at, part in enumerate(parts)))
        return len(text)

    def writable(self) -> bool:
        """Return True."""
        return True

    def flush(self) -> None:
        """Hand on what was written."""
        self.stream.flush()

    def fileno(self) -> int:
        """Return that of the stream behind it."""
        return self.stream.fileno()

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self.stream.isatty()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of the stream behind it."""
        return self.stream.encoding

    @property
    def errors(self) -> str | None:  # type: ignore[override]
        """That of the stream behind it."""
        return self.stream.errors

    @property
    def buffer(self) -> Any:
        """The bytes behind it."""
        return self.stream.buffer


class PlainFormatter(logging.Formatter):
    """Formats what is logged, tracebacks included, as `plain`."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the text of a record."""
        return plain(super().format(record))


def behind(stream: TextIO) -> TextIO:
    """Return where a stream leads to, for those whose own colours and moves of the cursor are to pass."""
    return stream.stream if isinstance(stream, PlainStream) else stream


def guard_streams() -> None:
    """Let nothing that a terminal obeys out of this process by standard output or standard error.

    What the library of the command line says of wrong usage has colours; it repeats what the command was called with.
    """
    harmless = all(plain(argument) == argument for argument in sys.argv)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            # A terminal that cannot show a character gets a question mark, not the end of the run.
            stream.reconfigure(errors="replace")
            setattr(sys, name, PlainStream(stream, styled=harmless))
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(PlainFormatter())
