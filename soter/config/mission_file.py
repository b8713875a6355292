"""The mission file: the mission, its workspace and robots, and the safety modules' settings.

A mission does not depend on the kind of robots: the same file runs on every backend. Options of a backend or planner
are in tables of their own, `[backends.NAME]` and `[planners.NAME]`, and are checked by that class's model; so are those
of an adversary, `[adversaries.NAME]`, of any other controller, `[controllers.CLASS]`, of the mission, `[mission]`, and
each `[[fault]]`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import (
    Field,
    PrivateAttr,
    model_validator,
)

from soter.config.promises import RobotsTable
from soter.config.table import Name, Table, wrong
from soter.config.tables import (
    DEFAULT_TARGETS,
    MODULES,
    SURVEILLANCE,
    BatteryTable,
    DistributionTable,
    IsolationTable,
    MissionTable,
    RawTables,
    ReseedTable,
    RtaTable,
    Targets,
)
from soter.errors import ConfigError
from soter.geometry.draft import Spot
from soter.geometry.reading import read_workspace
from soter.geometry.site import Site
from soter.geometry.site_toml import RobotTable, StationTable
from soter.geometry.workspace import Workspace
from soter.geometry.workspace_xml import BODY_RADIUS_M
from soter.problems import (
    Problem,
    config_error,
    is_file,
    line_of,
    read_limited,
    split_key,
)

INITIAL_CHARGE: Final = (0.60, 1.00)
"""Range from which a robot's initial charge is drawn unless the mission gives one."""


class MissionFile(Table):
    """A mission, the same for every backend.

    Attributes:
        mission: the mission by name, and its options.
        workspace: the workspace file; `load_mission` makes it relative to the mission file.
        station: charging stations for a workspace file without any, in the order of the robots.
        start: where the robots of such a workspace start; on their stations if not given.
        backend: the robots' backend, by name.
        duration_s: how long the mission lasts.
        seed: seed of all random numbers.
        targets: short for the option `targets` of the mission.
        robots: how many of the workspace's robots take part, and what single ones promise.
        ac: what the ACs are: the mission's own machines, `adversary:NAME`, or a controller as `file.py:Class` or
            `module:Class`.
        planner: the motion planner, by name.
        target_timeout_s: time after which a target is given up.
        base_tick_s: how often controllers publish and supervisors tick.
        battery: the batteries.
        rta: the safety modules.
        backends: raw options, by backend.
        planners: raw options, by planner.
        adversaries: raw options, by adversary.
        controllers: raw options of controllers of the user's own, by the name of the class.
        isolation: limits of the mission's process.
        fault: raw tables of the faults to inject, see `soter.faults`.
        reseed: times from which faults draw from other seeds.
        distribution: the processes and their parts; without any, everything is in one process.
    """

    mission: MissionTable = MissionTable()
    workspace: Annotated[Path, Field(strict=False)]
    station: Annotated[tuple[StationTable, ...], Field(strict=False)] = ()
    start: Annotated[tuple[RobotTable, ...], Field(strict=False)] = ()
    backend: Name = "pybullet"
    duration_s: Annotated[float, Field(ge=0.001, le=1e7, allow_inf_nan=False)] = 600.0
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    targets: Targets | None = None
    robots: RobotsTable = RobotsTable()
    ac: Name = "mission"
    planner: Name = "ompl-bitstar"
    target_timeout_s: Annotated[float, Field(ge=0.1, le=1e6, allow_inf_nan=False)] = 120.0
    base_tick_s: Annotated[float, Field(ge=0.001, le=1.0, allow_inf_nan=False)] = 0.05
    battery: BatteryTable = BatteryTable()
    rta: RtaTable = RtaTable()
    isolation: IsolationTable = IsolationTable()
    backends: RawTables = Field(default_factory=dict)
    planners: RawTables = Field(default_factory=dict)
    adversaries: RawTables = Field(default_factory=dict)
    controllers: RawTables = Field(default_factory=dict)
    fault: Annotated[tuple[dict[str, Any], ...], Field(strict=False)] = ()
    reseed: Annotated[tuple[ReseedTable, ...], Field(strict=False)] = ()
    distribution: DistributionTable = DistributionTable()

    _source: str | None = PrivateAttr(default=None)
    _lines: dict[tuple[str, ...], int] = PrivateAttr(default_factory=dict)
    _overridden: dict[tuple[str, ...], str] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _whole_ticks(self) -> Self:
        if self.targets is not None and "targets" in self.mission.options:
            raise wrong(("targets",), self.targets, "one of targets and mission.targets")
        for name in (*MODULES, *(["path"] if self.rta.path.enabled else [])):
            delta_s = getattr(self.rta, name).delta_s
            ticks = round(delta_s / self.base_tick_s)
            # Compare as decimals: 0.15 is three ticks of 0.05, though not in binary.
            if ticks < 1 or not math.isclose(ticks * self.base_tick_s, delta_s, rel_tol=1e-9):
                nearest_s = max(1, ticks) * self.base_tick_s
                allowed = (
                    f"a multiple of base_tick_s, which is {self.base_tick_s:.12g}; the nearest is {nearest_s:.12g}"
                )
                raise wrong(("rta", name, "delta_s"), delta_s, allowed)
        return self

    @property
    def options(self) -> dict[str, Any]:
        """The mission's own options, raw: those of `[mission]`, and `targets`."""
        short = {} if self.targets is None else {"targets": self.targets}
        return {**short, **self.mission.options}

    @property
    def targets_from(self) -> str:
        """The set that the surveillance mission draws its targets from; empty for any other mission."""
        known = self.mission.use == SURVEILLANCE
        return str(self.options.get("targets", DEFAULT_TARGETS)) if known else ""

    @property
    def source(self) -> str | None:
        """The file that the mission was read from, for error messages; None if it was made in code."""
        return self._source

    @property
    def overridden(self) -> Mapping[tuple[str, ...], str]:
        """The keys, split at their dots, whose values did not come from the file, and where they came from instead."""
        return self._overridden

    def initial_charge(self, robot_id: int) -> float:
        """Return a robot's initial charge, from 0 to 1: the given one, or one drawn from the seed."""
        given = (self.battery.initial or {}).get(robot_id)
        return draw_charge(self.seed, robot_id) if given is None else given

    @property
    def _least_radius_m(self) -> float:
        """The radius of a TurtleBot, or the smallest that the mission gives; larger bodies are looked at by `check`."""
        common = self.backends.get(self.backend, {}).get("promise", {})
        given = [each.body_radius_m for each in self.robots.promises.values()]
        given += [common.get("body_radius_m")] if isinstance(common, Mapping) else []
        # What is no radius, its backend refuses.
        return min([BODY_RADIUS_M, *(each for each in given if isinstance(each, int | float) and each > 0.0)])

    def read_workspace(self) -> Workspace:
        """Read the workspace, check the mission against it, and keep only the mission's robots.

        Raises:
            ConfigError: the workspace file is not allowed, or lacks something that the mission needs.
        """
        if not is_file(self.workspace):
            try:
                read_limited(self.workspace, "workspace file")
            except ConfigError as failure:
                # Blame the key, since the file does not exist.
                raise self.refusal("workspace", str(failure)) from failure
        workspace = read_workspace(
            self.workspace,
            phi_safer_m=self.rta.obstacle.phi_safer_m,
            spacing_m=self.rta.collision.phi_safer_m,
            body_radius_m=self._least_radius_m,
            stations=[self._given_at("station", n, each.spot(n + 1)) for n, each in enumerate(self.station)],
            starts=[self._given_at("start", n, each.spot()) for n, each in enumerate(self.start)],
        )
        problems = []
        ids = [place.id for place in workspace.robots]
        for key, named in (("battery.initial", self.battery.initial or {}), ("robots", self.robots.promises)):
            for robot_id, value in named.items():
                if robot_id not in ids:
                    said = f"it is {value:g}, but " if isinstance(value, float) else ""
                    message = f"{said}{self.workspace} has no robot {robot_id}; allowed: {_listed(ids)}"
                    problems.append(self._problem(f"{key}.{robot_id}", message))
        low_x, low_y, high_x, high_y = workspace.bounds
        inset_m, least_m = self.rta.geofence.phi_safer_inset_m, min(high_x - low_x, high_y - low_y)
        if isinstance(workspace, Site) and workspace.plan.fence is None:
            if "geofence" in self.rta.order:
                message = f"{self.workspace} has no outer boundary that the geofence module could keep"
                problems.append(self._problem("rta.modules", f"{message}; give it one, or leave the module out"))
        elif 2.0 * inset_m >= least_m:
            message = f"it is {inset_m:.12g}, which leaves nothing of a workspace {least_m:.12g} m wide"
            allowed = f"allowed: below {least_m / 2.0:.12g}"
            problems.append(self._problem("rta.geofence.phi_safer_inset_m", f"{message}; {allowed}"))
        count = self.robots.count
        if count is not None and count > len(ids):
            message = f"it is {count}, but {self.workspace} has {len(ids)}"
            advice = "for more, add robots and charging stations to the workspace file"
            problems.append(self._problem("robots", f"{message}; allowed: 1 to {len(ids)}; {advice}"))
        problems += self._misplaced(ids[:count])
        if problems:
            raise config_error(problems, self.source)
        return workspace if count is None else workspace.with_robots(count)

    def _given_at(self, table: str, number: int, spot: Spot) -> Spot:
        """Return a station or start with the place in this file that has it."""
        problem = self._problem(f"{table}.{number}", "")
        return replace(spot, line=problem.line, source=problem.source or self.source)

    def _misplaced(self, ids: Sequence[int]) -> list[Problem]:
        """Return the problems with the assignment of robots to processes."""
        key, processes = "distribution.processes", self.distribution.processes
        problems = [
            self._problem(f"{key}.{name}.robots", f"there is no robot {robot_id}; allowed: {_listed(ids)}")
            for name, table in processes.items()
            for robot_id in table.robots
            if robot_id not in ids
        ]
        homeless = set(ids) - {robot_id for table in processes.values() for robot_id in table.robots}
        if processes and homeless:
            message = f"no process has the robots {_listed(sorted(homeless))}; allowed: every robot in exactly one"
            problems.append(self._problem(key, message))
        # Controllers need no task planner.
        if processes and self.ac == "mission" and not any(table.planner for table in processes.values()):
            message = f"it is {[*processes]}, allowed: planner = true in exactly one process; it is in none"
            problems.append(self._problem(key, message))
        return problems

    def read_from(self, source: str, lines: dict[tuple[str, ...], int], overridden: dict[tuple[str, ...], str]) -> Self:
        """Note where the values come from, for error messages; return the mission.

        Args:
            source: the file.
            lines: the lines of its keys.
            overridden: where other values come from, by key.
        """
        self._source, self._lines, self._overridden = source, lines, overridden
        return self

    def refusal(self, key: str, message: str) -> ConfigError:
        """Return an error about the value of one dotted key, with the place where it was given."""
        return self._problem(key, message).error(self.source)

    def _problem(self, key: str, message: str) -> Problem:
        """Return a problem of one key, with the place where its value was given."""
        parts = split_key(key)
        in_file = any(each[: len(parts)] == parts for each in self._lines)
        origin = next(
            (
                origin
                for given, origin in self._overridden.items()
                # A table that only an override names, such as a misspelt one, comes from there.
                if parts[: len(given)] == given or (given[: len(parts)] == parts and not in_file)
            ),
            None,
        )
        return Problem(message, key, line_of(parts, self._lines) if origin is None else None, origin)


def _listed(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids))


def draw_charge(seed: int, robot_id: int) -> float:
    """Return an initial charge, uniform in `INITIAL_CHARGE`; equal for equal arguments."""
    # Seeding with a text uses SHA-512, so neighbouring seeds and ids give unrelated draws, on every platform.
    return random.Random(f"initial charge, seed {seed}, robot {robot_id}").uniform(*INITIAL_CHARGE)
