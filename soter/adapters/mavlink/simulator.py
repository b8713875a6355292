"""Starts simulated vehicles as a process of their own, and ends them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any, Final

from soter.errors import RobotUnavailable
from soter.sdk import RobotSpec, program
from soter.workspace import Box, Workspace

START_TIMEOUT_S: Final = 30.0


def describe(workspace: Workspace, robots: Sequence[RobotSpec]) -> dict[str, Any]:
    """Return a world as `soter_sim.mavlink` reads it: metres, east and north, radians counter-clockwise from east."""
    return {
        "width_m": workspace.width_m,
        "depth_m": workspace.depth_m,
        "boxes": [_edges(box) for box in workspace.boxes],
        "chargers": [_edges(place.charger) for place in workspace.robots],
        "robots": [
            {
                "id": spec.id, "x_m": spec.x_m, "y_m": spec.y_m, "heading_rad": spec.heading_rad,
                "battery": spec.battery, "drive_s": spec.drive_s, "idle_s": spec.idle_s, "charge_s": spec.charge_s,
            }
            for spec in robots
        ],
    }  # fmt: skip


def free_port() -> int:
    """Return a UDP port of this host that nobody uses at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Simulator:
    """Simulated vehicles in a process, which ends with this one, however this one ends.

    Args:
        world: from `describe`.
        port: to which they send.
        options: more arguments of `python -m soter_sim.mavlink`.

    Attributes:
        process: the child.
        truth: where it tells what really happens, as host:port.

    Raises:
        RobotUnavailable: it does not start.
    """

    def __init__(self, world: Mapping[str, Any], port: int, *options: str) -> None:
        arguments = ["-", "--udp", str(port), "--parent", str(os.getpid()), *options]
        # A session of its own: Ctrl-C in a terminal is for who commands the vehicles, and stops them in good order.
        self.process: Final = subprocess.Popen(
            [sys.executable, "-m", "soter_sim.mavlink", *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        )  # fmt: skip
        try:
            ready = json.loads(program.first_line(self.process, json.dumps(world).encode(), START_TIMEOUT_S))
            self.truth: Final[str] = ready["truth"]
        except (ValueError, KeyError, OSError) as failure:
            self.close()
            raise RobotUnavailable(
                f"the simulated vehicles do not start: {failure}; what they say is on standard error, and "
                f"`{sys.executable} -m soter_sim.mavlink --help` must work"
            ) from failure

    def close(self) -> None:
        """End the process and wait until it is gone. Idempotent."""
        program.end([self.process])


def _edges(box: Box) -> tuple[float, float, float, float]:
    return box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m
