"""The base class of advanced controllers, and the arena that they are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from soter.config.tables import RtaTable
from soter.rta import Report
from soter.sdk import Capabilities, RobotState, Waypoint
from soter.stack.kit import RobotPort
from soter.stack.terrain import Terrain


class ControllerOptions(BaseModel):
    """Options of a controller without any, and a base for others' options: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


@dataclass(frozen=True)
class Arena:
    """What a controller sees and drives.

    Attributes:
        terrain: distances to fence and boxes; `terrain.workspace` also has the chargers.
        ports: by robot, the ports of the robots that the controller drives, and the only ones it may command.
        everybody: by robot, the ports of all robots, to read their states.
        capabilities: what its robots promise, by robot.
        rta: the settings of the safety modules.
        base_tick_s: period of the supervisors.
        seed: the run's seed.
    """

    terrain: Terrain
    ports: Mapping[int, RobotPort]
    everybody: Mapping[int, RobotPort]
    capabilities: Mapping[int, Capabilities]
    rta: RtaTable
    base_tick_s: float
    seed: int

    def random(self, name: str) -> Random:
        """Return a random generator that depends only on the run's seed and the name."""
        # This text is part of the seed: changing it changes the figures of docs/adversaries.md.
        return Random(f"adversary {name}, seed {self.seed}")

    def states(self) -> dict[int, RobotState]:
        """Return the latest sample of every robot that has one."""
        return {robot_id: port.state for robot_id, port in self.everybody.items() if port.state is not None}

    def peers_of(self, robot_id: int) -> list[RobotState]:
        """Return the latest samples of the other robots, the nearest first."""
        states = self.states()
        own = states.pop(robot_id, None)
        if own is None:
            return []
        return sorted(states.values(), key=lambda peer: (peer.x_m - own.x_m) ** 2 + (peer.y_m - own.y_m) ** 2)

    def looked(self, tick: int, delta_s: float) -> bool:
        """Return whether a module with this Delta looked at this tick, and so will not look again for a whole Delta."""
        return tick % max(1, round(delta_s / self.base_tick_s)) == 0


class Controller:
    """An advanced controller (AC). It is untrusted: the safety modules keep their rules whatever it does.

    A subclass defines `step`, which is called at every tick and returns where one robot is to go. There is one instance
    per robot, unless the class says `fleet = True`: then one instance drives all robots, and is called for each in
    turn. A controller that commands robots together defines `act` instead, and sends commands through `arena.ports`.

    It is called between two ticks: in virtual time in the supervisor's process, on a wall clock in a process of its
    own. If its commands depend only on its options, the arena, the samples and `random`, the same seed gives the same
    run, bit for bit. A controller for which this does not hold says so by `incidents`.

    An exception, or a command that is no waypoint or not finite, ends the controller: safe controllers have its robots
    for the rest of the run, and the result says why. A call that does not return ends the run in virtual time, and on
    a wall clock the process with all controllers in it.

    Args:
        options: an instance of `Options`.

    Attributes:
        options: the options; annotate it with your own `Options`.
        arena: what it sees and drives; from `begin` on.
        random: its own random generator, from the run's seed and the ids of its robots; from `begin` on.
    """

    Options: ClassVar[type[BaseModel]] = ControllerOptions
    """The model of the mission file's table `[controllers.CLASS]`; it has to forbid unknown keys."""

    fleet: ClassVar[bool] = False
    """Whether one instance drives all robots."""

    per_process: ClassVar[bool] = False
    """Whether a fleet's controller may have one instance in each process of a distributed mission, which drives that
    process's robots and only sees the others."""

    options: Any
    arena: Arena
    random: Random

    def __init__(self, options: Any) -> None:
        self.options = options

    def begin(self, arena: Arena) -> None:
        """Take the robots over; called once, before the first tick. An override calls this one first."""
        self.arena = arena
        self.random = arena.random(f"robots {sorted(arena.ports)}")

    def step(self, own: RobotState, now_s: float) -> Waypoint | None:
        """Return where a robot is to go from now on, or None to keep its last command.

        Called at every tick while the AC has control of that robot; commands from before it lost control are
        forgotten.

        Args:
            own: the robot's latest sample.
            now_s: fleet time of the tick.
        """
        raise NotImplementedError

    def act(self, now_s: float, tick: int) -> None:
        """Send commands through the ports; by default what `step` returns for each robot.

        Args:
            now_s: fleet time of the tick.
            tick: its number, from 0.

        Raises:
            TypeError: `step` returned anything but a waypoint of numbers.
            ValueError: a number is not finite, or out of range.
        """
        for port in self.arena.ports.values():
            if port.state is None or not port.engaged:
                continue
            goal = self.step(port.state, now_s)
            if goal is None:
                continue
            if type(goal) is not Waypoint:
                raise TypeError(f"step() returned a {type(goal).__name__}, allowed: a Waypoint, or None")
            goal.check()
            port.goto(goal)

    def hear(self, report: Report) -> None:
        """Take a port's report, in the middle of a tick: a goal that ended, control lost or regained.

        Does nothing by default.
        """

    @property
    def incidents(self) -> Sequence[str]:
        """Return what made this run non-deterministic; empty by default."""
        return ()

    def close(self) -> None:
        """End what the controller started. Does nothing by default."""
