"""Brings one robot to an edge, and has the others press it against that edge."""

from __future__ import annotations

import math

from soter.controllers.adversaries.base import (
    Adversary,
    AdversaryOptions,
    Positive,
    rings_where_control_is_lost,
    towards,
)
from soter.controllers.base import Arena
from soter.sdk import Waypoint
from soter.stack.terrain import Point

_MOVED_M = 0.02
_SPARE_M = 0.005


class PincerOptions(AdversaryOptions):
    """Options of `Pincer`.

    Attributes:
        turn_s: time after which another robot becomes the prey, at another place.
    """

    turn_s: Positive = 30.0


class Pincer(Adversary):
    """The prey waits where its geofence or obstacle module is about to take it; the others come from inside.

    The prey's collision module then acts with its back to an edge, or in a corner.
    """

    Options = PincerOptions
    options: PincerOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = arena.random("pincer")
        self._ids = sorted(arena.ports)
        self._until_s = -math.inf
        self._turn = -1
        self._rings = rings_where_control_is_lost(arena, self.options.facts, _SPARE_M)
        self._place: Point = (0.0, 0.0)
        self._asked: dict[int, Point] = {}

    def act(self, now_s: float, tick: int) -> None:
        """Send the prey to its place and all others to the prey."""
        if now_s >= self._until_s and any(self._rings):
            self._until_s = now_s + self.options.turn_s
            self._turn += 1
            self._place = self._edge()
            self._asked.clear()
        prey_id = self._ids[self._turn % len(self._ids)]
        prey = self.arena.ports[prey_id].state
        for robot_id, port in self.arena.ports.items():
            own = port.state
            if own is None or prey is None or not port.engaged:
                self._asked.pop(robot_id, None)
                continue
            goal = self._place if robot_id == prey_id else (prey.x_m, prey.y_m)
            if math.dist(goal, self._asked.get(robot_id, (math.inf, math.inf))) <= _MOVED_M:
                continue
            self._asked[robot_id] = goal
            port.goto(Waypoint(*goal, 0.0, None, None, 0.01, 600.0) if robot_id == prey_id else towards(own, *goal))

    def _edge(self) -> Point:
        """Return a place where an AC just keeps control: at the fence, in one of its corners, or beside a box."""
        random, (fence, kept_out) = self._random, self._rings
        rings = random.choice([each for each in (fence, kept_out) if each])
        ring = random.choice(rings)
        corner = random.randrange(len(ring))
        share = random.choice((0.0, random.random()))
        (ax, ay), (bx, by) = ring[corner - 1], ring[corner]
        inset_m = self.options.facts.reach_m(self.arena.rta.geofence.delta_s) + _SPARE_M
        return self.arena.terrain.beside(ax + share * (bx - ax), ay + share * (by - ay), inset_m, None)
