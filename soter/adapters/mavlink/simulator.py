"""Starts simulated vehicles as a process of their own, and ends them."""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from soter.geometry.workspace import Box, Workspace
from soter.sdk import RobotSpec, RuleLimits, program

_MODULE: Final = "soter_sim.mavlink"


def describe(
    workspace: Workspace,
    robots: Sequence[RobotSpec],
    limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
) -> dict[str, Any]:
    """Return a world as `soter_sim.mavlink` reads it: metres, east and north, radians counter-clockwise from east."""
    return {
        "width_m": workspace.width_m,
        "depth_m": workspace.depth_m,
        "boxes": [_edges(box) for box in workspace.boxes],
        "chargers": [_edges(place.charger) for place in workspace.robots],
        "robots": [{name: value for name, value in asdict(spec).items() if name != "name"} for spec in robots],
        "limits": asdict(limits),
    }


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

    def __init__(self, world: Mapping[str, Any], port: int, *options: str) -> None:
        self.process: Final = program.start(_MODULE, "-", "--udp", str(port), *options)
        try:
            self.truth: Final[str] = program.hand_over(self.process, _MODULE, json.dumps(world).encode())["truth"]
        except BaseException:
            self.close()
            raise

    def lost(self) -> str:
        """Return how the process has ended, in words; empty while it runs."""
        return program.ended("the simulator of the vehicles", self.process)

    def close(self) -> None:
        """End the process and wait until it is gone. Idempotent."""
        program.end([self.process])


def _edges(box: Box) -> tuple[float, float, float, float]:
    return box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m
