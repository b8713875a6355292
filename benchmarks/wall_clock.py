"""The kinematic world on a wall clock: robots for benchmarks of what time does to the supervisor."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import ClassVar

from soter.adapters.pybullet import KinematicConfig
from soter.adapters.pybullet.backend import SimulatedRobot
from soter.clock import Clock
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Capabilities, Fleet, Robot, RobotSpec
from soter_sim import World
from soter_sim.kinematic import KinematicEngine

JITTER_S = 0.03
STEP_S = 0.01


class WallClock(Clock):
    """The host's time. The world catches up with it whenever somebody has slept, by whole periods."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._start_s = time.perf_counter()

    def now(self) -> float:
        return time.perf_counter() - self._start_s

    def sleep_until(self, time_s: float) -> None:
        while (left_s := time_s - self.now()) > 0.0:
            time.sleep(left_s)
        self._world.advance(self.now())


class WallClockRobot(SimulatedRobot):
    """A simulated robot that promises no more than it can keep while time passes by itself."""

    declared: ClassVar[Capabilities] = replace(
        SimulatedRobot.declared, in_process=False, deterministic=False, sample_age_s=0.04, jitter_s=JITTER_S
    )


class WallClockFleet(Fleet):
    """Robots of one world in this process, in real time."""

    def __init__(self, world: World, specs: Sequence[RobotSpec]) -> None:
        clock = WallClock(world)
        super().__init__(clock, [WallClockRobot(spec, clock, world) for spec in specs], world.truth)
        self._world = world

    def _close(self) -> None:
        self._world.close()


class WallClockBackend(Backend):
    """Opens them."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = KinematicConfig
    robot_class: ClassVar[type[Robot]] = WallClockRobot

    def open(self, config: KinematicConfig, robots: Sequence[RobotSpec]) -> WallClockFleet:
        """Build the world and put the robots into it."""
        return WallClockFleet(World(config.workspace, robots, partial(KinematicEngine, step_s=STEP_S)), robots)
