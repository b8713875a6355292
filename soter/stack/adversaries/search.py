"""Looks ahead for the commands that cost the most margin."""

from __future__ import annotations

import math
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from soter.sdk import RobotState
from soter.stack.adversaries.base import Adversary, AdversaryOptions, Arena, Positive, towards
from soter.stack.adversaries.edges import nearest_edge
from soter.stack.adversaries.rollout import RULES, Rollout
from soter.stack.terrain import Point

_LATERAL_M: Final = 0.5


class SearchOptions(AdversaryOptions):
    """How hard it looks.

    Attributes:
        candidates: sequences tried each time; a number and not a time, so that the same seed gives the same attack.
        ahead_s: how far they are rolled forward.
        wait_s: a robot waits at most so long before it starts.
    """

    candidates: Annotated[int, Field(ge=1, le=100_000)] = 64
    ahead_s: Positive = 3.0
    wait_s: Positive = 0.5


class Search(Adversary[SearchOptions]):
    """Samples where and when to send every robot, rolls a model of all robots and modules forward, takes the worst.

    The model knows when each module looks. What it finds are runs-up that reach top speed and cross the line at which
    a module acts right after it has looked. The rule that is attacked changes from one search to the next.
    """

    options_model = SearchOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = np.random.default_rng(arena.random("search").getrandbits(64))
        self._rollout = Rollout(arena.terrain, arena.rta, self.options.facts, arena.base_tick_s)
        self._ids = sorted(arena.ports)
        self._plan: dict[int, tuple[int, Point]] = {}
        self._over = 0
        self._rule = 0
        self._engaged: tuple[bool, ...] = ()
        self.evaluations = 0
        """Sequences that were rolled forward."""

    def act(self, now_s: float, tick: int) -> None:
        """Carry the present plan on; make another one when it is over or somebody has lost or got control."""
        ports = self.arena.ports
        states = self.arena.states()
        if len(states) < len(ports):
            return
        engaged = tuple(ports[robot_id].engaged for robot_id in self._ids)
        if tick >= self._over or engaged != self._engaged:
            self._engaged = engaged
            if any(engaged):
                self._search(tick, [states[robot_id] for robot_id in self._ids])
        for robot_id, (start_tick, goal) in list(self._plan.items()):
            if tick >= start_tick:
                del self._plan[robot_id]
                if ports[robot_id].engaged:
                    ports[robot_id].goto(towards(states[robot_id], *goal))

    def _search(self, tick: int, states: list[RobotState]) -> None:
        options, step_s, random = self.options, self.arena.base_tick_s, self._random
        count, robots = options.candidates, len(states)
        steps = math.ceil(options.ahead_s / step_s)
        self._rule = (self._rule + 1) % len(RULES)
        goals = np.empty((count, robots, 2))
        for index, own in enumerate(states):
            edges = [edge for rule in RULES if (edge := nearest_edge(self.arena, own, rule)) is not None]
            which = random.integers(len(edges), size=count)
            places = np.array([(edge.x_m, edge.y_m) for edge in edges])[which]
            goals[:, index] = places + random.uniform(-_LATERAL_M, _LATERAL_M, (count, 2))
        waits = random.integers(max(1, round(options.wait_s / step_s)) + 1, size=(count, robots))
        start = np.array([(s.x_m, s.y_m, s.heading_rad, math.hypot(s.vx_m_s, s.vy_m_s)) for s in states])
        least = self._rollout.least(tick, start, np.array(self._engaged), goals, waits, steps)
        self.evaluations += count
        best = int(np.argmin(least[:, self._rule]))
        self._over = tick + steps
        self._plan = {
            robot_id: (tick + int(waits[best, index]), (float(goals[best, index, 0]), float(goals[best, index, 1])))
            for index, robot_id in enumerate(self._ids)
            if self._engaged[index]
        }
