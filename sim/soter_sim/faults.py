"""Takes faults for simulated robots, as tests ask for them, on a UDP port of this host.

A message is JSON: the key that only who has started the robots is told, the number of one, and what is to happen, such
as `{"key": "5f1c", "robot": 1, "step_clock_s": -30.0}`, or with `"stop_clock": true` or `"restart": true`. What makes
no sense is dropped. `soter.sdk.program.Faults` sends them.
"""

from __future__ import annotations

import json
import logging
import secrets
import socket
from collections.abc import Mapping
from contextlib import suppress
from math import isfinite
from typing import Any, Final, Protocol

logger = logging.getLogger(__name__)

_MOST_BYTES: Final = 1000

_AT_ONCE: Final = 16
"""So many messages are taken at a time, so that a flood of them does not hold the world up."""


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
        self._key: Final = secrets.token_hex(16)
        self._dropped = 0
        self._socket: Final = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", 0))

    @property
    def control(self) -> dict[str, Any]:
        """What `soter.sdk.program.Faults` has to know: the port's number and the key."""
        return {"port": self._socket.getsockname()[1], "key": self._key}

    def take(self) -> None:
        """Bring about the faults that were asked for since, without waiting."""
        with suppress(BlockingIOError):
            for _ in range(_AT_ONCE):
                message = self._socket.recv(_MOST_BYTES)
                try:
                    self._bring_about(json.loads(message))
                except (ValueError, TypeError, LookupError, RecursionError) as failure:
                    if not self._dropped:
                        logger.warning("dropped a fault that makes no sense, or has another key: %s", type(failure))
                    self._dropped += 1

    def _bring_about(self, asked: dict[str, Any]) -> None:
        if not secrets.compare_digest(asked["key"], self._key):
            raise ValueError("another key")
        robot, seconds = self._robots[asked["robot"]], float(asked.get("step_clock_s", 0.0))
        if not isfinite(seconds):
            raise ValueError("a clock that is not finite")
        robot.step_clock(seconds)
        if asked.get("stop_clock"):
            robot.stop_clock()
        if asked.get("restart"):
            robot.restart()

    def close(self) -> None:
        """Close the port. Idempotent."""
        self._socket.close()
