"""Removes all control characters that a terminal would obey from the output of commands.

Names of files, machines and robots, causes and texts of recordings are untrusted. Escape sequences in them could move
the cursor, retitle the window or answer for the user; marks of direction could show one name as another. All output of
a command passes `plain`: texts printed by `emit` and `complain`, texts that rich renders (see `soter.cli.console`),
log messages, and by `guard_streams` everything else.
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
"""Errors of the system if a disk, a user's quota, or the largest size of a file is exhausted."""

_LEFT: Final = (errno.EPIPE, errno.ESHUTDOWN, errno.ECONNRESET, errno.EBADF)
"""Errors of the system if the reader has left, or foreign code has closed the file."""

_UNSAFE: Final = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # C0 but tabulators and ends of lines, DEL, C1
    "\u00ad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff"  # directions, ends of lines, what is not seen
    "\ud800-\udfff\U000e0000-\U000e007f]"  # halves of characters, tags
)
_STYLE: Final = re.compile(r"(\x1b\[[0-9;]*m)")


def plain(text: str) -> str:
    """Return a text with invisible characters as JSON's escapes, so that JSON keeps its meaning."""
    return _UNSAFE.sub(_written_out, text)


def _written_out(found: re.Match[str]) -> str:
    code = found[0].encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{code[at : at + 4]}" for at in range(0, len(code), 4))


def emit(text: str) -> None:
    """Write a line to standard output."""
    print(plain(text), flush=True)


class Unfailing(io.FileIO):
    """A file whose writes never fail, so that output cannot end a command on which robots depend.

    Args:
        on_full: called once, with the error, if a disk is full. A reader that has left is not reported.

    Attributes:
        full: whether data were lost because a disk was full.
    """

    def __init__(self, fd: int, on_full: Callable[[OSError], None]) -> None:
        super().__init__(fd, "wb", closefd=False)
        self._on_full: Final = on_full
        # For a terminal that is gone the system reports the error of a broken disk, and no longer a terminal.
        self._left: Final = (*_LEFT, errno.EIO) if stat.S_ISCHR(os.fstat(fd).st_mode) else _LEFT
        self.full = False

    def write(self, data: Any) -> int | None:  # type: ignore[override]
        """Write as much data as possible; return the length of all of them."""
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
        styled: whether colours pass, but no other sequences; only for texts without untrusted colours.
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
        # Also called by the garbage collector, when the stream behind may already be closed.
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
    """Formats log messages, tracebacks included, through `plain`."""

    def format(self, record: logging.LogRecord) -> str:
        return plain(super().format(record))


def behind(stream: TextIO) -> TextIO:
    """Return the stream behind a `PlainStream`, for a console whose own colours and cursor moves must pass."""
    return stream.stream if isinstance(stream, PlainStream) else stream


_STREAMS: Final = ("stdin", "stdout", "stderr")


def _open_what_is_closed() -> None:
    """Open the null device for closed standard streams, whose descriptors the next opened file would get."""
    while (fd := os.open(os.devnull, os.O_RDWR)) < len(_STREAMS):
        os.set_inheritable(fd, True)
        setattr(sys, _STREAMS[fd], os.fdopen(fd, "w" if fd else "r", closefd=False))
    os.close(fd)


def guard_streams(on_full: Callable[[OSError], None]) -> list[Unfailing]:
    """Make standard output and standard error write through `plain`.

    The command-line library's messages on wrong usage have colours, and repeat the command's arguments.

    Args:
        on_full: called once for each of the two streams on a full disk, instead of failing.

    Returns:
        The files behind the two streams.
    """
    _open_what_is_closed()
    harmless = all(plain(argument) == argument for argument in sys.argv)
    files = []
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            # A character that a terminal cannot show becomes a question mark, instead of an error that ends the run.
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
        # As Python does for unbuffered output.
        file if stream.write_through else io.BufferedWriter(file),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
