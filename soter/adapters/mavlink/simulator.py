"""Starts and ends a process with simulated vehicles."""

from __future__ import annotations

import socket

from soter.sdk.program import Program


def free_port() -> int:
    """Return a UDP port of this host that is free at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class MavlinkSimulator(Program):
    """Simulated vehicles that send to a UDP port of this host."""

    def __init__(self, world: bytes, port: int, *options: str) -> None:
        super().__init__("the simulator of the vehicles", "soter_sim.mavlink", world, "--udp", str(port), *options)
