"""Starts the simulated robots as a child process, and ends it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from soter.sdk import RobotSpec, program
from soter.workspace import Box, Workspace

_MODULE: Final = "soter_zmq.robot"


def describe(workspace: Workspace, robots: Sequence[RobotSpec]) -> dict[str, Any]:
    """Return a world as the simulator reads it: numbers only, east and north, radians counter-clockwise from east."""
    return {
        "width_m": workspace.width_m,
        "depth_m": workspace.depth_m,
        "boxes": [_edges(box) for box in workspace.boxes],
        "chargers": [_edges(place.charger) for place in workspace.robots],
        "robots": [
            {
                "id": spec.id,
                "x_m": spec.x_m,
                "y_m": spec.y_m,
                "heading_rad": spec.heading_rad,
                "charge": 1.0 if spec.battery is None else spec.battery,
                "drive_s": spec.drive_s,
                "idle_s": spec.idle_s,
                "charge_s": spec.charge_s,
            }
            for spec in robots
        ],
    }


class Simulator:
    """A world in a process of its own, which ends with this one, however this one ends.

    Args:
        world: from `describe`.
        ports: by robot, the ports of commands and of reports, for a robot that comes back where it was.

    Attributes:
        endpoints: by robot, the addresses of commands and of reports.
        truth: the address of what really happens.
        process: the child.

    Raises:
        RobotUnavailable: it does not start.
    """

    def __init__(self, world: Mapping[str, Any], ports: Mapping[int, tuple[int, int]] | None = None) -> None:
        fixed = ";".join(f"{robot_id}={command},{report}" for robot_id, (command, report) in (ports or {}).items())
        self.process: Final = program.start(_MODULE, "-", "--ports", fixed)
        try:
            found = program.hand_over(self.process, _MODULE, json.dumps(world).encode())
            self.endpoints: Final[dict[int, dict[str, str]]] = {int(key): each for key, each in found["robots"].items()}
            self.truth: Final[str] = found["truth"]
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the process and wait until it is gone. Idempotent."""
        program.end([self.process])


def _edges(box: Box) -> tuple[float, float, float, float]:
    return box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m
