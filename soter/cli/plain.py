"""What commands write, without anything in it that a terminal would obey.

Names of files, machines and robots, causes and texts of recordings are anybody's. Escape sequences in them would move
the cursor, retitle the window or answer for the user; marks of direction would show one name as another. All that
a command writes passes `plain`: what is printed by `emit` and `complain`, what rich renders (see `soter.cli.console`),
what is logged, and by `guard_streams` all the rest.
"""

from __future__ import annotations

import errno
import io
import logging
import os
import re
import stat
import sys
from collections.abc import Callable
from typing import Any, Final, TextIO

FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says where a disk, a user's share of it, or what a file may hold is full."""

_LEFT: Final = (errno.EPIPE, errno.ESHUTDOWN, errno.ECONNRESET, errno.EBADF)
"""What it says where the reader has left, or foreign code has closed the file."""

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
    """Write a line to standard output."""
    print(plain(text), flush=True)


class Unfailing(io.FileIO):
    """A file that takes all that is written to it, and ends no command: robots may depend on that.

    Args:
        fd: of the file.
        on_full: called once, with what the system said, where a disk is full. That a reader has left is told to nobody.

    Attributes:
        full: whether something was lost because a disk was full.
    """

    def __init__(self, fd: int, on_full: Callable[[OSError], None]) -> None:
        super().__init__(fd, "wb", closefd=False)
        self._on_full: Final = on_full
        # Of a terminal that is gone the system says what it says of a broken disk, and no more that it is a terminal.
        self._left: Final = (*_LEFT, errno.EIO) if stat.S_ISCHR(os.fstat(fd).st_mode) else _LEFT
        self.full = False

    def write(self, data: Any) -> int | None:  # type: ignore[override]
        """Write what can be written; return the length of all of it."""
        try:
            return super().write(data)
        except OSError as failure:
            if failure.errno not in (*FULL, *self._left):
                raise
            if failure.errno in FULL and not self.full:
                self.full = True
                self._on_full(failure)
        return memoryview(data).nbytes


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
        parts = _STYLE.split(text) if self._styled else [text]
        self.stream.write("".join(part if at % 2 else plain(part) for at, part in enumerate(parts)))
        return len(text)

    def writable(self) -> bool:
        return True

    def flush(self) -> None:
        # It is flushed once more when it is collected, after what it writes to may have been closed.
        if not self.stream.closed:
            self.stream.flush()

    def fileno(self) -> int:
        return self.stream.fileno()

    def isatty(self) -> bool:
        return self.stream.isatty()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self.stream.encoding

    @property
    def errors(self) -> str | None:  # type: ignore[override]
        return self.stream.errors

    @property
    def buffer(self) -> Any:
        return self.stream.buffer


class PlainFormatter(logging.Formatter):
    """Formats what is logged, tracebacks included, as `plain`."""

    def format(self, record: logging.LogRecord) -> str:
        return plain(super().format(record))


def behind(stream: TextIO) -> TextIO:
    """Return where a stream leads to, for those whose own colours and moves of the cursor are to pass."""
    return stream.stream if isinstance(stream, PlainStream) else stream


_STREAMS: Final = ("stdin", "stdout", "stderr")


def _open_what_is_closed() -> None:
    """Have nowhere for a standard stream that is closed: the next file that is opened would take its place."""
    while (fd := os.open(os.devnull, os.O_RDWR)) < len(_STREAMS):
        os.set_inheritable(fd, True)
        setattr(sys, _STREAMS[fd], os.fdopen(fd, "w" if fd else "r", closefd=False))
    os.close(fd)


def guard_streams(on_full: Callable[[OSError], None]) -> list[Unfailing]:
    """Let nothing that a terminal obeys out of this process by standard output or standard error.

    What the library of the command line says of wrong usage has colours; it repeats what the command was called with.

    Args:
        on_full: called once for each of the two that is on a full disk, instead of failing.

    Returns:
        Where the two write to.
    """
    _open_what_is_closed()
    harmless = all(plain(argument) == argument for argument in sys.argv)
    files = []
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            # A terminal that cannot show a character gets a question mark, not the end of the run.
            stream.reconfigure(errors="replace")
            if stream is getattr(sys, f"__{name}__"):
                stream = _unfailing(stream, file := Unfailing(stream.fileno(), on_full))
                files.append(file)
            setattr(sys, name, PlainStream(stream, styled=harmless))
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(PlainFormatter())
    return files


def _unfailing(stream: io.TextIOWrapper, file: Unfailing) -> TextIO:
    stream.flush()
    return io.TextIOWrapper(
        # As Python does where it is told to keep nothing back.
        file if stream.write_through else io.BufferedWriter(file),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
