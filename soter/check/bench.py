"""Tries a safety module of a mission in a simulated world: every point of a unit cube is one trial.

`soter.check.trial_run` says what happens in a trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from soter.check.node_failures import failures_of_nodes
from soter.check.stand_in import declared_faults, stand_ins
from soter.check.trial import Attempt, Vector
from soter.check.trial_run import TrialRun, module_of
from soter.config import MissionFile, load_mission
from soter.errors import ConfigError
from soter.faults import FaultyFleet
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.problems import config_error, pydantic_problems
from soter.registry import load_backend
from soter.rta import RTAModule, Timing
from soter.sdk import Fleet, RobotSpec
from soter.stack.assembly import assemble
from soter.stack.declaration import timing_of
from soter.stack.right_of_way import BATTERY, COLLISION

BACKEND: Final = "kinematic"
SEGMENTS: Final = 4
"""Number of courses that the AC steers in turn, each an offset from the course along which the margin falls fastest."""

LONGEST_SEGMENT_S: Final = 6.0
TRIED_ROBOTS: Final = 4
"""How many of a mission's robots, the first ones, take part in trials."""

INIT_TIMEOUT_S: Final = 1.0
_NEAREST, _FARTHEST = 0.75, 4.0
"""Distances from the first robot at which peers begin that are to collide, as shares of phi_safe; how near a user's
rule lets them come is not known."""

CHECKED: Final = "module"
"""Name of a module that is tried without a mission."""


def open_floor(robots: int) -> Workspace:
    """Return a floor of 6 x 6 m without boxes, each robot with a station of its own."""
    places = [(1.5 + 1.5 * (number % 3), 1.5 + 1.5 * (number // 3)) for number in range(robots)]
    return Workspace(
        6.0,
        6.0,
        (),
        tuple(
            RobotPlace(number, x, y, Box(x - 0.2, y - 0.2, x + 0.2, y + 0.2))
            for number, (x, y) in enumerate(places, start=1)
        ),
    )


def floor_bench(
    target: str, options: Mapping[str, object] | None = None, robots: int | None = None, patience_s: float = 60.0
) -> ModuleBench:
    """Return a bench with a single module of the user's own, on an open floor.

    Args:
        target: `package.module:name`, a declaring function or a declaration.
        options: the module's options.
        robots: number of robots; None for two with a rule about pairs, and one with any other.
        patience_s: how long its safe controller may take to get back to phi_safer.

    Raises:
        ConfigError: there is no such module, it does not allow an option, or one robot is to try a rule about pairs.
    """
    module = {CHECKED: {"declare": target, "options": dict(options or {})}}
    tables = {"workspace": Path("open floor"), "backend": BACKEND, "rta": {"modules": (), "module": module}}
    try:
        mission = MissionFile.model_validate(tables)
    except ValidationError as failure:
        raise config_error(pydantic_problems(failure, MissionFile), None) from failure
    return _with_enough(lambda count: ModuleBench(mission, open_floor(count), CHECKED, count, patience_s), robots, 2)


def mission_bench(path: Path | str, name: str, robots: int | None = None, patience_s: float = 60.0) -> ModuleBench:
    """Return a bench with the modules, the workspace and the options of a mission file; see `ModuleBench`.

    `robots` None stands for up to four of the mission's with a rule about pairs, and for one with any other.

    Raises:
        ConfigError: something in the file is not allowed, the mission has no such module, or one robot is to try a rule
            about pairs.
    """
    mission = load_mission(path)
    workspace = mission.read_workspace()
    most = min(len(workspace.robots), TRIED_ROBOTS)
    return _with_enough(lambda count: ModuleBench(mission, workspace, name, count, patience_s), robots, most)


def _with_enough(make: Callable[[int], ModuleBench], robots: int | None, most: int) -> ModuleBench:
    """Return a bench with so many robots; None for as many as the module's rule is about, up to a number."""
    bench = make(robots or most)
    if not bench.module.of_pairs:
        return make(1) if robots is None and most > 1 else bench
    if bench.robots > 1:
        return bench
    raise ConfigError(f"robots is 1, but the rule of '{bench.name}' is about pairs of robots; allowed: 2 or more")


class ModuleBench:
    """One module of a mission on simulated robots, for trials.

    Args:
        mission: has the modules, and the options of the one under test.
        workspace: fence, boxes and chargers, with at least as many robots as take part.
        name: name of the module under test.
        robots: how many robots take part; all of them have the mission's modules and an adversarial AC.
        patience_s: how long the safe controller may take to get back to phi_safer.

    Attributes:
        module: the declaration under test.
        timing: what the robot adds to every horizon.
        base_tick_s: period of the supervisor.
        dimensions: number of coordinates of a point.

    Raises:
        ConfigError: the mission has no such module, or the workspace too few robots.
        IllFormedModule: a module cannot keep its rule on these robots.
    """

    def __init__(
        self, mission: MissionFile, workspace: Workspace, name: str, robots: int = 1, patience_s: float = 60.0
    ) -> None:
        if name not in mission.rta.order:
            known = ", ".join(mission.rta.order) or "none"
            raise ConfigError(f"the mission has no module '{name}' that is on; it has: {known}")
        self._mission: Final = mission
        self.workspace: Final = workspace.with_robots(robots)
        self.name: Final = name
        self.robots: Final = robots
        self.patience_s: Final = patience_s
        self._backend: Final = load_backend(BACKEND)
        self._faults: Final = declared_faults(mission, workspace)
        self._promised: Final = stand_ins(mission, workspace, self._backend.robot_class.declared)
        self._charges: Final = BATTERY in mission.rta.order
        self._per_robot: Final = 3 + self._charges + 2 * SEGMENTS
        self.dimensions: Final = robots * self._per_robot
        self.base_tick_s: Final = mission.base_tick_s
        # Assemble once before any trial, so that a bad declaration fails here, with its own error.
        with self._open(self._specs([0.5] * self.dimensions)) as fleet:
            safety = assemble(mission, self.workspace, fleet.robots, lambda _: None)
            self._terrains: Final = {robot_id: each.terrain for robot_id, each in safety.robots.items()}
            # The first robot's declaration; in trials each robot has its own.
            self.module: Final[RTAModule] = module_of(safety, fleet.robots[0].id, name)
            self.timing: Final[Timing] = timing_of(fleet.robots[0].capabilities, mission.base_tick_s)

    def run(self, vector: Sequence[float]) -> Attempt:
        """Try one point, which decides initial states and the AC's commands. Equal points give equal trials."""
        specs = self._specs(vector)
        if any(self._terrains[spec.id].clearance_m(spec.x_m, spec.y_m) < 0.0 for spec in specs):
            return Attempt(valid=False)
        with self._open(specs) as fleet, failures_of_nodes() as failures:
            safety = assemble(self._mission, self.workspace, fleet.robots, lambda _: None)
            return TrialRun(self, safety, fleet, self._commands(vector), failures).trial()

    @property
    def own_start(self) -> Vector | None:
        """The point at which robots begin where the mission has them; None for collisions, which begin side by side."""
        if self.name == COLLISION:
            return None
        low_x, low_y, high_x, high_y = self.workspace.bounds
        point: list[float] = []
        for place in self.workspace.robots:
            along, across = (place.x_m - low_x) / (high_x - low_x), (place.y_m - low_y) / (high_y - low_y)
            turn = place.heading_rad / math.tau % 1.0
            point += [along, across, turn, *([1.0] if self._charges else []), *[0.5] * (2 * SEGMENTS)]
        return tuple(point)

    @contextmanager
    def _open(self, specs: Sequence[RobotSpec]) -> Iterator[Fleet]:
        config = self._backend.config_model(workspace=self.workspace)
        mission = self._mission
        with ExitStack() as stack:
            fleet = stack.enter_context(self._backend().open(config, specs))
            if self._faults:
                fleet = stack.enter_context(FaultyFleet(fleet, self._faults, mission.seed, mission.base_tick_s))
            for robot in fleet.robots:
                robot.init(INIT_TIMEOUT_S)
            yield fleet

    def _specs(self, vector: Sequence[float]) -> list[RobotSpec]:
        """Return where the robots begin: anywhere, but for the collision module near the first one."""
        specs: list[RobotSpec] = []
        battery = self._mission.battery
        for index, place in enumerate(self.workspace.robots):
            first, second, turn = vector[index * self._per_robot : index * self._per_robot + 3]
            if specs and self.name == COLLISION:
                away_m = self._mission.rta.collision.phi_safe_m * (_NEAREST + second * (_FARTHEST - _NEAREST))
                x_m = specs[0].x_m + away_m * math.cos(math.tau * first)
                y_m = specs[0].y_m + away_m * math.sin(math.tau * first)
            else:
                low_x, low_y, high_x, high_y = self.workspace.bounds
                x_m, y_m = low_x + first * (high_x - low_x), low_y + second * (high_y - low_y)
            charge = vector[index * self._per_robot + 3] if self._charges else 1.0
            specs.append(
                RobotSpec(
                    place.id, x_m, y_m, math.remainder(math.tau * turn, math.tau), max(charge, 0.01),
                    battery.drive_s, battery.idle_s, battery.charge_s, promised=self._promised[place.id],
                )
            )  # fmt: skip
        return specs

    def _commands(self, vector: Sequence[float]) -> dict[int, list[tuple[float, float]]]:
        """Return, for every robot, its AC's courses: until when, and the angle from where the margin falls fastest."""
        commands: dict[int, list[tuple[float, float]]] = {}
        for index, place in enumerate(self.workspace.robots):
            values = vector[(index + 1) * self._per_robot - 2 * SEGMENTS : (index + 1) * self._per_robot]
            ends_s = 0.0
            commands[place.id] = []
            for bearing, length in zip(values[::2], values[1::2], strict=True):
                ends_s += 0.1 + length * LONGEST_SEGMENT_S
                # Most courses are near straight down: a robot that wanders about seldom gets to the edge.
                commands[place.id].append((ends_s, math.pi * (2.0 * bearing - 1.0) ** 3))
        return commands
