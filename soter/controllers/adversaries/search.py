"""Searches, by looking ahead, for the commands that cost the most margin."""

from __future__ import annotations

import math
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from soter.config.tables import ModuleTable, RtaTable
from soter.controllers.adversaries import base
from soter.controllers.base import Arena
from soter.sdk import RobotState
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Point, Terrain

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RULES: Final = ("collision", "obstacle", "geofence")

_YAW_RAD_S: Final = 2.84
_CONE_RAD: Final = 0.2
_ALIGNED_RAD: Final = 0.02


class Rollout:
    """Predicts the least margins that follow from one goal for each robot, decision modules included.

    A robot waits, turns in place, drives straight at top speed, and brakes for good when one of its modules looks and
    finds less margin than its reach bound, as modules promise. Safe controllers are not modelled. Arrays have the shape
    (candidates, robots).

    Args:
        terrain: fence and boxes.
        rta: periods and rules of the modules.
        facts: the adversary's assumptions about the robots.
        step_s: the model's time step, equal to the supervisors' period.
    """

    def __init__(self, terrain: Terrain, rta: RtaTable, facts: base.RobotFacts, step_s: float) -> None:
        self._terrain: Final = terrain
        self._rta: Final = rta
        self._facts: Final = facts
        self._step_s: Final = step_s
        tables: tuple[ModuleTable, ...] = (rta.collision, rta.obstacle, rta.geofence)
        self._every: Final = [max(1, round(table.delta_s / step_s)) for table in tables]
        self._reach_m: Final = [
            facts.reach_m(table.delta_s, 2 if rule == "collision" else 1)
            for rule, table in zip(RULES, tables, strict=True)
        ]

    def least(
        self, tick: int, start: Floats, moves: Flags, goals: Floats, waits: NDArray[np.int64], steps: int
    ) -> Floats:
        """Return, for every candidate and rule of `RULES`, the least margin as a part of the rule's reach bound.

        Args:
            tick: the number of the tick at which the commands begin to act.
            start: x, y, heading and speed of every robot; shape (robots, 4).
            moves: which robots their AC controls.
            goals: where robots are sent; shape (candidates, robots, 2).
            waits: ticks that each robot waits before; shape (candidates, robots).
            steps: how many ticks to look ahead.
        """
        shape = waits.shape
        x, y, heading, speed = (np.broadcast_to(start[:, column], shape).copy() for column in range(4))
        free = np.broadcast_to(moves, shape).copy()
        least = np.full((shape[0], len(RULES)), math.inf)
        dt_s, facts = self._step_s, self._facts
        for step in range(steps):
            going = free & (waits <= step)
            error = np.arctan2(goals[..., 1] - y, goals[..., 0] - x) - heading
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
            resting = speed <= 1e-9
            turning = going & resting & (np.abs(error) > _ALIGNED_RAD)
            driving = going & ~turning & (np.abs(error) < _CONE_RAD)
            heading = heading + np.where(turning | driving, np.clip(error, -_YAW_RAD_S * dt_s, _YAW_RAD_S * dt_s), 0.0)
            change = np.where(driving, facts.brake_m_s2, -facts.brake_m_s2) * dt_s
            now = np.clip(speed + change, 0.0, facts.v_max_m_s)
            way = 0.5 * (speed + now) * dt_s
            speed = now
            x, y = x + way * np.cos(heading), y + way * np.sin(heading)
            margins = self._margins(x, y)
            for rule, margin in enumerate(margins):
                np.minimum(least[:, rule], margin.min(axis=1), out=least[:, rule])
                if (tick + step + 1) % self._every[rule] == 0:
                    free &= margin >= self._reach_m[rule]
        parts: Floats = least / np.array(self._reach_m)
        return parts

    def _margins(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return every robot's margins in the order of `RULES`."""
        terrain = self._terrain
        if isinstance(terrain, SiteTerrain):
            fence = np.vectorize(terrain.fence_m, [np.float64])(x, y)
            clearance = np.vectorize(terrain.clearance_m, [np.float64])(x, y) + terrain.body_radius_m
        else:
            fence = np.minimum(np.minimum(x, terrain.width_m - x), np.minimum(y, terrain.depth_m - y))
            clearance = np.full(x.shape, math.inf)
            for box in terrain.boxes:
                dx = np.maximum(np.maximum(box.low_x_m - x, x - box.high_x_m), 0.0)
                dy = np.maximum(np.maximum(box.low_y_m - y, y - box.high_y_m), 0.0)
                np.minimum(clearance, np.hypot(dx, dy), out=clearance)
        gaps = np.hypot(x[:, :, None] - x[:, None, :], y[:, :, None] - y[:, None, :])
        robots = np.arange(x.shape[1])
        gaps[:, robots, robots] = math.inf
        return (
            gaps.min(axis=2) - self._rta.collision.phi_safe_m,
            clearance - terrain.body_radius_m - self._rta.obstacle.phi_safe_m,
            fence,
        )


_LATERAL_M: Final = 0.5


class SearchOptions(base.AdversaryOptions):
    """Options of `Search`.

    Attributes:
        candidates: sequences tried per search; a number, not a time, so that the same seed gives the same attack.
        ahead_s: how far they are rolled forward.
        wait_s: longest time that a robot waits before it starts.
    """

    candidates: Annotated[int, Field(ge=1, le=100_000)] = 64
    ahead_s: base.Positive = 3.0
    wait_s: base.Positive = 0.5


class Search(base.Adversary):
    """Samples where and when to send every robot, rolls a model of robots and modules forward, and takes the worst.

    The model knows when each module looks, so the search finds runs at top speed that cross the line at which a module
    acts right after it has looked. Each search attacks another rule.
    """

    Options = SearchOptions
    options: SearchOptions

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
        """Number of sequences that were rolled forward."""

    def act(self, now_s: float, tick: int) -> None:
        """Carry out the present plan; make another one when it is over, or when control of a robot has changed."""
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
                    ports[robot_id].goto(base.towards(states[robot_id], *goal))

    def _search(self, tick: int, states: list[RobotState]) -> None:
        options, step_s, random = self.options, self.arena.base_tick_s, self._random
        count, robots = options.candidates, len(states)
        steps = math.ceil(options.ahead_s / step_s)
        self._rule = (self._rule + 1) % len(RULES)
        goals = np.empty((count, robots, 2))
        for index, own in enumerate(states):
            edges = [edge for rule in RULES if (edge := base.nearest_edge(self.arena, own, rule)) is not None]
            # Where there is nothing to run into, it wanders.
            ends = [(edge.x_m, edge.y_m) for edge in edges] or [(own.x_m, own.y_m)]
            places = np.array(ends)[random.integers(len(ends), size=count)]
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
