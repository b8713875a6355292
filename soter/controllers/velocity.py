"""Controllers that return velocities, as learned policies and most control laws do."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import final

from soter.controllers.base import Arena, Controller
from soter.controllers.tracking import VelocityTracker
from soter.onboard.velocity import Velocity
from soter.sdk import RobotState, Waypoint


class VelocityController(Controller, ABC):
    """A controller that returns velocities. They become short goals, which any robot can follow.

    `soter.controllers.VelocityTracker` makes the goals, and says how well velocities are tracked: forwards, backwards
    if the robot can, turn rates in place up to the robot's own and while driving up to 0.75 rad/s without latency;
    later by a tick, latency and age.
    """

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._trackers = {
            robot_id: VelocityTracker(robot, arena.base_tick_s) for robot_id, robot in arena.capabilities.items()
        }

    @abstractmethod
    def velocity(self, own: RobotState, now_s: float) -> Velocity:
        """Return a robot's velocity and turn rate from now on, `Velocity()` to stand. Called as `step` is.

        Args:
            own: the robot's latest sample.
            now_s: fleet time of the tick.
        """

    @final
    def step(self, own: RobotState, now_s: float) -> Waypoint:
        asked = self.velocity(own, now_s)
        if type(asked) is not Velocity:
            raise TypeError(f"velocity() returned a {type(asked).__name__}, allowed: a Velocity")
        if any(isinstance(each, str | bytes) for each in asked):
            raise TypeError(f"velocity() returned {asked}, allowed: numbers")
        plain = Velocity(float(asked.forward_m_s), float(asked.turn_rad_s))
        if not all(map(math.isfinite, plain)):
            raise ValueError(f"velocity() returned {asked}, allowed: finite numbers")
        return self._trackers[own.robot_id].goal(own, plain, now_s)
