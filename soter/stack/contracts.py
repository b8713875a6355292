"""Whether safe controllers keep their contracts with the modules behind their own (A16)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from soter.rta import Assumption, RobotSupervisor
from soter.stack.battery import Dock
from soter.stack.right_of_way import BATTERY

_MOVING_M_S: Final = 0.02


class ContractMonitor:
    """Watches robots that have to charge, and stand, while a module of the user's has them. Ticked by the arbiter."""

    def __init__(self) -> None:
        self._since_s: dict[int, float] = {}

    def look(self, now_s: float, robots: Mapping[int, RobotSupervisor], docks: Mapping[int, Dock]) -> None:
        """Take note of every safe controller that has stood on its robot for longer than its contract allows."""
        for robot_id, robot in robots.items():
            driver, dock, situation = robot.driver, docks[robot_id], robot.situation
            lets_go_s = math.inf if driver is None else driver.module.lets_go_s
            starves = driver is not None and driver.name != BATTERY and dock.wants_charge and not math.isinf(lets_go_s)
            moves = math.hypot(situation.own.vx_m_s, situation.own.vy_m_s) > _MOVING_M_S
            if driver is None or not starves or moves or dock.docked(situation):
                self._since_s[robot_id] = now_s
                continue
            kept_s = now_s - self._since_s.setdefault(robot_id, now_s)
            if kept_s > lets_go_s:
                cause = f"'{driver.name}' has kept the robot from charging for {kept_s:.1f} s, at most {lets_go_s:g} s"
                robot.log.note(Assumption.CONTRACT, now_s, cause, kept_s - lets_go_s, "s")
