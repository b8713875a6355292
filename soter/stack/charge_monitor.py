"""Whether charges are reported as they are: that of a robot that drives must fall (A8)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from soter.rta import Assumption, RobotSupervisor
from soter.stack.battery import Dock

_STANDS: Final = 0.05
"""Charge that driving must have used before one that has not fallen counts as frozen: some steps of whole percents."""


class _Stood(NamedTuple):
    charge: float
    stamp_s: float
    driven_m: float


class ChargeMonitor:
    """Watches robots whose charge stays where it is while they drive. Ticked by the arbiter."""

    def __init__(self) -> None:
        self._stood: dict[int, _Stood] = {}

    def look(self, now_s: float, robots: Mapping[int, RobotSupervisor], docks: Mapping[int, Dock]) -> None:
        """Take note of every robot that has driven for longer than a charge that is reported can stay the same."""
        for robot_id, robot in robots.items():
            own = robot.situation.own
            charge, stood = own.battery, self._stood.get(robot_id)
            if charge is None:
                continue
            # One that has risen was charged, whatever it has done since.
            if stood is None or charge != stood.charge:
                self._stood[robot_id] = _Stood(charge, own.stamp_s, 0.0)
                continue
            passed_s = max(own.stamp_s - stood.stamp_s, 0.0)
            driven_m = stood.driven_m + math.hypot(own.vx_m_s, own.vy_m_s) * passed_s
            self._stood[robot_id] = _Stood(stood.charge, own.stamp_s, driven_m)
            used = driven_m * docks[robot_id].cost_per_m
            if used > _STANDS:
                cause = f"the charge has not fallen from {stood.charge:.2f} in {driven_m:.1f} m, which use {used:.2f}"
                robot.log.note(Assumption.DISCHARGE, now_s, cause, used - _STANDS, "")
