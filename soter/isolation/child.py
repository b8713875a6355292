"""Runs untrusted code in a fresh process with limits, which never outlives its parent.

The parent may pickle its messages to the process; the messages of the process are bytes, which the parent must check.
When memory runs out, the kernel kills this process first.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pickle
import resource
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import BinaryIO, Final

from soter.isolation import sandbox
from soter.isolation.sandbox import InForce, SandboxRules
from soter.scratch import Scratch

MAX_MESSAGE_BYTES: Final = 1 << 17
"""The longest message; one packet of a Unix socket holds more."""

KILL_LIMIT_S: Final = 5.0
"""Longest wait for a killed process, in seconds: milliseconds are enough, unless the kernel holds it in a call."""

PATIENCE_S: Final = 0.2
"""How long to wait for the end of a process whose socket has closed, in seconds: the socket closes a bit earlier."""

_LOOK_S: Final = 0.004
_OOM_SCORE_ADJ: Final = Path("/proc/self/oom_score_adj")
_KILLED_FIRST: Final = "1000"

_BOOTSTRAP: Final = """\
import sys
sys.path[:] = filter(None, sys.path)
import pickle
given = sys.stdin.buffer, int(sys.argv[1]), int(sys.argv[2])
sys.path[:] = pickle.load(given[0])
from soter.isolation.child import begin
begin(*given)
from {module} import main
main(*given)
"""
"""The child's program. Before `begin` nothing is imported from the present folder, which is the user's."""


class ChildDied(Exception):
    """The process is gone, or has closed its socket; the message says how it ended."""


class NotBoxed(ChildDied):
    """The kernel cannot enforce a required restriction on the process; the message says which, and why."""


class Child:
    """A fresh interpreter that runs a module's `main(stdin, socket_fd, lifeline_fd)`.

    `stdin` holds the pickled `payload`; the socket carries packets; the lifeline is the read end of a pipe, for
    `die_with_parent`.

    It does not use multiprocessing: a spawned child would run the user's main module again, and a forked one would
    inherit locks that threads hold. It has a session of its own, so that Ctrl-C reaches the parent only, and one
    thread for numerical libraries.

    Args:
        module: the module whose `main` is run.
        payload: the argument for `main`.
        output_fd: descriptor for its standard output and standard error; None for none.
        patience_s: how long `send` and `receive` may wait, once the socket is closed, to learn how the process ended.
        box: the rules of its sandbox, entered before the first line of untrusted code; None for no sandbox.

    Attributes:
        in_force: the restrictions of its sandbox; None before it has reported them, and without a sandbox.
    """

    def __init__(
        self,
        module: str,
        payload: object,
        *,
        output_fd: int | None = None,
        patience_s: float = PATIENCE_S,
        box: SandboxRules | None = None,
    ) -> None:
        self._patience_s: Final = patience_s
        self._box: Final = box
        self.in_force: InForce | None = None
        self._scratch: Final = None if box is None else Scratch("box")
        # Packets, not a stream: a message arrives whole or not at all, whatever the child does.
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        life_read, self._life_write = os.pipe()
        # One byte more than allowed: a packet that fills it was too long.
        self._buffer: Final = bytearray(MAX_MESSAGE_BYTES + 1)
        # The same hash seed everywhere, so that the order of sets is repeatable.
        env = {**os.environ, "PYTHONHASHSEED": "0"}
        env.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
        boxed = None
        if box is not None and self._scratch is not None:
            env["TMPDIR"] = str(self._scratch.path)
            boxed = box, str(self._scratch.path), dict(sandbox.inherited())
        output = subprocess.DEVNULL if output_fd is None else output_fd
        try:
            with tempfile.TemporaryFile() as stdin:
                pickle.dump([str(Path(entry).absolute()) for entry in sys.path], stdin)
                pickle.dump(boxed, stdin)
                pickle.dump(payload, stdin)
                stdin.seek(0)
                self._process = subprocess.Popen(
                    [sys.executable, "-c", _BOOTSTRAP.format(module=module), str(theirs.fileno()), str(life_read)],
                    stdin=stdin,
                    stdout=output,
                    stderr=output,
                    env=env,
                    pass_fds=(theirs.fileno(), life_read),
                    start_new_session=True,
                )
        except BaseException:
            self._socket.close()
            os.close(self._life_write)
            self._clear()
            raise
        finally:
            theirs.close()
            os.close(life_read)

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def send(self, data: bytes) -> bool:
        """Send one message without waiting; return whether there was room for it.

        Raises:
            ChildDied: the process is gone.
        """
        try:
            self._socket.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except BlockingIOError:
            return False
        except (BrokenPipeError, ConnectionResetError):
            raise ChildDied(self._how_it_ended()) from None
        return True

    def receive(self, timeout_s: float = 0.0) -> bytes | None:
        """Return one message, or None if none comes within `timeout_s` of host time; 0 does not wait.

        Raises:
            NotBoxed: the sandbox is required, and lacks a restriction.
            ChildDied: there are no more messages.
        """
        if self._box is not None and self.in_force is None:
            begun_s = time.perf_counter()
            data = self._received(timeout_s)
            if data is None:
                return None
            self.in_force = InForce.decoded(data)
            timeout_s = max(0.0, timeout_s - (time.perf_counter() - begun_s))
        if self._box is not None and self._box.required and self.in_force is not None and self.in_force.missing:
            raise NotBoxed(self.in_force.missing)
        return self._received(timeout_s)

    def _received(self, timeout_s: float) -> bytes | None:
        self._socket.settimeout(timeout_s)
        try:
            length = self._socket.recv_into(self._buffer)
        except (TimeoutError, BlockingIOError):
            return None
        except ConnectionResetError:
            length = 0
        if length == 0:
            raise ChildDied(self._how_it_ended())
        return bytes(memoryview(self._buffer)[:length])

    def end(self) -> None:
        """Kill the process and all that it has started, without waiting until it is gone."""
        if self._process.returncode is None:
            # Before the process is waited for: until then no other process can have its id.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def kill(self, grace_s: float = 0.0) -> None:
        """Close the link, kill the process, and wait at most `KILL_LIMIT_S` until it is gone. Idempotent.

        Args:
            grace_s: how long the process may take to end by itself once its link is closed, in host time.
        """
        if self._life_write >= 0:
            self._socket.close()
        if grace_s > 0.0:
            if self._process.returncode is None:
                # A suspended process could not use its time to end.
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self._process.pid, signal.SIGCONT)
            self._ended_within(grace_s)
        self.end()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(KILL_LIMIT_S)
        if self._life_write >= 0:
            os.close(self._life_write)
            self._life_write = -1
        self._clear()

    def _clear(self) -> None:
        if self._scratch is not None:
            self._scratch.close()

    def how_it_ended(self) -> str | None:
        """Return the process's exit code or signal in words, or None while it runs. Never waits."""
        # The process is left waitable (WNOWAIT): see end().
        ended = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
        if ended is None:
            return None
        if ended.si_code == os.CLD_EXITED:
            return f"exit code {ended.si_status}"
        return f"signal {signal.Signals(ended.si_status).name}"

    def _how_it_ended(self) -> str:
        return self._ended_within(self._patience_s) or "it closed its socket"

    def _ended_within(self, limit_s: float) -> str | None:
        until_s = time.perf_counter() + limit_s
        while self._process.returncode is None:
            ended = self.how_it_ended()
            if ended is not None or time.perf_counter() >= until_s:
                return ended
            time.sleep(_LOOK_S)
        return None


# --- in the child ------------------------------------------------------------------------------------------


def begin(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> None:
    """Enter the sandbox, if there is one, and send the restrictions in force as the first message."""
    with contextlib.suppress(OSError):
        _OOM_SCORE_ADJ.write_text(_KILLED_FIRST, encoding="ascii")
    boxed: tuple[SandboxRules, str, dict[str, str]] | None = pickle.load(stdin)  # noqa: S301 - from the parent
    if boxed is None:
        return
    box, scratch, inherited = boxed
    found = sandbox.enter(box, scratch, inherited, (socket_fd,), lifeline_fd)
    os.write(socket_fd, found.encoded())
    if box.required and found.missing:
        os._exit(1)


def die_with_parent(lifeline_fd: int) -> None:
    """Have the kernel kill this process when the other end of a pipe is closed, as at the parent's death.

    Unlike a watching thread, this works while the interpreter is held in an endless loop of C; unlike
    PR_SET_PDEATHSIG, it does not fire when only the thread that started this process ends.
    """
    fcntl.fcntl(lifeline_fd, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(lifeline_fd, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(lifeline_fd, fcntl.F_SETFL, fcntl.fcntl(lifeline_fd, fcntl.F_GETFL) | os.O_ASYNC)
    poll = select.poll()
    poll.register(lifeline_fd)
    if poll.poll(0):  # closed before the kernel was asked to watch
        os._exit(1)


def yield_to_others(niceness: int, memory_limit_bytes: int) -> None:
    """Lower the priority of this process, and limit its memory.

    Args:
        niceness: increase of this process's niceness over its parent's.
        memory_limit_bytes: address space that the process may add to its present one.
    """
    with contextlib.suppress(OSError):
        os.nice(niceness)
    now = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    wanted = now + memory_limit_bytes
    resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
