"""Simulators in processes of their own, as adapters start them where no robot is given: how they begin and end."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

from soter.errors import RobotUnavailable

_START_TIMEOUT_S: Final = 30.0
_END_TIMEOUT_S: Final = 3.0


def start(
    module: str, *arguments: str, pipes: bool = True, environment: Mapping[str, str] = os.environ
) -> subprocess.Popen[bytes]:
    """Start a module that takes `--parent PID`, by which it ends with this process, however this one ends.

    Args:
        module: what `python -m` runs; found where this process would find it.
        arguments: more of them.
        pipes: whether it is handed something on standard input, and says something on standard output.
        environment: of the process, besides that of Python.
    """
    kind = subprocess.PIPE if pipes else subprocess.DEVNULL
    paths = os.pathsep.join(filter(None, sys.path))
    # A session of its own: Ctrl-C in a terminal is for who commands the robots, and stops them in good order.
    return subprocess.Popen(
        [sys.executable, "-m", module, "--parent", str(os.getpid()), *arguments],
        stdin=kind, stdout=kind, start_new_session=True, env={**environment, "PYTHONPATH": paths},
    )  # fmt: skip


def hand_over(process: subprocess.Popen[bytes], module: str, described: bytes) -> dict[str, Any]:
    """Hand a world to a simulator, whose input ends behind it, and return what it says of where its robots are.

    Raises:
        RobotUnavailable: it does not start.
    """
    try:
        told = json.loads(first_line(process, described))
    except (ValueError, OSError) as failure:
        raise RobotUnavailable(
            f"the simulated robots do not start: {failure}; what they say is on standard error, and "
            f"`{sys.executable} -m {module} --help` must work"
        ) from failure
    assert isinstance(told, dict)
    return told


def first_line(process: subprocess.Popen[bytes], described: bytes = b"") -> bytes:
    """Hand something to a program and return the first line that it prints, once it is ready.

    Args:
        process: started with pipes.
        described: what is handed over; its standard input ends behind it.

    Raises:
        OSError: it has ended, or says nothing in time.
    """
    into, out = process.stdin, process.stdout
    assert into is not None
    assert out is not None
    into.write(described)
    into.close()
    until_s = time.perf_counter() + _START_TIMEOUT_S
    line = b""
    while not line.endswith(b"\n"):
        left_s = until_s - time.perf_counter()
        if left_s <= 0.0 or not select.select([out], [], [], left_s)[0]:
            raise OSError(f"nothing was heard of them within {_START_TIMEOUT_S:g} s")
        part = os.read(out.fileno(), 65536)
        if not part:
            raise OSError(f"their process ended with code {process.wait()}")
        line += part
    return line


class Program:
    """A simulator in a process of its own, which ends with this one, however this one ends.

    Args:
        what: what it is called in messages.
        module: what `python -m` runs.
        described: its world.
        arguments: more of the program's.

    Attributes:
        process: the child.
        told: what it says of where its robots are.
        truth: where it tells what really happens, as `host:port`.

    Raises:
        RobotUnavailable: it does not start.
    """

    def __init__(self, what: str, module: str, described: bytes, *arguments: str) -> None:
        self._what: Final = what
        self.process: Final = start(module, *arguments)
        try:
            self.told: Final = hand_over(self.process, module, described)
            self.truth: Final[str] = self.told["truth"]
        except BaseException:
            self.close()
            raise

    def lost(self) -> str:
        """Return how the process has ended, in words; empty while it runs."""
        return ended(self._what, self.process)

    def close(self) -> None:
        """End the process and wait until it is gone. Idempotent."""
        end([self.process])


def ended(what: str, process: subprocess.Popen[bytes]) -> str:
    """Return how a process has ended, or been stopped, in words; empty while it runs."""
    code = process.poll()
    if code is not None:
        how = f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"
        return f"{what}, process {process.pid}, has ended with {how}"
    stopped = os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT | os.WNOHANG)
    if stopped is None:
        return ""
    return f"{what}, process {process.pid}, was stopped by signal {signal.Signals(stopped.si_status).name}"


def end(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End processes and wait until they are gone; those that do not go in time are killed. Idempotent."""
    for process in processes:
        process.terminate()
        # One that was stopped could not end by itself.
        process.send_signal(signal.SIGCONT)
    for process in processes:
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None and not pipe.closed:
                pipe.close()
