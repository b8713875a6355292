"""Starts simulated vehicles as a process of their own, and ends them."""

from __future__ import annotations

import socket
from typing import Final

from soter.sdk import program

_MODULE: Final = "soter_sim.mavlink"


def free_port() -> int:
    """Return a UDP port of this host that nobody uses at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class MavlinkSimulator:
    """Simulated vehicles in a process, which ends with this one, however this one ends.

    Attributes:
        process: the child.
        truth: where it tells what really happens, as host:port.

    Raises:
        RobotUnavailable: it does not start.
    """

    def __init__(self, world: bytes, port: int, *options: str) -> None:
        self.process: Final = program.start(_MODULE, "--udp", str(port), *options)
        try:
            self.truth: Final[str] = program.hand_over(self.process, _MODULE, world)["truth"]
        except BaseException:
            self.close()
            raise

    def lost(self) -> str:
        """Return how the process has ended, in words; empty while it runs."""
        return program.ended("the simulator of the vehicles", self.process)

    def close(self) -> None:
        """End the process and wait until it is gone. Idempotent."""
        program.end([self.process])
