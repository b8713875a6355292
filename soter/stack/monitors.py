"""Monitors of two assumptions: safe controllers keep their contracts (A16), charges are as reported (A8)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from soter.rta import Assumption, RobotSupervisor
from soter.stack.battery import Dock
from soter.stack.right_of_way import BATTERY


class ContractMonitor:
    """Monitors robots that have to charge but stand while a user's module drives them. Ticked by the arbiter.

    Args:
        moving_m_s: by robot, the reported speed above which the robot counts as moving.
    """

    def __init__(self, moving_m_s: Mapping[int, float]) -> None:
        self._moving_m_s: Final = moving_m_s
        self._since_s: dict[int, float] = {}

    def rest(self) -> None:
        """Note that no robot has to charge."""
        self._since_s.clear()

    def look(self, now_s: float, robots: Mapping[int, RobotSupervisor], docks: Mapping[int, Dock]) -> None:
        """Log every safe controller that has kept its robot standing for longer than its contract allows."""
        for robot_id, robot in robots.items():
            driver, dock, own = robot.driver, docks[robot_id], robot.situation.own
            if (
                driver is None
                or not dock.wants_charge
                or driver.name == BATTERY
                or math.isinf(lets_go_s := driver.module.lets_go_s)
                or math.hypot(own.vx_m_s, own.vy_m_s) > self._moving_m_s[robot_id]
                or dock.docked(robot.situation)
            ):
                self._since_s.pop(robot_id, None)
                continue
            kept_s = now_s - self._since_s.setdefault(robot_id, now_s)
            if kept_s > lets_go_s:
                cause = f"'{driver.name}' has kept the robot from charging for {kept_s:.1f} s, at most {lets_go_s:g} s"
                robot.log.note(Assumption.CONTRACT, now_s, cause, kept_s - lets_go_s, "s")


_FROZEN_CHARGE: Final = 0.05
"""Charge that driving must have used before an unchanged reading counts as frozen: some steps of whole percents."""


@dataclass(slots=True)
class _Unchanged:
    charge: float
    stamp_s: float
    driven_m: float


class ChargeMonitor:
    """Monitors that the charge of robots falls while they drive. Ticked by the arbiter."""

    def __init__(self) -> None:
        self._unchanged: dict[int, _Unchanged] = {}

    def look(self, now_s: float, robots: Mapping[int, RobotSupervisor], docks: Mapping[int, Dock]) -> None:
        """Log every robot that has driven too far for its reported charge to be unchanged."""
        for robot_id, robot in robots.items():
            own = robot.situation.own
            charge, before = own.battery, self._unchanged.get(robot_id)
            if charge is None:
                continue
            if before is None:
                self._unchanged[robot_id] = _Unchanged(charge, own.stamp_s, 0.0)
                continue
            # Any other charge starts a new measurement; one that has risen was charged.
            if charge != before.charge:
                before.charge, before.stamp_s, before.driven_m = charge, own.stamp_s, 0.0
                continue
            passed_s = max(own.stamp_s - before.stamp_s, 0.0)
            before.stamp_s = own.stamp_s
            before.driven_m = driven_m = before.driven_m + math.hypot(own.vx_m_s, own.vy_m_s) * passed_s
            used = driven_m * docks[robot_id].cost_per_m
            if used > _FROZEN_CHARGE:
                cause = f"the charge has not fallen from {before.charge:.2f} in {driven_m:.1f} m, which use {used:.2f}"
                robot.log.note(Assumption.DISCHARGE, now_s, cause, used - _FROZEN_CHARGE, "")
