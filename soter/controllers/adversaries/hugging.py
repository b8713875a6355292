"""To the nearest edge at top speed, and along the edge of where the AC is allowed."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from soter.controllers.adversaries import base
from soter.controllers.base import Arena
from soter.rta import ControlReport, Report
from soter.sdk import Waypoint
from soter.stack.terrain import Point

_CORNER_M = 0.03
_GIVE_UP_S = 60.0


class HuggingOptions(base.AdversaryOptions):
    """How it creeps.

    Attributes:
        spare_m: how much inside the edge of what is allowed; negative is beyond it.
        speed_m_s: how fast.
    """

    spare_m: Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)] = 0.002
    speed_m_s: base.Positive = 0.08


class BoundaryHugging(base.Adversary):
    """Creeps round the fence and round every box, just where control would be lost, and so leaves no room to err.

    Robots go round in opposite senses, so that they meet where there is room on one side only.
    """

    Options = HuggingOptions
    options: HuggingOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        rta, facts, terrain, spare_m = arena.rta, self.options.facts, arena.terrain, self.options.spare_m
        inset_m = facts.reach_m(rta.geofence.delta_s) + spare_m
        width_m, depth_m = terrain.width_m - inset_m, terrain.depth_m - inset_m
        self._rings: list[list[Point]] = [
            [(inset_m, inset_m), (width_m, inset_m), (width_m, depth_m), (inset_m, depth_m)]
        ]
        off_m = terrain.body_radius_m + rta.obstacle.phi_safe_m + facts.reach_m(rta.obstacle.delta_s) + spare_m
        for box in terrain.boxes:
            low_x, low_y, high_x, high_y = (
                box.low_x_m - off_m, box.low_y_m - off_m, box.high_x_m + off_m, box.high_y_m + off_m,
            )  # fmt: skip
            self._rings.append([(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)])
        self._at = {robot_id: 4 * index for index, robot_id in enumerate(arena.ports)}
        self._since_s = dict.fromkeys(arena.ports, 0.0)
        self._asked: dict[int, int] = {}

    def hear(self, report: Report) -> None:
        """A corner at which control was lost is left out."""
        if isinstance(report, ControlReport):
            self._asked.pop(report.robot_id, None)
            self._at[report.robot_id] += not report.engaged

    def act(self, now_s: float, tick: int) -> None:
        """Go on to the next corner."""
        for index, (robot_id, port) in enumerate(self.arena.ports.items()):
            own = port.state
            if own is None or not port.engaged:
                continue
            at = self._at[robot_id]
            ring = self._rings[at // 4 % len(self._rings)]
            x_m, y_m = ring[at % 4 if index % 2 == 0 else -1 - at % 4]
            if self._asked.get(robot_id) != at:
                self._asked[robot_id], self._since_s[robot_id] = at, now_s
                # Straight across the room at top speed, along an edge at a creep.
                far = min(abs(own.x_m - x_m), abs(own.y_m - y_m)) > 0.2
                speed = None if far else self.options.speed_m_s
                port.goto(Waypoint(x_m, y_m, 0.0, None, speed, 0.5 * _CORNER_M, 600.0))
            elif math.hypot(own.x_m - x_m, own.y_m - y_m) < _CORNER_M or now_s - self._since_s[robot_id] > _GIVE_UP_S:
                self._at[robot_id] = at + 1


class FastestToBoundary(base.Adversary):
    """Every robot drives at the nearest edge; after each loss of control it turns to the next rule's nearest edge."""

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._turn = {robot_id: index for index, robot_id in enumerate(arena.ports)}
        self._aim: dict[int, base.Edge] = {}

    def hear(self, report: Report) -> None:
        """Another rule comes next where control was lost."""
        if isinstance(report, ControlReport) and not report.engaged:
            self._turn[report.robot_id] += 1
            self._aim.pop(report.robot_id, None)

    def act(self, now_s: float, tick: int) -> None:
        """Aim, and keep aiming at what moves."""
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
