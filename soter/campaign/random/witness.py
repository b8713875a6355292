"""Simulated backends with a witness, which records true poses and charges at every period.

The witness watches the engine itself, and uses neither the stack, nor the robots' samples, nor the simulator's judge.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.adapters.pybullet import (
    KinematicBackend,
    KinematicConfig,
    PyBulletBackend,
    PyBulletConfig,
    SimulatedFleet,
)
from soter.sdk import RobotSpec
from soter_sim import Engine

WATCHED: Final = {
    "pybullet": "soter.campaign.random.witness:WatchedPyBullet",
    "kinematic": "soter.campaign.random.witness:WatchedKinematic",
}
"""For each backend, the same backend with a witness."""

Series = NDArray[np.float64]


class EngineWitness:
    """An engine that records the motions of another one; `soter_sim.Engine`."""

    def __init__(self, engine: Engine) -> None:
        self._engine: Final = engine
        self.bodies, self.period_s, self.record = engine.bodies, engine.period_s, engine.record
        self.ids: Final = engine.bodies.ids
        self._done = 0
        self._noted = array("d")
        self._note()

    def run(self, until_period: int) -> None:
        for period in range(self._done + 1, until_period + 1):
            self._engine.run(period)
            self._done = period
            self._note()

    def velocity(self, index: int) -> tuple[float, float]:
        return self._engine.velocity(index)

    def close(self) -> None:
        self._engine.close()

    def _note(self) -> None:
        bodies = self.bodies
        self._noted.extend(bodies.x)
        self._noted.extend(bodies.y)
        self._noted.extend(bodies.charge)

    def seen(self, until_s: float) -> tuple[Series, Series, Series, Series]:
        """Return times up to `until_s`, and, by time and robot, metres east, metres north and charges."""
        count = int(until_s / self.period_s + 1e-6) + 1
        found = np.frombuffer(self._noted).reshape(-1, 3, len(self.ids))[:count]
        return np.arange(len(found), dtype=np.float64) * self.period_s, found[:, 0], found[:, 1], found[:, 2]


witnesses: Final[list[EngineWitness]] = []
"""One witness for each world opened in this process, in order."""


class WatchedPyBullet(PyBulletBackend):
    """The backend `pybullet`."""

    def open(self, config: PyBulletConfig | KinematicConfig, robots: Sequence[RobotSpec]) -> SimulatedFleet:
        fleet = super().open(config, robots)
        fleet.world.engine = witness = EngineWitness(fleet.world.engine)
        witnesses.append(witness)
        return fleet


class WatchedKinematic(WatchedPyBullet, KinematicBackend):
    """The backend `kinematic`."""
