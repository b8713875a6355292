"""The surveillance mission: every robot visits target after target, drawn from a set, until the time is up."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from soter.config.tables import DEFAULT_TARGETS
from soter.config.tables import Targets as TargetSet
from soter.errors import ConfigError
from soter.geometry.workspace import Workspace
from soter.machine import Goto, Machine, MachineRef, Next, State, Stay
from soter.missions.mission import Mission
from soter.missions.stage import Stage
from soter.stack.events import Place, RobotJoined, TargetEnded, TargetOutcome, VisitTarget
from soter.stack.kit import RobotKit
from soter.stack.remote import RemoteKit, robot_agent

OUTSIDE_M: Final = 1.0
"""How far outside the fence hostile targets lie, at most."""

_MOST_POINTS: Final = 10_000
_APART_M: Final = 0.5
_TRIES: Final = 1000


def grid_places(workspace: Workspace, body_radius_m: float) -> list[Place]:
    """Return the integer points, also those on the fence, at which a body can stand; in small rooms most are on it.

    Of more than about `_MOST_POINTS`, only every second row and column is looked at, or every third, and so on.
    """
    low_x, low_y, high_x, high_y = workspace.bounds
    step = max(1, math.ceil(math.sqrt((high_x - low_x) * (high_y - low_y) / _MOST_POINTS)))
    return [
        (float(x), float(y))
        for x in range(math.ceil(low_x), math.floor(high_x) + 1, step)
        for y in range(math.ceil(low_y), math.floor(high_y) + 1, step)
        if workspace.clearance_m(x, y, body_radius_m) >= 0.0 and workspace.contains(x, y)
    ]


class Targets:
    """Draws targets, for every robot from a random stream of its own.

    Args:
        name: `grid`, `uniform` (anywhere inside the fence where a body can stand) or `hostile` (anywhere up to
            `OUTSIDE_M` outside the fence, boxes included).

    Raises:
        ConfigError: the set has no place for one of the robots.
    """

    def __init__(self, workspace: Workspace, body_radius_m: Mapping[int, float], name: str, seed: int) -> None:
        self._workspace: Final = workspace
        self._body_radius_m: Final = body_radius_m
        self._seed: Final = seed
        self._streams: dict[int, random.Random] = {}
        self._last: dict[int, Place] = {}
        # Robots of equal size share their points.
        self._grids: Final = {
            radius_m: grid_places(workspace, radius_m) if name == "grid" else []
            for radius_m in set(body_radius_m.values())
        }
        if name == "grid" and not all(self._grids.values()):
            radius_m = next(radius_m for radius_m, places in self._grids.items() if not places)
            raise ConfigError(
                f"it is 'grid', and no integer point in the workspace has room for a body of {radius_m:g} m; "
                "allowed here: 'uniform', 'hostile'",
                key="targets",
            )
        if name == "uniform":
            stream = random.Random("targets")
            for radius_m in self._grids:
                if not any(self._fits(*self._anywhere(stream), radius_m) for _ in range(_MOST_POINTS)):
                    raise ConfigError(
                        f"it is 'uniform', and of {_MOST_POINTS} places drawn there none has room for a body "
                        f"of {radius_m:g} m; allowed here: 'hostile'",
                        key="targets",
                    )
        draws: dict[str, Callable[[random.Random, float], Place]] = {
            "grid": lambda stream, radius_m: stream.choice(self._grids[radius_m]),
            "uniform": self._uniform,
            "hostile": self._hostile,
        }
        self._draw: Final = draws[name]

    def next(self, robot_id: int) -> Place:
        """Return the next target of a robot, not its last one unless the room has hardly another."""
        stream = self._streams.setdefault(robot_id, random.Random(f"targets/{self._seed}/{robot_id}"))
        last, radius_m = self._last.get(robot_id), self._body_radius_m[robot_id]
        place = self._draw(stream, radius_m)
        for _ in range(_TRIES):
            if last is None or math.dist(place, last) >= _APART_M:
                break
            place = self._draw(stream, radius_m)
        self._last[robot_id] = place
        return place

    def _uniform(self, stream: random.Random, radius_m: float) -> Place:
        while True:
            place = self._anywhere(stream)
            if self._fits(*place, radius_m):
                return place

    def _anywhere(self, stream: random.Random) -> Place:
        low_x, low_y, high_x, high_y = self._workspace.bounds
        return stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)

    def _fits(self, x_m: float, y_m: float, radius_m: float) -> bool:
        return self._workspace.clearance_m(x_m, y_m, radius_m) >= 0.0 and self._workspace.contains(x_m, y_m)

    def _hostile(self, stream: random.Random, radius_m: float) -> Place:
        low_x, low_y, high_x, high_y = self._workspace.bounds
        return (
            stream.uniform(low_x - OUTSIDE_M, high_x + OUTSIDE_M),
            stream.uniform(low_y - OUTSIDE_M, high_y + OUTSIDE_M),
        )


@dataclass(frozen=True)
class Tasks:
    """The payload of the task planner; see also `Stage`.

    Attributes:
        next_target: called with a robot's id; returns its next target.
    """

    kits: Mapping[int, RobotKit | RemoteKit]
    next_target: Callable[[int], Place]
    on_target: Callable[[int, int, Place], None]
    on_ended: Callable[[int, int, TargetOutcome], None]


class TaskPlanner(Machine):
    """Creates an agent for every robot, tells them of each other, and gives each the next target when it is done."""

    Starting: State[Tasks] = State(start=True)
    Running: State[None] = State()

    tasks: Tasks

    @Starting.entry
    def _start(self, tasks: Tasks) -> Next:
        self.tasks = tasks
        self.last_target_id = 0
        self.agents: dict[int, MachineRef] = {}
        for robot_id, kit in tasks.kits.items():
            agent = self.create(robot_agent(kit), (kit, self.ref), name=f"RobotAgent {robot_id}")
            for other_id, other in self.agents.items():
                self.send(other, RobotJoined(robot_id, agent))
                self.send(agent, RobotJoined(other_id, other))
            self.agents[robot_id] = agent
        for robot_id in self.agents:
            self._assign(robot_id)
        return Goto(self.Running)

    @Running.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        self.tasks.on_ended(e.robot_id, e.target_id, e.outcome)
        self._assign(e.robot_id)
        return Stay()

    def _assign(self, robot_id: int) -> None:
        self.last_target_id += 1
        place = self.tasks.next_target(robot_id)
        self.tasks.on_target(robot_id, self.last_target_id, place)
        self.send(self.agents[robot_id], VisitTarget(self.last_target_id, place))


class Surveillance(Mission):
    """Machines: a task planner over robot agents, with targets from a set."""

    class Options(Mission.Options):
        """The set that targets are drawn from; see `Targets`."""

        targets: TargetSet = DEFAULT_TARGETS

    options: Options

    @classmethod
    def check_workspace(cls, options: Options, workspace: Workspace, body_radius_m: Mapping[int, float]) -> None:
        Targets(workspace, body_radius_m, options.targets, 0)

    def begin(self, stage: Stage) -> None:
        targets = Targets(stage.workspace, stage.body_radius_m, self.options.targets, stage.seed)
        stage.create(TaskPlanner, Tasks(stage.kits, targets.next, stage.on_target, stage.on_ended), "TaskPlanner")
