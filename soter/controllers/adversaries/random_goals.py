"""Sends any waypoint at any time."""

from __future__ import annotations

import math

from soter.controllers.adversaries.base import Adversary, AdversaryOptions, Positive
from soter.controllers.base import Arena
from soter.sdk import Waypoint


class RandomOptions(AdversaryOptions):
    """Options of `RandomGoals`.

    Attributes:
        most_s: longest time that a goal stands; the shortest is one tick.
        beyond_m: how far outside the fence goals lie at most.
    """

    most_s: Positive = 4.0
    beyond_m: Positive = 1.0


class RandomGoals(Adversary):
    """Sends goals anywhere, also in boxes and outside the fence; near and far, slow and fast, with odd radii."""

    Options = RandomOptions
    options: RandomOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = arena.random("random")
        self._next_s = dict.fromkeys(arena.ports, -math.inf)

    def act(self, now_s: float, tick: int) -> None:
        """Send another goal to robots whose goal's time is up, in control or not."""
        random, arena = self._random, self.arena
        for robot_id, port in arena.ports.items():
            if now_s < self._next_s[robot_id] or port.state is None:
                continue
            self._next_s[robot_id] = now_s + random.uniform(arena.base_tick_s, self.options.most_s)
            own = port.state
            if random.random() < 0.3:
                away_m, angle = random.uniform(0.0, 0.3), random.uniform(-math.pi, math.pi)
                x_m, y_m = own.x_m + away_m * math.cos(angle), own.y_m + away_m * math.sin(angle)
            else:
                beyond_m = self.options.beyond_m
                low_x, low_y, high_x, high_y = arena.terrain.bounds
                x_m = random.uniform(low_x - beyond_m, high_x + beyond_m)
                y_m = random.uniform(low_y - beyond_m, high_y + beyond_m)
            heading = random.uniform(-math.pi, math.pi) if random.random() < 0.5 else None
            speed = random.choice((None, None, 0.01, 0.1, 1.0, 100.0))
            radius, timeout = random.choice((1e-9, 0.1, 0.1, 1e6)), random.choice((1e-6, 1.0, 100.0, 100.0, 1e6))
            port.goto(Waypoint(x_m, y_m, 0.0, heading, speed, radius, timeout))
