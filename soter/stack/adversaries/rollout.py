"""A small kinematic model of robots with decision modules, rolled forward for many sequences of commands at once."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.config_tables import ModuleTable, RtaTable
from soter.stack.adversaries.base import RobotFacts
from soter.stack.terrain import Terrain

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RULES: Final = ("collision", "obstacle", "geofence")

_YAW_RAD_S: Final = 2.84
_CONE_RAD: Final = 0.2
_ALIGNED_RAD: Final = 0.02


class Rollout:
    """Predicts the least margins that sequences of one goal a robot lead to, decision modules included.

    A robot waits, turns in place, drives straight at top speed, and brakes for good when one of its modules looks and
    finds less margin than its reach bound. That is what the modules promise; what safe controllers do after it is
    left out. Arrays have the shape (candidates, robots).

    Args:
        terrain: fence and boxes.
        rta: periods and rules of the modules.
        facts: what the robots can do.
        step_s: of the model, which is the supervisors' period.
    """

    def __init__(self, terrain: Terrain, rta: RtaTable, facts: RobotFacts, step_s: float) -> None:
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
            moves: which robots the AC has control of.
            goals: where they are sent; shape (candidates, robots, 2).
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
