"""Starts and ends simulators in processes of their own, for adapters that are given no robots."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
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
    """Start a module that takes `--parent PID`, with which it ends when this process does, however this one ends.

    Args:
        module: the module that `python -m` runs, found as this process would find it.
        arguments: further arguments.
        pipes: whether its standard input and output are pipes to this process.
        environment: its environment, apart from `PYTHONPATH`.
    """
    kind = subprocess.PIPE if pipes else subprocess.DEVNULL
    paths = os.pathsep.join(filter(None, sys.path))
    # In a session of its own: Ctrl-C in a terminal is for the program that commands the robots, which stops them first.
    return subprocess.Popen(
        [sys.executable, "-m", module, "--parent", str(os.getpid()), *arguments],
        stdin=kind, stdout=kind, start_new_session=True,
        # numpy would start a thread for each core, which takes a quarter of the time of its import.
        env={"OPENBLAS_NUM_THREADS": "1", **environment, "PYTHONPATH": paths},
    )  # fmt: skip


def hand_over(process: subprocess.Popen[bytes], module: str, described: bytes) -> dict[str, Any]:
    """Send a world to a simulator, close its input, and return where its robots are, as it says.

    Raises:
        RobotUnavailable: the simulator does not start.
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
    """Send a program its input, close that, and return the first line that it prints, which it does once it is ready.

    Args:
        process: the program, started with pipes.
        described: all of its standard input.

    Raises:
        OSError: the program has ended, or prints nothing in time.
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
        what: its name in messages.
        module: the module that `python -m` runs.
        described: its world.
        arguments: further arguments.

    Attributes:
        process: the child process.
        told: where its robots are, as it says.
        truth: address of its ground truth, `host:port`.

    Raises:
        RobotUnavailable: the simulator does not start.
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


class Faults:
    """Brings faults into simulated robots of this host, each within one of their periods.

    Args:
        control: what their simulator prints as `control`; see `soter_sim.faults`.
    """

    def __init__(self, control: Mapping[str, Any]) -> None:
        self._port: Final[int] = control["port"]
        self._key: Final[str] = control["key"]

    def step_clock(self, robot_id: int, seconds: float) -> None:
        """Set a robot's own clock forward, or back if negative."""
        self._ask({"robot": robot_id, "step_clock_s": seconds})

    def stop_clock(self, robot_id: int) -> None:
        """Let a robot's own clock stand still from now on, while its program goes on."""
        self._ask({"robot": robot_id, "stop_clock": True})

    def restart(self, robot_id: int) -> None:
        """Reboot a robot's computer: it forgets all commands, and its clock begins anew."""
        self._ask({"robot": robot_id, "restart": True})

    def _ask(self, asked: dict[str, object]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.sendto(json.dumps({**asked, "key": self._key}).encode(), ("127.0.0.1", self._port))


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
    """End processes and wait until they are gone; kill those that do not end in time. Idempotent."""
    for process in processes:
        process.terminate()
        # A stopped process could not end by itself.
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
