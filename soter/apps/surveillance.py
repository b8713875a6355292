"""The surveillance mission: every robot visits target after target, drawn from a set, until the time is up."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Final

from soter.stack.events import Place
from soter.workspace import Workspace

OUTSIDE_M: Final = 1.0
"""How far outside the fence hostile targets lie, at most."""

_APART_M: Final = 0.5


def grid_places(workspace: Workspace, body_radius_m: float) -> list[Place]:
    """Return the integer points, fence included, on which a body can stand: most of them lie on the fence."""
    return [
        (float(x), float(y))
        for x in range(math.floor(workspace.width_m) + 1)
        for y in range(math.floor(workspace.depth_m) + 1)
        if workspace.clearance_m(x, y, body_radius_m) >= 0.0
    ]


class Targets:
    """Draws targets, for every robot from a stream of random numbers of its own.

    Args:
        workspace: fence and boxes.
        body_radius_m: of the robots.
        name: `grid`, `uniform` (anywhere inside the fence where a body can stand) or `hostile` (anywhere up to
            `OUTSIDE_M` outside the fence, boxes included).
        seed: of the run.
    """

    def __init__(self, workspace: Workspace, body_radius_m: float, name: str, seed: int) -> None:
        self._workspace: Final = workspace
        self._body_radius_m: Final = body_radius_m
        self._seed: Final = seed
        self._streams: dict[int, random.Random] = {}
        self._last: dict[int, Place] = {}
        self._grid: Final = grid_places(workspace, body_radius_m) if name == "grid" else []
        draws: dict[str, Callable[[random.Random], Place]] = {
            "grid": lambda stream: stream.choice(self._grid),
            "uniform": self._uniform,
            "hostile": self._hostile,
        }
        self._draw: Final = draws[name]

    def next(self, robot_id: int) -> Place:
        """Return the next target of a robot, not the one it comes from."""
        stream = self._streams.setdefault(robot_id, random.Random(f"targets/{self._seed}/{robot_id}"))
        last = self._last.get(robot_id)
        place = self._draw(stream)
        while last is not None and math.dist(place, last) < _APART_M:
            place = self._draw(stream)
        self._last[robot_id] = place
        return place

    def _uniform(self, stream: random.Random) -> Place:
        while True:
            x, y = stream.uniform(0.0, self._workspace.width_m), stream.uniform(0.0, self._workspace.depth_m)
            if self._workspace.clearance_m(x, y, self._body_radius_m) >= 0.0:
                return x, y

    def _hostile(self, stream: random.Random) -> Place:
        return (
            stream.uniform(-OUTSIDE_M, self._workspace.width_m + OUTSIDE_M),
            stream.uniform(-OUTSIDE_M, self._workspace.depth_m + OUTSIDE_M),
        )
