"""Floods ports with commands, from several threads."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from soter.controllers.adversaries.base import Adversary, AdversaryOptions
from soter.controllers.base import Arena
from soter.sdk import Waypoint

_BURST = 100
_PAUSE_S = 0.001


class FloodOptions(AdversaryOptions):
    """Options of `Flood`.

    Attributes:
        commands: number of commands for each robot at each tick.
        threads: number of threads that send all the time; with any, the host decides which command comes last.
    """

    commands: Annotated[int, Field(ge=1, le=1_000_000)] = 1000
    threads: Annotated[int, Field(ge=0, le=64)] = 2


class Flood(Adversary):
    """Sends thousands of goals a tick to every robot, in all directions; the last is a place outside the fence."""

    Options = FloodOptions
    options: FloodOptions

    def __init__(self, options: FloodOptions) -> None:
        super().__init__(options)
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = arena.random("flood")
        self._goal: dict[int, Waypoint] = {}
        low_x, low_y, high_x, high_y = arena.terrain.bounds
        self._corners = [
            Waypoint(x_m, y_m) for x_m in (low_x - 1.0, high_x + 1.0) for y_m in (low_y - 1.0, high_y + 1.0)
        ]
        self._threads = [
            threading.Thread(target=self._send, args=(index,), name=f"flood-{index}", daemon=True)
            for index in range(self.options.threads)
        ]
        for thread in self._threads:
            thread.start()

    def act(self, now_s: float, tick: int) -> None:
        """Flood every port."""
        random, corners = self._random, self._corners
        low_x, low_y, high_x, high_y = self.arena.terrain.bounds
        for robot_id, port in self.arena.ports.items():
            if tick % 100 == 0 or robot_id not in self._goal:
                x_m = random.uniform(low_x - 1.0, high_x + 1.0)
                self._goal[robot_id] = Waypoint(x_m, random.uniform(low_y - 1.0, high_y + 1.0))
            for count in range(self.options.commands - 1):
                port.goto(corners[count & 3])
            port.goto(self._goal[robot_id])

    @property
    def incidents(self) -> Sequence[str]:
        """Return that threads send when the host lets them, if there are any."""
        return [f"{len(self._threads)} threads sent commands when the host let them"] if self.options.threads else []

    def close(self) -> None:
        """End the threads."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _send(self, index: int) -> None:
        ports = list(self.arena.ports.values())
        count = index
        while not self._stop.wait(_PAUSE_S):
            for _ in range(_BURST):
                count += 1
                ports[count % len(ports)].goto(self._corners[(count >> 3) & 3])
