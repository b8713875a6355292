"""Starts velocity-controlled simulated robots: a world and, for each robot, its mux, as processes."""

from __future__ import annotations

import subprocess
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final

from soter.adapters.velocity_controlled.robot import VelocityControlledRobot
from soter.geometry.workspace import Workspace
from soter.sdk import Capabilities, RobotSpec, RuleLimits, program
from soter.sdk.wire import describe


class VelocityControlledSimulator(ABC):
    """A world in real time and its robots' muxes, which end with this process, however it ends.

    The constructor starts the world's process, which then waits for `_hand_over` to describe the world. Muxes may be
    started before or after.

    Args:
        module: the world's program, see `soter_sim.program`.
        prefix: of each robot's namespace.
        robots: the robots.
        environment: of the processes, besides that of Python.
        options: more arguments of the world's program.

    Attributes:
        namespaces: by robot id, the namespace of its messages.
        truth: address of the ground truth, as `host:port`.
        world: the process of the world.
        muxes: by robot id, the process of its mux.
        faults: brings faults into the bases.
    """

    truth: str
    faults: program.Faults

    def __init__(
        self, module: str, prefix: str, robots: Sequence[RobotSpec], environment: Mapping[str, str], *options: str
    ) -> None:
        self.namespaces: Final = {spec.id: f"{prefix}{spec.name or f'robot{spec.id}'}" for spec in robots}
        self.muxes: Final[dict[int, subprocess.Popen[bytes]]] = {}
        self._module: Final = module
        self._robots: Final = tuple(robots)
        self._environment: Final = environment
        named = ",".join(f"{robot_id}={name}" for robot_id, name in self.namespaces.items())
        self.world: Final = self._start(module, "--namespaces", named, *options, pipes=True)

    @abstractmethod
    def start_mux(self, robot_id: int) -> None:
        """Start a robot's mux, in place of any earlier one."""

    def restart(self, robot_id: int) -> None:
        """Restart a robot's base and mux as if its power had been off; its own clock begins anew."""
        mux = self.muxes[robot_id]
        mux.kill()
        mux.wait()
        self.faults.restart(robot_id)
        self.start_mux(robot_id)

    def lost(self) -> str:
        """Return which process has ended, in words; empty while all run."""
        muxes = (program.ended(f"the mux of robot {robot_id}", each) for robot_id, each in self.muxes.items())
        return program.ended("the simulated world", self.world) or next(filter(None, muxes), "")

    def promised(self, robot_id: int) -> Capabilities:
        """Return a robot's promise, which its mux is started with."""
        spec = next(spec for spec in self._robots if spec.id == robot_id)
        return VelocityControlledRobot.declared if spec.promised is None else spec.promised

    def close(self) -> None:
        """End the processes and wait until they are gone. Idempotent."""
        program.end([self.world, *self.muxes.values()])

    def _hand_over(self, workspace: Workspace, limits: RuleLimits) -> dict[str, Any]:
        """Send the world and the mission's limits to the world's process, and return the process's answer."""
        try:
            told = program.hand_over(self.world, self._module, describe(workspace, self._robots, limits))
            self.truth, self.faults = told["truth"], program.Faults(told["control"])
        except BaseException:
            self.close()
            raise
        return told

    def _start(self, module: str, *arguments: str, pipes: bool) -> subprocess.Popen[bytes]:
        return program.start(module, *arguments, pipes=pipes, environment=self._environment)
