"""Simulated robots whose bases are sent velocities: what they have in common, whatever carries the messages."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Final

from soter.sdk.values import RobotSpec
from soter.workspace import Workspace
from soter_sim.kinematic import KinematicEngine
from soter_sim.truth_server import TruthServer
from soter_sim.world import World

STEP_S: Final = 1.0 / 60.0
_ODOMETRY_STEPS: Final = 2
_BATTERY_STEPS: Final = 30

START_S: Final = 1000.0
"""What the world's clock shows at first, so that nobody can take its time for the host's or for none."""

COMMAND_S: Final = 0.2
"""Motors stop so long after the last velocity, in the world's time."""


class StreamedBase(ABC):
    """The base of one robot: its motors follow the last velocity, and stop when it is old.

    Args:
        world: where it lives.
        robot_id: its number.
    """

    def __init__(self, world: World, robot_id: int) -> None:
        self._world: Final = world
        self._index: Final = world.index(robot_id)
        self._asked = (0.0, 0.0, -COMMAND_S)
        world.set_control(robot_id, self._control)

    def drive(self, forward_m_s: float, turn_rad_s: float) -> None:
        """Take a velocity; one that is not finite is rest. From any thread."""
        if not isfinite(forward_m_s + turn_rad_s):
            forward_m_s = turn_rad_s = 0.0
        self._asked = forward_m_s, turn_rad_s, self._world.now_s

    @abstractmethod
    def tell_odometry(self) -> None:
        """Say where it is and how it moves."""

    @abstractmethod
    def tell_battery(self) -> None:
        """Say its charge."""

    def _control(self, now_s: float, *_state: float) -> tuple[float, float]:
        forward_m_s, turn_rad_s, asked_s = self._asked
        return (forward_m_s, turn_rad_s) if now_s - asked_s < COMMAND_S else (0.0, 0.0)


class StreamedFace(ABC):
    """A world that keeps pace with the host's clock, what its robots say of themselves, and its truth.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        truth_port: where to tell the truth; 0 for any port that is free.
        speedup: seconds of the world in one of the host.

    Attributes:
        world: the world.
        truth: where its truth is told.
        bases: of the robots; to be filled in.
    """

    def __init__(
        self, workspace: Workspace, robots: Sequence[RobotSpec], truth_port: int = 0, speedup: float = 1.0
    ) -> None:
        def engine(_workspace: Workspace, _robots: Sequence[RobotSpec]) -> KinematicEngine:
            return KinematicEngine(_workspace, _robots, STEP_S)

        self.world: Final = World(workspace, robots, engine)
        self.truth: Final = TruthServer(self.world, truth_port)
        self.bases: Final[list[StreamedBase]] = []
        self._pace_s: Final = STEP_S / speedup

    @property
    def clock_s(self) -> float:
        """What the world's clock shows."""
        return START_S + self.world.now_s

    def run(self, stop: Callable[[], bool]) -> None:
        """Keep pace with the host's clock until told to stop.

        A host that was busy is caught up with: the world first lives through what it has missed, with the velocities
        that it had then.
        """
        world, pace_s, began_s = self.world, self._pace_s, time.perf_counter()
        steps = told = 0
        while not stop():
            self._wait(max(0.0, began_s + (steps + 1) * pace_s - time.perf_counter()))
            while began_s + (steps + 1) * pace_s <= time.perf_counter():
                steps += 1
                world.advance(steps * STEP_S)
            if steps > told:
                self._tell(told, steps)
                told = steps

    def close(self) -> None:
        """End everything. Idempotent."""
        self.truth.close()
        self._end()
        self.world.close()

    def _tell(self, before: int, steps: int) -> None:
        """Say what is due after so many steps, `before` of which were told already."""
        self._tell_clock()
        if steps // _ODOMETRY_STEPS > before // _ODOMETRY_STEPS:
            for base in self.bases:
                base.tell_odometry()
        if steps // _BATTERY_STEPS > before // _BATTERY_STEPS:
            for base in self.bases:
                base.tell_battery()
        self.truth.tell()

    @abstractmethod
    def _wait(self, seconds: float) -> None:
        """Let so much of the host's time pass, hearing what comes meanwhile."""

    @abstractmethod
    def _tell_clock(self) -> None:
        """Say what the world's clock shows."""

    def _end(self) -> None:
        """Free what is the face's own. Idempotent."""
