"""The base class of missions."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

from pydantic import BaseModel, ConfigDict

from soter.missions.script import Robot, RobotScript, Script
from soter.missions.stage import Stage


class Mission:
    """What the robots are to do. Nobody trusts it: the safety modules keep the rules whatever it asks for.

    A script overrides `run`, a coroutine for each robot. A mission of machines overrides `begin` instead. Both run in
    one thread, in virtual time the same from the same seed, and on a wall clock in a process of their own.

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

    async def run(self, robot: Robot) -> None:
        """Do what one robot is to do; called once for each. A robot whose script has ended stays where it is.

        Only calls of this robot's handle can be awaited. Whatever is raised here costs this robot its AC.
        """
        raise NotImplementedError

    def begin(self, stage: Stage) -> None:
        """Create the machines that do it all, before the first tick; those of scripts unless overridden."""
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
        """Say something, on standard error at once and in the recording."""
        if self._stage is None:
            raise RuntimeError("log() was called before the mission has begun")
        self._stage.say(type(self).__name__, str(text))

    def finish(self) -> None:
        """Say that nothing is left to do: the run ends, and the robots stop. Scripts need not, they end."""
        self.finished = True

    def start(self, stage: Stage) -> None:
        """Begin; called by the mission host."""
        self._stage = stage
        self.begin(stage)
