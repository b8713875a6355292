"""Straight at the nearest edge, at top speed."""

from __future__ import annotations

from soter.rta import ControlReport, Report
from soter.stack.adversaries.base import Adversary, AdversaryOptions, Arena, towards
from soter.stack.adversaries.edges import RULES, Edge, nearest_edge


class FastestToBoundary(Adversary[AdversaryOptions]):
    """Every robot drives at the nearest edge; after each loss of control it turns to the next rule's nearest edge."""

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._turn = {robot_id: index for index, robot_id in enumerate(arena.ports)}
        self._aim: dict[int, Edge] = {}

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
            rule = RULES[self._turn[robot_id] % len(RULES)]
            if rule != "collision" and robot_id in self._aim:
                continue
            edge = nearest_edge(self.arena, own, rule)
            if edge is None:
                self._turn[robot_id] += 1
            elif edge != self._aim.get(robot_id):
                self._aim[robot_id] = edge
                port.goto(towards(own, edge.x_m, edge.y_m))
