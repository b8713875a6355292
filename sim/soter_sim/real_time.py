"""A world that keeps pace with the host's clock and serves its truth, for simulated robots on a wire."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.kinematic import KinematicEngine
from soter_sim.truth_server import TruthServer
from soter_sim.world import World


class RealTimeWorld(ABC):
    """A world in real time.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        limits: what the mission promises.
        step_s: control period and integration step.
        truth_port: port that serves the truth; 0 for any free one.
        speedup: seconds of the world per second of the host.

    Attributes:
        world: the world.
        truth: serves its truth.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        limits: RuleLimits,
        step_s: float,
        truth_port: int = 0,
        speedup: float = 1.0,
    ) -> None:
        self.world: Final = World(workspace, robots, partial(KinematicEngine, step_s=step_s), limits)
        self.truth: Final = TruthServer(self.world, truth_port)
        self._step_s: Final = step_s
        self._pace_s: Final = step_s / speedup

    def run(self, stop: Callable[[], bool]) -> None:
        """Keep pace with the host's clock until told to stop.

        After a delay of the host, the world first runs the periods that it has missed, with the commands of that time.
        """
        world, pace_s, began_s = self.world, self._pace_s, time.perf_counter()
        steps = told = 0
        while not stop():
            self._wait(max(0.0, began_s + (steps + 1) * pace_s - time.perf_counter()))
            while began_s + (steps + 1) * pace_s <= time.perf_counter():
                steps += 1
                world.advance(steps * self._step_s)
            self._hear()
            if steps > told:
                self._tell(told, steps)
                self.truth.tell()
                told = steps

    def close(self) -> None:
        """End everything. Idempotent."""
        self.truth.close()
        self._end()
        self.world.close()

    @abstractmethod
    def _wait(self, seconds: float) -> None:
        """Let time of the host pass; incoming messages may end the wait early."""

    def _hear(self) -> None:
        """Take received messages, without waiting."""

    @abstractmethod
    def _tell(self, before: int, steps: int) -> None:
        """Send what is due after `steps` steps, of which `before` were reported already."""

    def _end(self) -> None:
        """Free what a subclass holds. Idempotent."""
