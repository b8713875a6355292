"""The run's end of a recording: a pipe to the process that writes it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import msgspec

from soter.record.outcome import Outcome

CAPACITY_BYTES: Final = 1 << 20
"""What is asked for on a wall clock: more than a minute of two robots at 20 Hz. The system may give less."""

BUSY_CAPACITY_BYTES: Final = 1 << 18
"""The same in virtual time: what is in the pipe is not in the file yet."""

_KILLED: Final = "its writer was killed"

READY_S: Final = 10.0
"""Host time that the writer is given to start."""

CLOSE_S: Final = 30.0
"""Host time that the writer is given at the end for what is still in the pipe."""


class WriterPipe:
    """Starts the writer and passes frames on to it. Used from one thread.

    Args:
        path: the file; what was in it is gone.
        waits: whether to wait when the writer does not follow, which loses nothing; if not, frames are dropped.

    Attributes:
        failure: why there is no writer any more; empty while there is.

    Raises:
        OSError: the file cannot be written, or no process be started.
    """

    def __init__(self, path: Path, *, waits: bool) -> None:
        self._waits: Final = waits
        self._rest = memoryview(b"")
        self.failure = ""
        file_fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        try:
            source, self._sink = os.pipe()
        except OSError:
            os.close(file_fd)
            raise
        capacity = _resized(self._sink, BUSY_CAPACITY_BYTES if waits else CAPACITY_BYTES)
        # The writer is found where this module was, whatever made it importable.
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)}
        how = [] if waits else ["nice"]
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "soter.record.writer", str(file_fd), str(capacity), *how],
                stdin=source,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=env,
                pass_fds=(file_fd,),
                start_new_session=True,
            )
        except BaseException:
            os.close(self._sink)
            raise
        finally:
            os.close(source)
            os.close(file_fd)
        os.set_blocking(self._sink, waits)

    @property
    def pid(self) -> int:
        """The writer's process id."""
        return self._process.pid

    def send(self, frame: bytes) -> bool:
        """Pass a frame on; return False if it was dropped, because the writer does not follow or has ended."""
        if self.failure:
            return False
        try:
            if len(self._rest):
                self._push()
                if len(self._rest):
                    return False
            self._rest = memoryview(frame)
            self._push()
        except BrokenPipeError:
            self._gone()
            return False
        if len(self._rest) == len(frame):
            self._rest = memoryview(b"")
            return False
        return True

    def wait_ready(self) -> None:
        """Wait until the first frame stands in the file, for at most `READY_S`: nothing is recorded before that."""
        out = self._process.stdout
        if self.failure or out is None or not select.select([out], [], [], READY_S)[0]:
            return
        said = os.read(out.fileno(), 1 << 16).strip()
        if said:
            self._fail(said)

    def close(self, last: bytes) -> Outcome:
        """Send a last frame and end the writer; wait for at most `CLOSE_S`. Empty if the run has nothing to say."""
        if not self.failure:
            try:
                self._waits_until(time.monotonic() + CLOSE_S, last)
            except BrokenPipeError:
                self._gone()
        with contextlib.suppress(OSError):
            os.close(self._sink)
        try:
            said, _ = self._process.communicate(timeout=CLOSE_S)
        except subprocess.TimeoutExpired:
            return Outcome(self.failure or f"its writer, process {self.pid}, was still at work after {CLOSE_S:g} s")
        if self.failure:
            return Outcome(self.failure)
        try:
            return msgspec.json.decode(said, type=Outcome)
        except msgspec.DecodeError:
            return Outcome(_KILLED)

    def _push(self) -> None:
        while len(self._rest):
            try:
                sent = os.write(self._sink, self._rest)
            except BlockingIOError:
                return
            # Kept up to date in every round: a signal's handler may raise in the next.
            self._rest = self._rest[sent:]

    def _waits_until(self, until_s: float, last: bytes) -> None:
        os.set_blocking(self._sink, False)
        for frame in (self._rest, memoryview(last)):
            self._rest = frame
            while len(self._rest) and time.monotonic() < until_s:
                select.select([], [self._sink], [], max(0.0, until_s - time.monotonic()))
                self._push()

    def _gone(self) -> None:
        """Learn why the writer has ended; it says so before it lets go of the pipe."""
        self.failure = _KILLED
        if self._process.stdout is None:
            return
        os.set_blocking(self._process.stdout.fileno(), False)
        said = self._process.stdout.read()
        if said:
            self._fail(said)

    def _fail(self, said: bytes) -> None:
        with contextlib.suppress(msgspec.DecodeError):
            self.failure = msgspec.json.decode(said, type=Outcome).failure or "its writer has ended"


def _resized(fd: int, capacity_bytes: int) -> int:
    """Let a pipe hold so much; return what it does hold."""
    with contextlib.suppress(OSError):
        fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, capacity_bytes)
    return fcntl.fcntl(fd, fcntl.F_GETPIPE_SZ)
