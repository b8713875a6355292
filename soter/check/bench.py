"""Tries a safety module of a mission in a simulated world: every point of a unit cube is one trial.

A trial puts robots somewhere, lets an adversarial AC drive as long as the module under test allows, and from the first
switch on leaves the robot to the safe controllers, until the module gives it back or patience runs out. It is judged by
true poses.
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
from soter.check.trial import Attempt, BrokenObligation, Obligation, TrialRow
from soter.check.user_rules import UserRules
from soter.config import MissionFile, load_mission
from soter.errors import ConfigError
from soter.faults import FaultyFleet
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.problems import config_error, pydantic_problems
from soter.registry import load_backend
from soter.rta import Assumption, DecisionModule, Region, RTAModule, Situation, Timing
from soter.rta.assumptions import Breach
from soter.rta.module import margin_of
from soter.sdk import Controller, Fleet, RobotSpec, RobotState, Waypoint
from soter.stack.assembly import SafetySide, assemble
from soter.stack.declaration import timing_of
from soter.stack.right_of_way import BATTERY, COLLISION

BACKEND: Final = "kinematic"
SEGMENTS: Final = 4
"""Number of courses that the AC steers in turn, each an offset from the course along which the margin falls fastest."""

LONGEST_SEGMENT_S: Final = 6.0
ATTACK_S: Final = 24.0
"""An AC that was not disengaged within this time has failed."""

TRIED_ROBOTS: Final = 4
"""How many of a mission's robots, the first ones, take part in trials."""

FAR_M: Final = 3.0
INIT_TIMEOUT_S: Final = 1.0
_NEAREST, _FARTHEST = 0.75, 4.0
"""Distances from the first robot at which peers begin that are to collide, as shares of phi_safe; how near a user's
rule lets them come is not known."""

_MOTION: Final = {Assumption.MOTION, Assumption.BRAKING, Assumption.LATENCY, Assumption.POSITION_NOISE}
"""Assumptions on which the models of modules rest."""

_TOLERANCE: Final = 1e-6
_ASIDE_M: Final = 0.01
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
            self.module: Final[RTAModule] = _module(safety, fleet.robots[0].id, name)
            self.timing: Final[Timing] = timing_of(fleet.robots[0].capabilities, mission.base_tick_s)

    def run(self, vector: Sequence[float]) -> Attempt:
        """Try one point, which decides initial states and the AC's commands. Equal points give equal trials."""
        specs = self._specs(vector)
        if any(self._terrains[spec.id].clearance_m(spec.x_m, spec.y_m) < 0.0 for spec in specs):
            return Attempt(valid=False)
        with self._open(specs) as fleet, failures_of_nodes() as failures:
            safety = assemble(self._mission, self.workspace, fleet.robots, lambda _: None)
            return _Run(self, safety, fleet, self._commands(vector), failures).trial()

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


class _Run:
    def __init__(
        self,
        bench: ModuleBench,
        safety: SafetySide,
        fleet: Fleet,
        commands: Mapping[int, list[tuple[float, float]]],
        failures: Sequence[str],
    ) -> None:
        assert fleet.truth is not None
        self._bench, self._safety, self._fleet, self._commands = bench, safety, fleet, commands
        self._failures: Final = failures
        self._robots: Final = tuple(safety.supervisor.robots.values())
        name = bench.module.name
        self._modules: Final[dict[int, DecisionModule]] = {
            robot.robot_id: next(module for module in robot.modules if module.name == name) for robot in self._robots
        }
        declared = {robot_id: (_module(safety, robot_id, name),) for robot_id in safety.modules}
        self._truth: Final = fleet.truth
        self._rules: Final = UserRules(fleet.truth, declared)
        self._rows: list[TrialRow] = []
        self._breaches: list[BrokenObligation] = []
        self._in_sc_since_s: dict[int, float] = dict.fromkeys(self._modules, 0.0)
        self._switched: set[int] = set()
        self._returned: set[int] = set()
        self._returns_s: list[float] = []

    def trial(self) -> Attempt:
        if not self._begins_inside():
            return Attempt(valid=False)
        tick_s, clock = self._bench.base_tick_s, self._fleet.clock
        last = round((ATTACK_S + 2.0 * self._bench.patience_s) / tick_s)
        for tick in range(last):
            now_s = tick * tick_s
            self._safety.supervisor.tick(now_s)
            self._follow(now_s)
            self._attack(now_s)
            clock.sleep_until((tick + 1) * tick_s)
            self._rules.look((tick + 1) * tick_s, self._robots)
            self._judge((tick + 1) * tick_s)
            if self._breaches or self._over(now_s):
                break
        spare = self._spare()
        return Attempt(
            True,
            self._rules.min_margin.get(self._bench.module.name, math.inf),
            max(self._returns_s, default=math.nan),
            spare,
            sum(module.monitor.surprises for module in self._modules.values())
            + sum(breach.times for _, breach in self._unfit()),
            tuple(self._breaches),
            self._rows,
            min(((each.first_s, f"{name}: {each.cause}") for name, each in self._unfit()), default=(0.0, ""))[1],
        )

    def _unfit(self) -> list[tuple[Assumption, Breach]]:
        """Return the failed assumptions about how robots move."""
        return [
            (assumption, breach)
            for robot in self._robots
            for assumption, breach in robot.log.breaches.items()
            if assumption in _MOTION
        ]

    def _begins_inside(self) -> bool:
        """Return whether every robot stands in phi_safe, and the other modules' rules hold as well."""
        samples = [robot.actuator.read() for robot in self._robots]
        for robot, own in zip(self._robots, samples, strict=True):
            situation = Situation(robot.robot_id, own, 0.0)
            situation.peers = [sample for sample in samples if sample is not own]
            for module in self._safety.modules[robot.robot_id]:
                if module.phi_safe is not None and not margin_of(module.phi_safe, situation) >= 0.0:
                    return False
        return True

    def _follow(self, now_s: float) -> None:
        """Record which modules under test took their robot, and which gave it back."""
        for robot_id, module in self._modules.items():
            since_s = self._in_sc_since_s.get(robot_id)
            if module.mode is Controller.SC and since_s is None:
                self._in_sc_since_s[robot_id] = now_s
                self._switched.add(robot_id)
            elif module.mode is Controller.AC and since_s is not None:
                del self._in_sc_since_s[robot_id]
                self._returns_s.append(now_s - since_s)
                if robot_id in self._switched:
                    self._returned.add(robot_id)

    def _attack(self, now_s: float) -> None:
        """Drive every robot whose AC still has control along its present course."""
        for robot_id, port in self._safety.ports.items():
            if not port.engaged or robot_id in self._switched or port.state is None:
                continue
            aside = next((aside for ends_s, aside in self._commands[robot_id] if now_s < ends_s), None)
            if aside is None:
                aside = self._commands[robot_id][-1][1]
            bearing = self._downhill(robot_id) + aside
            port.goto(
                Waypoint(
                    port.state.x_m + FAR_M * math.cos(bearing), port.state.y_m + FAR_M * math.sin(bearing),
                    radius_m=1e-3,
                )
            )  # fmt: skip

    def _downhill(self, robot_id: int) -> float:
        """Return the bearing along which the margin falls fastest from where the robot is; 0 if it is level."""
        region, situation = self._modules[robot_id].module.phi_safe, self._safety.supervisor.robots[robot_id].situation
        if region is None:
            return 0.0
        here = situation.own
        assert isinstance(here, RobotState)
        slopes = []
        for aside in (here._replace(x_m=here.x_m + _ASIDE_M), here._replace(y_m=here.y_m + _ASIDE_M)):
            there = Situation(robot_id, aside, situation.now_s)
            there.peers = situation.peers
            slopes.append(margin_of(region, there) - margin_of(region, situation))
        level = not all(map(math.isfinite, slopes)) or slopes == [0.0, 0.0]
        return 0.0 if level else math.atan2(-slopes[1], -slopes[0])

    def _judge(self, now_s: float) -> None:
        name = self._bench.module.name
        for robot in self._robots:
            robot_id, own = robot.robot_id, robot.situation.own
            x_m, y_m, heading_rad = self._truth.pose(robot_id)
            margin = self._rules.margin.get((robot_id, name), math.nan)
            driver = Controller.AC.value if robot.driver is None else robot.driver.name
            self._rows.append(TrialRow(now_s, robot_id, x_m, y_m, heading_rad, own.battery, margin, driver))
            if margin < -_TOLERANCE:
                self._breaches.append(self._left(now_s, robot_id, margin, x_m, y_m))
            since_s = self._in_sc_since_s.get(robot_id)
            if since_s is not None and now_s - since_s > self._bench.patience_s:
                self._returns_s.append(math.inf)
                text = f"after {self._bench.patience_s:g} s of its safe controller robot {robot_id} is not given back"
                if self._failures:
                    text += f"; {self._failures[-1]}"
                self._breaches.append(BrokenObligation(Obligation.P2B, now_s, robot_id, x_m, y_m, text))

    def _left(self, now_s: float, robot_id: int, margin: float, x_m: float, y_m: float) -> BrokenObligation:
        """Return the obligation that a robot outside phi_safe broke: P2a under its safe controller, else P3."""
        region = self._bench.module.phi_safe
        capabilities = next(robot.capabilities for robot in self._fleet.robots if robot.id == robot_id)
        unit = "" if region is None else f" {region.unit}"
        since_s = self._in_sc_since_s.get(robot_id)
        braking_s = capabilities.latency_s + capabilities.v_max_m_s / capabilities.brake_m_s2 + self._bench.base_tick_s
        where = f"robot {robot_id} at ({x_m:.2f}, {y_m:.2f}) left phi_safe by {-margin:.3f}{unit} after {now_s:.2f} s"
        if since_s is None:
            # How far it was just before says whether the AC was trusted too long, or the margin leapt.
            margins = [row.margin for row in self._rows if row.robot_id == robot_id]
            before = f", with a margin of {margins[-2]:.3f}{unit} a tick before" if len(margins) > 1 else ""
            text = f"{where}, while the AC was trusted{before}"
            return BrokenObligation(Obligation.P3, now_s, robot_id, x_m, y_m, text)
        if robot_id in self._switched and now_s - since_s <= braking_s:
            late = f"{where}, {now_s - since_s:.2f} s after the switch: too late to stop"
            return BrokenObligation(Obligation.P3, now_s, robot_id, x_m, y_m, late)
        failed = f"; {self._failures[-1]}" if self._failures else ""
        text = f"{where}, {now_s - since_s:.2f} s into its safe controller{failed}"
        return BrokenObligation(Obligation.P2A, now_s, robot_id, x_m, y_m, text)

    def _over(self, now_s: float) -> bool:
        """Return whether the trial is over: all robots that were taken over have come back, or none was taken over."""
        all_back = bool(self._switched) and self._switched == self._returned
        return all_back or (not self._in_sc_since_s and now_s > ATTACK_S)

    def _spare(self) -> float:
        longest_s = max(self._returns_s, default=math.nan)
        if math.isnan(longest_s):
            return math.inf
        if math.isfinite(longest_s):
            return self._bench.patience_s - longest_s
        waiting = [robot for robot in self._robots if robot.robot_id in self._in_sc_since_s]
        regions = [(self._modules[robot.robot_id].module.phi_safer, robot.situation) for robot in waiting]
        short = [margin_of(safer, situation) for safer, situation in regions if isinstance(safer, Region)]
        if len(short) < len(regions):
            return -1.0
        return min(-1e-3, min(short, default=-1.0))


def _module(safety: SafetySide, robot_id: int, name: str) -> RTAModule:
    return next(module for module in safety.modules[robot_id] if module.name == name)
