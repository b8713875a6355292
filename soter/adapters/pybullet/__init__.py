"""Simulated robots in this process, in virtual time: the backends `pybullet` and `kinematic`."""

from soter.adapters.pybullet.backend import (
    KinematicBackend,
    KinematicConfig,
    PyBulletBackend,
    PyBulletConfig,
    SimulatedFleet,
    SimulatedRobot,
)

__all__ = [
    "KinematicBackend",
    "KinematicConfig",
    "PyBulletBackend",
    "PyBulletConfig",
    "SimulatedFleet",
    "SimulatedRobot",
]
