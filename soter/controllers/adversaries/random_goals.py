"""Anything that is a waypoint, at any time."""

from __future__ import annotations

import math

from soter.controllers.adversaries.base import Adversary, AdversaryOptions, Positive
from soter.controllers.base import Arena
from soter.sdk import Waypoint


class RandomOptions(AdversaryOptions):
    """What to draw.

    Attributes:
        most_s: a goal stands for a time from one tick to this.
        beyond_m: goals lie up to so far outside the fence.
    """

    most_s: Positive = 4.0
    beyond_m: Positive = 1.0


class RandomGoals(Adversary):
    """Goals anywhere, in boxes and outside the fence too; near ones and far ones, slow and fast, with odd radii."""

    Options = RandomOptions
    options: RandomOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = arena.random("random")
        self._next_s = dict.fromkeys(arena.ports, -math.inf)

    def act(self, now_s: float, tick: int) -> None:
        """Give those robots whose time is up another goal, in control or not."""
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
