"""Starts and ends a process with simulated vehicles."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from itertools import count, islice
from typing import Final

from soter.errors import BackendError
from soter.sdk.program import Program

_LOWEST: Final = 20_000
_PORTS: Final = 12_000
"""Ports that are given out here: below those that the kernel takes for sockets that ask for none."""

_turns: Final = count(61 * os.getpid())


def free_port() -> int:
    """Return a UDP port of this host that is free at the moment, and that no other process is likely to take."""
    for turn in islice(_turns, _PORTS):
        port = _LOWEST + turn % _PORTS
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise BackendError(f"no UDP port of this host is free, tried: {_LOWEST} to {_LOWEST + _PORTS - 1}")


class MavlinkSimulator(Program):
    """Simulated vehicles that send to a UDP port of this host."""

    def __init__(self, world: bytes, port: int, *options: str) -> None:
        super().__init__("the simulator of the vehicles", "soter_sim.mavlink", world, "--udp", str(port), *options)
