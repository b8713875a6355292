"""The adapter in process, ready to be broken."""

from __future__ import annotations

from typing import ClassVar

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.onboard.drive import Drive, DriveLimits
from soter.sdk import Goal, RobotState


class Broken(SimulatedRobot):
    """The reference adapter, ready to be broken."""

    caught_by: ClassVar[str]

    def _honest(self) -> RobotState:
        return super()._sample()

    def _drive_with(self, limits: DriveLimits) -> None:
        self._vehicle._drive = Drive(limits, self._world.period_s)


def not_cancelled(_goal: Goal) -> None:
    """Do nothing: these goals are the vehicle's own."""
