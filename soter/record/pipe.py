"""The run's side of a recording: a pipe to the process that writes it."""

from __future__ import annotations

import contextlib
import fcntl
import io
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from soter.record.wire import Task, WriterOutcome

CAPACITY_BYTES: Final = 1 << 20
"""Requested size of the pipe on a wall clock: more than a minute of two robots at 20 Hz. The system may give less."""

BUSY_CAPACITY_BYTES: Final = 1 << 18
"""The same in virtual time: less, since data in the pipe are not in the file yet."""

HELD_BYTES: Final = 1 << 24
"""Largest frame: the run holds the part of a frame that the pipe does not take yet."""

_KILLED: Final = "its writer was killed"

READY_S: Final = 10.0
"""Host time that the writer is given to start."""

_LOOK_S: Final = 0.1

CLOSE_S: Final = 30.0
"""Host time that the writer is given at the end for the data still in the pipe."""


class WriterPipe:
    """Starts the writer and passes frames on to it. Used from one thread.

    Args:
        path: the file. An existing one is replaced when the new recording is complete, and stays if the run does not
            come to its end; a file that does not exist yet is written in place from the start.
        waits: whether to wait if the writer does not keep up, which loses nothing; if not, frames are dropped.
        sign: the private key to sign the recording with, or None.
        stop: returns whether the run is to end; then it no longer waits for a suspended writer.

    Attributes:
        writing: the file that is written.
        failure: why the writer has failed; empty while it works.

    Raises:
        OSError: the file cannot be written, or no process started.
    """

    def __init__(
        self, path: Path, *, waits: bool, sign: Path | None = None, stop: Callable[[], bool] = lambda: False
    ) -> None:
        self._waits = waits
        self._stop: Final = stop
        self.failure = ""
        # The file behind a link is replaced, not the link.
        target = path.resolve()
        replaces = target.is_file() and target.stat().st_size > 0
        self.writing: Final = target.with_name(f"{target.name}.{os.getpid()}.new") if replaces else path
        # Opening a pipe without a reader fails at once, instead of waiting.
        file_fd = os.open(self.writing, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NONBLOCK, 0o666)
        os.set_blocking(file_fd, True)
        try:
            source, sink = os.pipe()
        except OSError:
            os.close(file_fd)
            raise
        # A buffer knows to the byte what was written, even if a signal handler raises within a write.
        self._sink: Final = io.BufferedWriter(io.FileIO(sink, "wb"), HELD_BYTES)
        capacity = _resized(sink, BUSY_CAPACITY_BYTES if waits else CAPACITY_BYTES)
        # The writer must import the same modules, however this process came to find them.
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)}
        how = msgspec.json.encode(Task(
            nice=not waits, sign=None if sign is None else str(sign.absolute()),
            part=str(self.writing.absolute()), target=str(target) if replaces else None,
        )).decode()  # fmt: skip
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "soter.record.writer", str(file_fd), str(capacity), how],
                stdin=source,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=env,
                pass_fds=(file_fd,),
                start_new_session=True,
            )
        except BaseException:
            self._sink.close()
            raise
        finally:
            os.close(source)
            os.close(file_fd)

    @property
    def pid(self) -> int:
        """The writer's process id."""
        return self._process.pid

    def send(self, frame: bytes) -> bool:
        """Pass a frame on; return False if it was dropped, because the writer does not keep up or has ended."""
        if self.failure:
            return False
        if len(frame) > HELD_BYTES:
            self.failure = f"a frame of {len(frame)} bytes is too large for its writer, which takes {HELD_BYTES}"
            return False
        try:
            if not self._taken():
                return False
            self._sink.write(frame)
            self._taken()
        except BrokenPipeError:
            self._gone()
            return False
        return True

    def wait_ready(self) -> None:
        """Wait until the first frame is in the file, for at most `READY_S`: without it nothing can be read."""
        os.set_blocking(self._sink.fileno(), False)
        out = self._process.stdout
        if self.failure or out is None or not select.select([out], [], [], READY_S)[0]:
            return
        said = os.read(out.fileno(), 1 << 16).strip()
        if said:
            self._fail(said)

    def close(self, last: bytes) -> WriterOutcome:
        """Send a last frame, which may be empty, and end the writer; wait for at most `CLOSE_S`."""
        until_s = time.monotonic() + CLOSE_S
        self._go_on()
        if not self.failure:
            try:
                self._end(last, until_s)
            except BrokenPipeError:
                self._gone()
        with contextlib.suppress(OSError):
            self._sink.close()
        try:
            said, _ = self._process.communicate(timeout=max(0.1, until_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            return WriterOutcome(
                self.failure or f"its writer, process {self.pid}, was still at work after {CLOSE_S:g} s"
            )
        if self.failure:
            return WriterOutcome(self.failure)
        try:
            return msgspec.json.decode(said, type=WriterOutcome)
        except msgspec.DecodeError:
            return WriterOutcome(_KILLED)

    def _taken(self) -> bool:
        """Pass on the held data, waiting if the run may wait; return whether all were passed on."""
        while not self._pushed():
            if not self._waits:
                return False
            if self._stop():
                self._go_on()
                return self._drained(time.monotonic() + CLOSE_S)
            select.select([], [self._sink], [], _LOOK_S)
        return True

    def _go_on(self) -> None:
        """Resume the writer if it was suspended, since the run ends now."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGCONT)

    def _pushed(self) -> bool:
        """Pass on as much of the held data as the pipe takes; return whether all were passed on."""
        try:
            self._sink.flush()
        except BlockingIOError:
            return False
        return True

    def _end(self, last: bytes, until_s: float) -> None:
        """Send a last frame; wait for that, even if the run does not wait otherwise."""
        self._waits = False
        os.set_blocking(self._sink.fileno(), False)
        sent = self._drained(until_s) and self.send(last) and self._drained(until_s)
        if not sent and not self.failure:
            self.failure = f"its writer, process {self.pid}, did not take its end within {CLOSE_S:g} s"

    def _drained(self, until_s: float) -> bool:
        """Pass on the held data, waiting until `until_s`; return whether all were passed on."""
        while not self._pushed():
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                return False
            select.select([], [self._sink], [], left_s)
        return True

    def _gone(self) -> None:
        """Read why the writer has ended; it reports that before it closes the pipe."""
        self.failure = _KILLED
        if self._process.stdout is None:
            return
        os.set_blocking(self._process.stdout.fileno(), False)
        said = self._process.stdout.read()
        if said:
            self._fail(said)

    def _fail(self, said: bytes) -> None:
        with contextlib.suppress(msgspec.DecodeError):
            self.failure = msgspec.json.decode(said, type=WriterOutcome).failure or "its writer has ended"


def _resized(fd: int, capacity_bytes: int) -> int:
    """Set the capacity of a pipe; return the actual one."""
    with contextlib.suppress(OSError):
        fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, capacity_bytes)
    return fcntl.fcntl(fd, fcntl.F_GETPIPE_SZ)
