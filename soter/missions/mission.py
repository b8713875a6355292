"""The base class of missions."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import partial
from typing import Any

from pydantic import BaseModel, ConfigDict

from soter.geometry.workspace import Workspace
from soter.missions.script import Robot, RobotScript, Script
from soter.missions.stage import Stage


class Mission:
    """What the robots are to do. It is untrusted: the safety modules keep the rules whatever it commands.

    A script overrides `run`, a coroutine for each robot. A mission of machines overrides `begin` instead. Both run in
    one thread: in virtual time repeatably from the seed, and on a wall clock in a process of their own.

    Args:
        options: an instance of `Options`.
    """

    class Options(BaseModel):
        """The keys of `[mission]`; a mission with options has a subclass of this, under this name."""

        model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    options: Any
    """The checked options; annotate it with your own `Options`."""

    finished = False
    _stage: Stage | None = None

    def __init__(self, options: Any) -> None:
        self.options = options

    @classmethod
    def check_workspace(cls, options: Any, workspace: Workspace, body_radius_m: Mapping[int, float]) -> None:
        """Refuse a workspace that the mission cannot be done in, before any robot is opened; by default none is.

        Args:
            options: an instance of `Options`.
            workspace: fence, obstacles and charging stations.
            body_radius_m: body radii of the robots, by id.

        Raises:
            ConfigError: it cannot be done; `key` names the option that does not fit.
        """

    async def run(self, robot: Robot) -> None:
        """Command one robot; called once for each. A robot whose script has ended stays where it is.

        Only calls of this robot's handle can be awaited. An exception costs this robot its AC.
        """
        raise NotImplementedError

    def begin(self, stage: Stage) -> None:
        """Create the mission's machines, before the first tick; by default those that run scripts."""
        target_ids = itertools.count(1)
        running = set(stage.kits)

        def ended(robot_id: int) -> None:
            running.discard(robot_id)
            if not running:
                self.finish()

        for robot_id in stage.kits:
            script = Script(self.run, robot_id, stage, target_ids, partial(ended, robot_id))
            stage.create(RobotScript, script, f"{type(self).__name__} {robot_id}")

    def log(self, text: object) -> None:
        """Write a message to standard error at once, and into the recording."""
        if self._stage is None:
            raise RuntimeError("log() was called before the mission has begun")
        self._stage.say(type(self).__name__, str(text))

    def finish(self) -> None:
        """End the run, since nothing is left to do; the robots stop. Scripts need not call it: they just return."""
        self.finished = True

    def start(self, stage: Stage) -> None:
        """Begin the mission; called by the mission host."""
        self._stage = stage
        self.begin(stage)
