"""Harnesses of adapters that fail, for what the kit and its command line do about it; named as users name theirs."""

from __future__ import annotations

import faulthandler
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar

from soter.adapters.pybullet import KinematicBackend
from soter.adapters.pybullet.backend import SimulatedRobot
from soter.errors import RobotUnavailable
from soter.sdk import Capabilities, Fleet
from tests.broken.goals import NoOpStop
from tests.conformance.simulated import SimulatedHarness
from tests.conformance.wire import WireRobot


class FailingHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(NoOpStop)


class WireBackend(KinematicBackend):
    robot_class = WireRobot  # type: ignore[assignment] # `open` below makes them


class OneAtATime(SimulatedHarness):
    """A right adapter whose harness says nothing of fleets side by side."""

    def __init__(self) -> None:
        super().__init__(SimulatedRobot)


class Crashing(SimulatedRobot):
    """Is told to stop, and crashes."""

    def _halt(self) -> None:
        faulthandler._sigsegv()  # type: ignore[attr-defined] # what a null pointer in a library does


class CrashingHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(Crashing)


class Exiting(SimulatedRobot):
    def _halt(self) -> None:
        os._exit(7)


class ExitingHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(Exiting)


class Stuck(SimulatedRobot):
    """Is told to stop, and blocks where no signal of Python's gets through."""

    def _halt(self) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM, signal.SIGTERM})
        signal.pause()


class StuckHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(Stuck)


class Complaining(SimulatedRobot):
    """Raises what a vendor's library raises where it is told to stop and drives nowhere."""

    def _halt(self) -> None:
        if self._vehicle.mux.command is None or self._v[self._index] == 0.0:
            raise LookupError("no active task")
        super()._halt()


class LeakingToDeath(SimulatedRobot):
    """Leaves sockets behind whenever it is connected, and crashes when they are too many."""

    left: ClassVar[list[object]] = []

    def _connect(self, timeout_s: float) -> Capabilities:
        self.left.extend(socket.socketpair() for _ in range(6))
        if len(self.left) > 12:
            faulthandler._sigsegv()  # type: ignore[attr-defined] # as above
        return super()._connect(timeout_s)


class LeakingToDeathHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(LeakingToDeath)


class Dead(SimulatedRobot):
    """Is never there."""

    def _connect(self, timeout_s: float) -> Capabilities:
        raise RobotUnavailable("nobody answers at tcp://127.0.0.1:1")


class DeadHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(Dead)


class Hanging(SimulatedRobot):
    """Waits for an answer that never comes."""

    def _connect(self, timeout_s: float) -> Capabilities:
        while True:
            time.sleep(timeout_s)


class CrashingAtImportHarness(SimulatedHarness):
    def __init__(self) -> None:
        os.abort()


class MisspeltHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(SimulatedRobot, enginne="kinematic")  # type: ignore[call-arg] # that is the mistake


class Slow(SimulatedRobot):
    """Takes for ever to stop, and says in a file of the folder that it is run in what becomes of it."""

    def _halt(self) -> None:
        print("stopping", flush=True, file=sys.stderr)
        while True:
            time.sleep(0.01)

    def _disconnect(self, timeout_s: float) -> None:
        Path("closed").touch()
        super()._disconnect(timeout_s)


class SlowHarness(SimulatedHarness):
    """Has a process of its own beside the robots."""

    def __init__(self) -> None:
        super().__init__(Slow)

    def open(self, robots: int) -> Fleet:
        program = [sys.executable, "-S", "-c", "import signal; signal.pause()"]
        Path("pid").write_text(str(subprocess.Popen(program).pid), encoding="ascii")
        return super().open(robots)
