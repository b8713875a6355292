"""Starts simulated robots that velocities are streamed to: a world and, for each robot, its mux, as processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pydantic import TypeAdapter

from soter.errors import RobotUnavailable
from soter.sdk import RobotSpec, program
from soter.workspace import Workspace

START_TIMEOUT_S: Final = 30.0


class StreamedSimulator(ABC):
    """A world in real time and its robots' muxes, which end with this process, however it ends.

    It starts the world's process, which then waits for the world: `_hand_over`. Muxes may be started before or after.

    Args:
        module: the world's program, see `soter_sim.streamed_program`.
        prefix: what stands before the name of each robot's namespace.
        robots: its robots.
        environment: of the processes, besides that of Python.
        options: more arguments of the world's program.

    Attributes:
        namespaces: by robot, where its messages are.
        truth: where the world tells what really happens, as `host:port`.
        world: the process of the world.
        muxes: by robot, the process of its mux.
    """

    truth: str

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
        """Start the mux of a robot, in place of the one that it had."""

    def close(self) -> None:
        """End the processes and wait until they are gone. Idempotent."""
        program.end([self.world, *self.muxes.values()])

    def _hand_over(self, workspace: Workspace) -> dict[str, Any]:
        """Hand the world to its process and return what that says of it.

        Raises:
            RobotUnavailable: it does not start; everything that was started has ended.
        """
        described = TypeAdapter(tuple[Workspace, tuple[RobotSpec, ...]]).dump_json((workspace, self._robots))
        try:
            told: dict[str, Any] = json.loads(program.first_line(self.world, described, START_TIMEOUT_S))
            self.truth = told["truth"]
        except (ValueError, KeyError, OSError) as failure:
            self.close()
            raise RobotUnavailable(
                f"the simulated robots do not start: {failure}; what they say is on standard error, and "
                f"`{sys.executable} -m {self._module} --help` must work"
            ) from failure
        return told

    def _start(self, module: str, *arguments: str, pipes: bool) -> subprocess.Popen[bytes]:
        """Start a module that takes `--parent PID`."""
        kind = subprocess.PIPE if pipes else subprocess.DEVNULL
        paths = os.pathsep.join(filter(None, sys.path))
        # A session of its own: Ctrl-C in a terminal is for who commands the robots, and stops them in good order.
        return subprocess.Popen(
            [sys.executable, "-m", module, "--parent", str(os.getpid()), *arguments],
            stdin=kind, stdout=kind, start_new_session=True, env={**self._environment, "PYTHONPATH": paths},
        )  # fmt: skip
