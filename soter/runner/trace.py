"""The hash over all states and decisions of a run: equal hashes, equal runs."""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Sequence
from typing import Final

from soter.rta import RobotSupervisor

_FLUSH_AT: Final = 8192


class Trace:
    """Hashes every robot's state and driver at every tick."""

    def __init__(self) -> None:
        self._hash: Final = hashlib.sha256()
        self._numbers: list[float] = []

    def add(self, now_s: float, robots: Sequence[RobotSupervisor]) -> None:
        """Add one tick."""
        numbers = self._numbers
        numbers.append(now_s)
        for robot in robots:
            own = robot.situation.own
            driver = robot.driver
            battery = own.battery
            numbers += (
                own.x_m, own.y_m, own.heading_rad, own.vx_m_s, own.vy_m_s, -1.0 if battery is None else battery,
                -1.0 if driver is None else driver.rank,
            )  # fmt: skip
            for module in robot.modules:
                numbers.append(module.margin)
        if len(numbers) > _FLUSH_AT:
            self._flush()

    def _flush(self) -> None:
        self._hash.update(array("d", self._numbers))
        self._numbers.clear()

    def hexdigest(self) -> str:
        """Return the hash of all added ticks."""
        self._flush()
        return self._hash.hexdigest()
