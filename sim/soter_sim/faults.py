"""Takes faults for simulated robots, as tests ask for them, on a UDP port of this host.

A message is JSON, such as `{"robot": 1, "step_clock_s": -30.0}`, `{"robot": 1, "stop_clock": true}` or
`{"robot": 1, "restart": true}`; `soter.sdk.program.Faults` sends them.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final, Protocol

_MOST_BYTES: Final = 1000


class Faulty(Protocol):
    """A simulated robot with a clock of its own."""

    def step_clock(self, seconds: float) -> None:
        """Set the robot's clock forward, or back if negative."""

    def stop_clock(self) -> None:
        """Let the robot's clock stand still from now on."""

    def restart(self) -> None:
        """Reboot the robot's computer: it forgets all commands, and its clock begins anew."""


class FaultPort:
    """The port of one world.

    Args:
        robots: its robots, by number.
    """

    def __init__(self, robots: Mapping[int, Faulty]) -> None:
        self._robots: Final = robots
        self._socket: Final = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", 0))

    @property
    def number(self) -> int:
        """The port's number."""
        port: int = self._socket.getsockname()[1]
        return port

    def take(self) -> None:
        """Bring about the faults that were asked for since, without waiting."""
        with suppress(BlockingIOError):
            while True:
                asked = json.loads(self._socket.recv(_MOST_BYTES))
                robot = self._robots[asked["robot"]]
                robot.step_clock(asked.get("step_clock_s", 0.0))
                if asked.get("stop_clock"):
                    robot.stop_clock()
                if asked.get("restart"):
                    robot.restart()

    def close(self) -> None:
        """Close the port. Idempotent."""
        self._socket.close()
