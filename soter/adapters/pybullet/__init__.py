"""Simulated robots in this process, in virtual time: the backends `pybullet` and `kinematic`."""

from soter.adapters.pybullet.backend import (
    PERIOD_S,
    KinematicBackend,
    KinematicConfig,
    PyBulletBackend,
    PyBulletConfig,
    SimulatedFleet,
    SimulatedPromise,
    SimulatedRobot,
)

__all__ = [
    "PERIOD_S",
    "KinematicBackend",
    "KinematicConfig",
    "PyBulletBackend",
    "PyBulletConfig",
    "SimulatedFleet",
    "SimulatedPromise",
    "SimulatedRobot",
]
