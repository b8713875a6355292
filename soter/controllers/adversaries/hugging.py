"""Adversaries that drive to the nearest edge at top speed, and along the edge at which the AC loses control."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from soter.controllers.adversaries import base
from soter.controllers.base import Arena
from soter.rta import ControlReport, Report
from soter.sdk import Waypoint

_CORNER_M = 0.03
_ASIDE_M = 0.2
_GIVE_UP_S = 60.0


class HuggingOptions(base.AdversaryOptions):
    """Options of `BoundaryHugging`.

    Attributes:
        spare_m: how far on the allowed side of where control is lost it drives; negative for beyond.
        speed_m_s: speed along the edge.
    """

    spare_m: Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)] = 0.002
    speed_m_s: base.Positive = 0.08


class BoundaryHugging(base.Adversary):
    """Creeps round the fence and round every box, just where control would be lost, which leaves no room for error.

    Robots go round in opposite senses, so that they meet where there is room on one side only.
    """

    Options = HuggingOptions
    options: HuggingOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        fence, kept_out = base.rings_where_control_is_lost(arena, self.options.facts, self.options.spare_m)
        self._rings = fence + kept_out
        many = max(len(self._rings), 1)
        self._at = {robot_id: (index % many, 0) for index, robot_id in enumerate(arena.ports)}
        self._since_s = dict.fromkeys(arena.ports, 0.0)
        self._asked: dict[int, tuple[int, int]] = {}

    def hear(self, report: Report) -> None:
        """Skip a corner at which control was lost."""
        if isinstance(report, ControlReport):
            self._asked.pop(report.robot_id, None)
            if not report.engaged:
                self._go_on(report.robot_id)

    def _go_on(self, robot_id: int) -> None:
        number, corner = self._at[robot_id]
        if self._rings:
            round_it = corner + 1 == len(self._rings[number])
            self._at[robot_id] = ((number + 1) % len(self._rings), 0) if round_it else (number, corner + 1)

    def act(self, now_s: float, tick: int) -> None:
        """Go on to the next corner."""
        for index, (robot_id, port) in enumerate(self.arena.ports.items() if self._rings else ()):
            own = port.state
            if own is None or not port.engaged:
                continue
            at = self._at[robot_id]
            ring = self._rings[at[0]][:: 1 if index % 2 == 0 else -1]
            (before_x_m, before_y_m), (x_m, y_m) = ring[at[1] - 1], ring[at[1]]
            if self._asked.get(robot_id) != at:
                self._asked[robot_id], self._since_s[robot_id] = at, now_s
                # At top speed across the room, slowly along an edge.
                dx, dy = x_m - before_x_m, y_m - before_y_m
                aside_m = abs(dx * (own.y_m - y_m) - dy * (own.x_m - x_m)) / max(math.hypot(dx, dy), 1e-9)
                speed = None if aside_m > _ASIDE_M else self.options.speed_m_s
                port.goto(Waypoint(x_m, y_m, 0.0, None, speed, 0.5 * _CORNER_M, 600.0))
            elif math.hypot(own.x_m - x_m, own.y_m - y_m) < _CORNER_M or now_s - self._since_s[robot_id] > _GIVE_UP_S:
                self._go_on(robot_id)


class FastestToBoundary(base.Adversary):
    """Every robot drives at the nearest edge of a rule; after each loss of control, of the next rule."""

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._turn = {robot_id: index for index, robot_id in enumerate(arena.ports)}
        self._aim: dict[int, base.Edge] = {}

    def hear(self, report: Report) -> None:
        """Turn to the next rule after control was lost."""
        if isinstance(report, ControlReport) and not report.engaged:
            self._turn[report.robot_id] += 1
            self._aim.pop(report.robot_id, None)

    def act(self, now_s: float, tick: int) -> None:
        """Aim at the edge, and keep aiming if it moves."""
        for robot_id, port in self.arena.ports.items():
            own = port.state
            if own is None or not port.engaged:
                continue
            rule = base.RULES[self._turn[robot_id] % len(base.RULES)]
            if rule != "collision" and robot_id in self._aim:
                continue
            edge = base.nearest_edge(self.arena, own, rule)
            if edge is None:
                self._turn[robot_id] += 1
            elif edge != self._aim.get(robot_id):
                self._aim[robot_id] = edge
                port.goto(base.towards(own, edge.x_m, edge.y_m))
