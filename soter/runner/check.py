"""Checks the modules of a mission without opening its backend: P1 and P3, proofs of P2 for one robot, and trials."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from soter.check import Cell, Cover, Falsified, Finding, Verdict, conditions, falsify
from soter.config import Mission
from soter.errors import IllFormedModule
from soter.registry import load_backend
from soter.rta import RTAModule
from soter.runner.bench import ModuleBench
from soter.runner.proof import Setting, prove_retreat, prove_way_home
from soter.runner.specs import promises, read_options
from soter.runner.speedup import declare_all
from soter.sdk import Capabilities
from soter.stack.battery import ChargeForTheWayHome
from soter.stack.collision import check_halves
from soter.stack.declaration import GEOFENCE, OBSTACLE, Declared
from soter.stack.right_of_way import BATTERY, COLLISION
from soter.stack.safe_controller import LOOK_AGAIN_S
from soter.stack.terrain import Terrain
from soter.workspace import Workspace

CELL_TRIALS: Final = 60
"""Trials that begin in cells that could not be proved, at most."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Report:
    """What is known about the modules of a mission.

    Attributes:
        workspace: where.
        findings: one for each module and condition, in order of the modules' right to drive.
        unproved: cells that could not be proved and why, by module.
        counterexamples: by module.
        benches: what the counterexamples of a module were found on.
    """

    workspace: Workspace
    findings: Sequence[Finding]
    unproved: Mapping[str, Sequence[tuple[Cell, str]]] = field(default_factory=dict)
    counterexamples: Mapping[str, Sequence[Falsified]] = field(default_factory=dict)
    benches: Mapping[str, ModuleBench] = field(default_factory=dict)

    @property
    def rejected(self) -> bool:
        """Whether any condition fails."""
        return any(each.verdict is Verdict.REJECTED for each in self.findings)

    @property
    def complete(self) -> bool:
        """Whether there is no proof with a gap."""
        return not any(each.verdict is Verdict.PARTLY for each in self.findings)


def check_mission(mission: Mission, budget: int = 200, seed: int = 0, on_progress: Progress | None = None) -> Report:
    """Check every module of a mission against what its backend's robots declare.

    Args:
        mission: the mission; its robots are not opened.
        budget: trials for every module that is tested and not proved.
        seed: everything random is drawn from it.
        on_progress: told what is being done.

    Raises:
        ConfigError: bad input.
        BackendError: the mission's backend cannot be loaded.
    """
    workspace = mission.read_workspace()
    backend = load_backend(mission.backend, to_open=False)
    capabilities = promises(backend, read_options(backend, mission, workspace), mission, workspace)
    try:
        return _Checker(mission, workspace, capabilities, budget, seed, on_progress or (lambda _: None)).report()
    except IllFormedModule as failure:
        # It cannot even be declared for these robots: they do not promise what its model needs.
        text = str(failure).partition(": ")[2]
        return Report(workspace, [Finding(failure.module, failure.condition, Verdict.REJECTED, text)])


def check_module(bench: ModuleBench, budget: int = 200, seed: int = 0, on_progress: Progress | None = None) -> Report:
    """Check one module of the user's own: P1 and P3 of its declaration, then trials for P2 and P3."""
    name, tell = bench.name, on_progress or (lambda _: None)
    tell(f"{name}: P1 and P3")
    findings = conditions(bench.module, bench.timing, bench.base_tick_s)
    broken: list[Falsified] = []
    if not any(each.verdict is Verdict.REJECTED for each in findings):
        tried, broken = falsify(bench, budget, seed, lambda done: tell(f"{name}: trial {done} of at most {budget}"))
        found = {each.condition for each in tried}
        findings = [*(each for each in findings if each.condition not in found), *tried]
    ordered = sorted(findings, key=lambda each: each.condition)
    return Report(bench.workspace, ordered, {}, {name: broken} if broken else {}, {name: bench})


class _Checker:
    """One check of a mission."""

    def __init__(
        self,
        mission: Mission,
        workspace: Workspace,
        capabilities: Mapping[int, Capabilities],
        budget: int,
        seed: int,
        tell: Progress,
    ) -> None:
        self._mission, self._workspace, self._budget, self._seed, self._tell = mission, workspace, budget, seed, tell
        self._capabilities: Final = capabilities
        self._terrain: Final = Terrain(workspace, max(each.body_radius_m for each in capabilities.values()))
        # Robots that promise the same need one proof, but for their ways home.
        first = {promised: robot_id for robot_id, promised in reversed([*capabilities.items()])}
        self._kinds: Final = sorted(first.values())
        self._declared: Final[dict[int, Declared]] = declare_all(mission, workspace, capabilities)
        self._unproved: dict[str, Sequence[tuple[Cell, str]]] = {}
        self._broken: dict[str, Sequence[Falsified]] = {}
        self._benches: dict[str, ModuleBench] = {}

    def report(self) -> Report:
        """Check everything."""
        by_module: dict[str, list[Finding]] = {}
        for name in self._mission.rta.order:
            self._tell(f"{name}: P1 and P3")
            by_module[name] = self._conditions(name)
        well_formed = not any(each.verdict is Verdict.REJECTED for found in by_module.values() for each in found)
        for name, found in by_module.items():
            if any(each.verdict is Verdict.REJECTED for each in found):
                continue
            found += self._p2(name, well_formed)
        findings = [each for found in by_module.values() for each in sorted(found, key=lambda one: one.condition)]
        return Report(self._workspace, findings, self._unproved, self._broken, self._benches)

    def _conditions(self, name: str) -> list[Finding]:
        """Return P1 and P3 of a module: those of the robot that is worst off."""
        found: list[Finding] = []
        for declared in self._declared.values():
            module = _named(declared, name)
            found = conditions(module, declared.timing, self._mission.base_tick_s)
            if any(each.verdict is Verdict.REJECTED for each in found):
                break
            if name == COLLISION:
                try:
                    check_halves(module, declared.timing, declared.recovery.leg_m(declared.timing.sample_age_s))
                except IllFormedModule as failure:
                    found.append(Finding(name, "P2a", Verdict.REJECTED, str(failure).partition(": ")[2]))
                    break
        return found

    def _p2(self, name: str, well_formed: bool) -> list[Finding]:
        if name in (OBSTACLE, GEOFENCE):
            return self._worst(name, self._kinds, lambda robot_id: self._retreat(name, robot_id, well_formed))
        if name == BATTERY:
            return self._worst(name, [*self._capabilities], lambda robot_id: self._way_home(robot_id, well_formed))
        if not well_formed:
            text = "not tested: another module of the mission is rejected, so that nothing can be run"
            return [Finding(name, condition, Verdict.ASSUMED, text) for condition in ("P2a", "P2b")]
        robots = 2 if name == COLLISION else 1
        if len(self._workspace.robots) < robots:
            return [Finding(name, each, Verdict.PROVED, "there is no second robot") for each in ("P2a", "P2b")]
        bench = ModuleBench(self._mission, self._workspace, name, robots)
        budget = self._budget
        found, broken = falsify(bench, budget, self._seed, lambda done: self._tell(f"{name}: trial {done} of {budget}"))
        if broken:
            self._broken[name], self._benches[name] = broken, bench
        how = "two robots jointly" if robots == 2 else "one robot"
        return [
            Finding(each.module, each.condition, each.verdict, f"{how}, not proved: {each.text}", each.figures)
            for each in found
        ]

    # --- proofs ----------------------------------------------------------------------------------------------

    def _setting(self, robot_id: int) -> Setting:
        return Setting(self._terrain, self._declared[robot_id], self._capabilities[robot_id])

    def _premise(self, robot_id: int) -> str:
        """Return which promise of a robot the proofs cannot be built on, or an empty text."""
        promised = self._capabilities[robot_id]
        if promised.overshoot_m > promised.tube_m:
            return f"the robot overshoots by {promised.overshoot_m:g} m, more than its tube of {promised.tube_m:g} m"
        if (turn_s := _turn_s(promised)) > LOOK_AGAIN_S:
            return f"a turn takes {turn_s:.2f} s, and after {LOOK_AGAIN_S:g} s at rest the way is chosen anew"
        return ""

    def _start_s(self, robot_id: int) -> float:
        """Return how long it takes to come to rest, look, and turn."""
        promised = self._capabilities[robot_id]
        braking_s = promised.latency_s + promised.v_max_m_s / promised.brake_m_s2
        return braking_s + self._mission.base_tick_s + _turn_s(promised)

    def _worst(self, name: str, robots: Sequence[int], prove: Callable[[int], list[Finding]]) -> list[Finding]:
        """Return the proof for the robot that is worst off."""
        worst: list[Finding] = []
        unproved: Sequence[tuple[Cell, str]] = ()
        for robot_id in robots:
            self._tell(f"{name}: proof for robot {robot_id}")
            if premise := self._premise(robot_id):
                text = f"not proved: {premise}"
                found = [Finding(name, condition, Verdict.ASSUMED, text) for condition in ("P2a", "P2b")]
            else:
                found = prove(robot_id)
            if not worst or _rank(found[0]) > _rank(worst[0]):
                worst, unproved = found, self._unproved.pop(name, ())
        if unproved:
            self._unproved[name] = unproved
        return worst

    def _retreat(self, name: str, robot_id: int, well_formed: bool) -> list[Finding]:
        setting = self._setting(robot_id)
        found = prove_retreat(setting, name)
        module = _named(setting.declared, name)
        back_s = self._start_s(robot_id) + found.cost / setting.capabilities.v_max_m_s + module.dwell_s + module.delta_s
        figures = {"way_m": found.cost, "back_s": back_s}
        stays = "legs and holds keep phi_safe"
        returns = f"a refuge within {found.cost:.2f} m, back in phi_safer within {back_s:.1f} s at the declared speeds"
        return self._from_cover(name, robot_id, found, stays, returns, figures, well_formed)

    def _way_home(self, robot_id: int, well_formed: bool) -> list[Finding]:
        setting, battery = self._setting(robot_id), self._mission.battery
        found, dock = prove_way_home(setting), setting.declared.dock
        module = _named(setting.declared, BATTERY)
        assert isinstance(module.phi_safe, ChargeForTheWayHome)
        reserve, legs = module.phi_safe.reserve, _most_legs(dock.routes.next)
        # What driving at the declared speed does not account for: coming to rest and turning at every corner.
        promised, start_s = setting.capabilities, self._start_s(robot_id)
        extra = legs * (start_s + promised.v_max_m_s / promised.brake_m_s2) / battery.drive_s
        home_s = legs * start_s + found.cost / promised.v_max_m_s
        figures = {"way_m": found.cost, "accounted_m": dock.longest_m, "legs": legs, "extra": extra, "reserve": reserve}
        if found.cost > dock.longest_m:
            text = f"robot {robot_id}: ways home of up to {found.cost:.2f} m, and {dock.longest_m:.2f} m are paid for"
            return [Finding(BATTERY, "P2a", Verdict.REJECTED, text, figures)]
        if extra > reserve:
            text = (
                f"robot {robot_id}: {legs} turns on the way home use up to {100 * extra:.2f} % of a charge, more than "
                f"the reserve of {100 * reserve:.2f} %; reserve_factor = "
                f"{math.ceil(self._mission.rta.battery.reserve_factor * extra / reserve * 10) / 10:g} would do"
            )
            return [Finding(BATTERY, "P2a", Verdict.REJECTED, text, figures)]
        stays = (
            f"robot {robot_id}: ways home of at most {found.cost:.2f} m are paid for ({dock.longest_m:.2f} m), the "
            f"{legs} turns by the reserve ({100 * extra:.2f} of {100 * reserve:.1f} %); waiting for peers is not"
        )
        returns = f"robot {robot_id}: home in {home_s:.0f} s at the declared speeds, charged in {battery.charge_s:g} s"
        return self._from_cover(BATTERY, robot_id, found, stays, returns, figures, well_formed)

    def _from_cover(
        self,
        name: str,
        robot_id: int,
        found: Cover,
        stays: str,
        returns: str,
        figures: Mapping[str, float | int],
        well_formed: bool,
    ) -> list[Finding]:
        """Return P2a and P2b as a cover proves them; of the cells that it does not prove, some are tried."""
        numbers: dict[str, float | int | str | None] = {
            **figures, "proved_m2": found.proved_m2, "unproved_m2": found.unknown_m2,
            "least_side_m": found.least_side_m,
        }  # fmt: skip
        if not found.proved and not found.unknown:
            return [Finding(name, "P2a", Verdict.REJECTED, "no state of the workspace is inside phi_safe", numbers)]
        if found.complete:
            return [
                Finding(name, "P2a", Verdict.PROVED, f"one robot: {stays}", numbers),
                Finding(name, "P2b", Verdict.PROVED, f"one robot: {returns}", numbers),
            ]
        self._unproved[name] = found.unknown
        why = max({why for _, why in found.unknown}, key=lambda one: sum(one == other for _, other in found.unknown))
        share = f"one robot, {100.0 * found.share:.1f} % of the states"
        gap = f"not proved for {found.unknown_m2:.2f} m2 {why}"
        # The bench has the first robot, and its charger.
        first = robot_id == self._workspace.robots[0].id
        tried = self._try_cells(name, found) if well_formed and first else []
        broken = {each.condition for each in tried if each.verdict is Verdict.REJECTED}
        remedy = self._remedy(name)
        return [
            *(each for each in tried if each.verdict is Verdict.REJECTED),
            *(
                Finding(name, condition, Verdict.PARTLY, f"{share}: {text}; {gap}{remedy}{_tried(tried)}", numbers)
                for condition, text in (("P2a", stays), ("P2b", returns))
                if condition not in broken
            ),
        ]

    def _remedy(self, name: str) -> str:
        """Return numbers with which the proof would have no gap, where there are some."""
        if name != OBSTACLE:
            return ""
        setting = self._setting(self._workspace.robots[0].id)
        module, tick_s, v = _named(setting.declared, name), self._mission.base_tick_s, setting.capabilities.v_max_m_s
        delta_s = math.ceil(2.0 * setting.tube_m / v / tick_s - 1e-6) * tick_s
        if module.model is None or delta_s <= module.delta_s:
            return ""
        horizon_s = module.horizon_s(setting.declared.timing) + 2.0 * (delta_s - module.delta_s)
        safer_m = math.ceil(1000.0 * (self._mission.rta.obstacle.phi_safe_m + module.model.bound(horizon_s))) / 1000.0
        return f" (delta_s = {delta_s:g} with phi_safer_m = {safer_m:g} would leave none)"

    def _try_cells(self, name: str, found: Cover) -> list[Finding]:
        """Try starts in cells that could not be proved, with any heading and charge, and any AC."""
        bench = ModuleBench(self._mission, self._workspace, name, 1, patience_s=300.0 if name == BATTERY else 60.0)
        drawn = random.Random(f"unproved cells, seed {self._seed}, module {name}")
        budget = min(CELL_TRIALS, self._budget)
        cells = [drawn.choice(found.unknown)[0] for _ in range(budget)]

        def begin(vector: Sequence[float]) -> Sequence[float]:
            cell = cells[int(vector[0] * len(cells)) % len(cells)]
            return [cell.x_m / self._workspace.width_m, cell.y_m / self._workspace.depth_m, *vector[2:]]

        tried, broken = falsify(_Beginning(bench, begin), budget, self._seed)
        if broken:
            # By the point that was really run, so that it can be run again.
            self._broken[name] = [replace(each, vector=tuple(begin(each.vector))) for each in broken]
            self._benches[name] = bench
        return tried


class _Beginning:
    """A subject whose trials begin where a function says."""

    def __init__(self, inner: ModuleBench, begin: Callable[[Sequence[float]], Sequence[float]]) -> None:
        self.module, self.timing, self.base_tick_s = inner.module, inner.timing, inner.base_tick_s
        self.dimensions, self.patience_s = inner.dimensions, inner.patience_s
        self._inner, self._begin = inner, begin

    def run(self, vector: Sequence[float]) -> Any:
        return self._inner.run(self._begin(vector))


def _turn_s(promised: Capabilities) -> float:
    """Return how long the longest turn before a leg takes at the declared rate."""
    return (math.pi / 2.0 if promised.reverses else math.pi) / promised.yaw_rate_max_rad_s


def _tried(findings: Sequence[Finding]) -> str:
    counted = next((each.figures.get("valid") for each in findings), None)
    return "" if counted is None else f"; {counted} trials from there broke nothing"


def _named(declared: Declared, name: str) -> RTAModule:
    return next(module for module in declared.modules if module.name == name)


def _rank(finding: Finding) -> int:
    return [Verdict.PROVED, Verdict.TESTED, Verdict.ASSUMED, Verdict.PARTLY, Verdict.REJECTED].index(finding.verdict)


def _most_legs(following: Sequence[int]) -> int:
    """Return the largest number of legs of any way home: index 0 is the place, the others say what comes next."""
    most = 1
    for start in range(1, len(following)):
        legs, here = 2, start
        while following[here] != 0 and legs <= len(following):
            here, legs = following[here], legs + 1
        most = max(most, legs)
    return most
