"""What an advanced controller is given, and what it has to do."""

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
    """Options of a controller that has none; a base for those of others: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


@dataclass(frozen=True)
class Arena:
    """Where a controller drives, and with what.

    Attributes:
        terrain: fence and boxes, as distances; `terrain.workspace` also has the chargers.
        ports: the rights of a controller, by robot: those that it drives, and all that may be touched.
        everybody: the ports of all robots, read for where they are.
        capabilities: what its robots promise, by robot.
        rta: what the safety modules promise.
        base_tick_s: period of the supervisors.
        seed: of the run.
    """

    terrain: Terrain
    ports: Mapping[int, RobotPort]
    everybody: Mapping[int, RobotPort]
    capabilities: Mapping[int, Capabilities]
    rta: RtaTable
    base_tick_s: float
    seed: int

    def random(self, name: str) -> Random:
        """Return random numbers that depend on the run's seed and the name alone."""
        # The words are part of the seed: with others, the figures of docs/adversaries.md would be other ones.
        return Random(f"adversary {name}, seed {self.seed}")

    def states(self) -> dict[int, RobotState]:
        """Return the latest sample of every robot that has one."""
        return {robot_id: port.state for robot_id, port in self.everybody.items() if port.state is not None}

    def peers_of(self, robot_id: int) -> list[RobotState]:
        """Return the others, the nearest first."""
        states = self.states()
        own = states.pop(robot_id, None)
        if own is None:
            return []
        return sorted(states.values(), key=lambda peer: (peer.x_m - own.x_m) ** 2 + (peer.y_m - own.y_m) ** 2)

    def looked(self, tick: int, delta_s: float) -> bool:
        """Return whether the module with this Delta looked at this tick: it will not look again for a whole Delta."""
        return tick % max(1, round(delta_s / self.base_tick_s)) == 0


class Controller:
    """An advanced controller (AC). Nobody trusts it: the safety modules keep their rules whatever it does.

    A subclass defines `step`, which is asked at every tick where one robot is to go. There is an instance for each
    robot, unless the class says `fleet = True`: then one instance has all robots, and is asked for each of them in
    turn. One that commands robots together defines `act` instead, and asks through `arena.ports`.

    It is called between two ticks, in virtual time in the supervisor's process, on a wall clock in a process of its
    own. What it does must follow from its options, the arena, what it is shown and `random`: then the same seed gives
    the same run, bit for bit. A controller that cannot keep to that says so by `incidents`.

    What it raises, and a command that is no waypoint or has no finite numbers, ends it: its robots are their safe
    controllers' for the rest of the run, and the result says why. A call that does not return ends the run in virtual
    time, and on a wall clock the process with all controllers in it.

    Args:
        options: an instance of `Options`.

    Attributes:
        options: the same; annotate it with your own `Options`.
        arena: where it drives; from `begin` on.
        random: random numbers of its own, from the run's seed and the ids of its robots; from `begin` on.
    """

    Options: ClassVar[type[BaseModel]] = ControllerOptions
    """Validates the mission file's table `[controllers.CLASS]`; it has to forbid unknown keys."""

    fleet: ClassVar[bool] = False
    """Whether one instance drives all robots."""

    per_process: ClassVar[bool] = False
    """Whether a fleet's controller may be several: of a mission in several processes one in each, which drives the
    robots of that process and is shown all others. It is for one that does without commanding these."""

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
        """Return where a robot is to go from now on, or None to leave it at what it was asked for last.

        Asked at every tick while the AC has control of that robot; what it was asked for before it lost control is
        forgotten.

        Args:
            own: the robot's latest sample.
            now_s: fleet time of the tick.
        """
        raise NotImplementedError

    def act(self, now_s: float, tick: int) -> None:
        """Ask through the ports for what shall happen next; by default what `step` returns for each robot.

        Args:
            now_s: fleet time of the tick.
            tick: its number, from 0.

        Raises:
            TypeError: `step` returned something else than a waypoint, or one with something else than numbers.
            ValueError: a number is not finite, or one that no robot can mean.
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
        """Take what a port reports of its robots, in the middle of a tick: goals that ended, control lost or regained.

        Nothing by default.
        """

    @property
    def incidents(self) -> Sequence[str]:
        """What made this run one that does not repeat."""
        return ()

    def close(self) -> None:
        """End what was started. Nothing by default."""
