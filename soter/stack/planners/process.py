"""One worker process and the socket to it, seen from the mission's side."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from soter.stack.planners.wire import MAX_MESSAGE_BYTES
from soter.stack.planners.worker import BOOTSTRAP, WorkerSpec

KILL_LIMIT_S = 5.0
"""A killed process is gone after milliseconds, unless the kernel holds it in a call, in seconds."""


class WorkerDied(Exception):
    """The worker process is gone, or has closed its socket; the message says how it ended."""


class WorkerProcess:
    """A fresh interpreter that runs `worker.main`.

    It is not made by multiprocessing: a spawned child would run the user's main module again, and a forked one
    would inherit locks that threads of the mission hold. It has a session of its own, so that Ctrl-C reaches the
    mission only; no standard streams; and one thread for numerical libraries.
    """

    def __init__(self, spec: WorkerSpec) -> None:
        # Packets, not a stream: a message arrives whole or not at all, whatever the worker does.
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        life_read, self._life_write = os.pipe()
        self._buffer: Final = bytearray(MAX_MESSAGE_BYTES)
        # The same hash seed everywhere, so that a planner that iterates over a set still repeats itself.
        env = {**os.environ, "PYTHONHASHSEED": "0"}
        env.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
        try:
            with tempfile.TemporaryFile() as stdin:
                pickle.dump([str(Path(entry).absolute()) for entry in sys.path], stdin)
                pickle.dump(spec, stdin)
                stdin.seek(0)
                self._process = subprocess.Popen(
                    [sys.executable, "-c", BOOTSTRAP, str(theirs.fileno()), str(life_read)],
                    stdin=stdin,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    env=env,
                    pass_fds=(theirs.fileno(), life_read),
                    start_new_session=True,
                )
        except BaseException:
            self._socket.close()
            os.close(self._life_write)
            raise
        finally:
            theirs.close()
            os.close(life_read)

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def send(self, data: bytes) -> None:
        """Send one message. It never blocks.

        Raises:
            WorkerDied: nobody is there to read it.
        """
        try:
            self._socket.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except (BrokenPipeError, ConnectionResetError, BlockingIOError):
            raise WorkerDied(self._how_it_ended()) from None

    def receive(self, timeout_s: float) -> bytes | None:
        """Return one message, or None if none comes within `timeout_s` of host time; 0 only looks.

        Raises:
            WorkerDied: there is none and there will be none.
        """
        self._socket.settimeout(timeout_s)
        try:
            length = self._socket.recv_into(self._buffer)
        except (TimeoutError, BlockingIOError):
            return None
        except ConnectionResetError:
            length = 0
        if length == 0:
            raise WorkerDied(self._how_it_ended())
        return bytes(memoryview(self._buffer)[:length])

    def kill(self) -> None:
        """Kill the worker with whatever it has started, and wait at most `KILL_LIMIT_S` until it is gone."""
        if self._process.returncode is None:
            # Before the process is waited for: until then nobody else can have its id.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(KILL_LIMIT_S)
        if self._life_write >= 0:
            self._socket.close()
            os.close(self._life_write)
            self._life_write = -1

    def _how_it_ended(self) -> str:
        # The socket closes a moment before the process ends. It is left waitable (WNOWAIT): see kill().
        for _ in range(50):
            if ended := os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG):
                if ended.si_code == os.CLD_EXITED:
                    return f"exit code {ended.si_status}"
                return f"signal {signal.Signals(ended.si_status).name}"
            time.sleep(0.004)
        return "it closed its socket"
