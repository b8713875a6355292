"""Checks the modules of a mission without opening its backend: conditions, proofs, and trials of unproved modules."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from soter.check.admission import admit_declared, declare_all
from soter.check.bench import TRIED_ROBOTS, ModuleBench
from soter.check.conditions import Certainty, Finding, conditions, rejection
from soter.check.falsify import Falsified, falsify
from soter.config import MissionFile
from soter.errors import ConfigError, IllFormedModule, account_of
from soter.geometry.workspace import Workspace
from soter.specs import promises_of
from soter.stack.right_of_way import COLLISION

_REFUSED: Final = Certainty.ASSUMED, "not tested: another module of the mission is rejected, so that nothing can be run"
Progress = Callable[[str], None]


@dataclass(frozen=True)
class MissionReport:
    """What is known about the modules of a mission.

    Attributes:
        findings: one for each module and condition, in order of the modules' priority.
        counterexamples: by module, what was found.
        benches: by module, the bench that its counterexamples were found on.
    """

    workspace: Workspace
    findings: Sequence[Finding]
    counterexamples: Mapping[str, Sequence[Falsified]] = field(default_factory=dict)
    benches: Mapping[str, ModuleBench] = field(default_factory=dict)

    @property
    def rejected(self) -> bool:
        """Whether any condition fails."""
        return any(each.verdict is Certainty.REJECTED for each in self.findings)

    @property
    def complete(self) -> bool:
        """Whether no proof has a gap."""
        return not any(each.verdict is Certainty.PARTLY for each in self.findings)


def check_mission(
    mission: MissionFile, budget: int = 200, seed: int = 0, on_progress: Progress | None = None
) -> MissionReport:
    """Check every module of a mission against the promises of its backend's robots.

    `budget` is the number of trials for each module that is tested instead of proved, and `on_progress` is called with
    what is being done, in words. The robots are not opened.

    Raises:
        ConfigError: bad input.
        BackendError: the mission's backend cannot be loaded.
    """
    workspace = mission.read_workspace()
    capabilities = promises_of(mission, workspace)
    tell = on_progress or (lambda _: None)

    def trial_of(name: str) -> Callable[[int], None]:
        return lambda done: tell(f"{name}: trial {done} of {budget}")

    try:
        declared = declare_all(mission, workspace, capabilities)
    except IllFormedModule as failure:
        # The modules cannot be declared at all: these robots do not promise what a model needs.
        return MissionReport(workspace, [rejection(failure)])
    tell("P1 and P3")
    admission = admit_declared(mission, declared, capabilities)
    known = (*admission.findings, *admission.proofs)
    by_module = {name: [each for each in known if each.module == name] for name in mission.rta.order}
    counterexamples: dict[str, Sequence[Falsified]] = {}
    benches: dict[str, ModuleBench] = {}
    for name, found in by_module.items():
        if any(each.verdict is Certainty.REJECTED or each.condition == "P2a" for each in found):
            continue
        bench = _REFUSED if admission.refused else _bench(mission, workspace, name)
        if not isinstance(bench, ModuleBench):
            found += [Finding(name, condition, *bench) for condition in ("P2a", "P2b")]
            continue
        tried, broken = falsify(bench, budget, seed, trial_of(name))
        if broken:
            counterexamples[name], benches[name] = broken, bench
        how = "one robot" if bench.robots == 1 else f"{bench.robots} robots jointly"
        found += [replace(each, text=f"{how}, not proved: {each.text}") for each in tried]
    findings = [each for found in by_module.values() for each in sorted(found, key=lambda one: one.condition)]
    return MissionReport(workspace, findings, counterexamples, benches)


def _bench(mission: MissionFile, workspace: Workspace, name: str) -> ModuleBench | tuple[Certainty, str]:
    """Return the bench for an unproved module, or the verdict on P2 and its text if there is no trial."""
    # Only the user's module knows whether its rule is about several robots.
    robots = min(len(workspace.robots), TRIED_ROBOTS)
    if name == COLLISION and robots < 2:
        return Certainty.PROVED, "there is no second robot"
    try:
        return ModuleBench(mission, workspace, name, robots)
    except IllFormedModule as failure:
        return Certainty.ASSUMED, f"not tested: simulated robots cannot do what the mission's promise: {failure}"
    except ConfigError as failure:
        # The mission's own robots have it declared already.
        why = account_of(failure.__cause__ or failure)
        return (
            Certainty.ASSUMED,
            f"not tested: with {robots} of {len(workspace.robots)} robots it cannot be made: {why}",
        )


def check_module(
    bench: ModuleBench, budget: int = 200, seed: int = 0, on_progress: Progress | None = None
) -> MissionReport:
    """Check one module of the user's own: P1 and P3 of its declaration, then trials for P2 and P3."""
    name, tell = bench.name, on_progress or (lambda _: None)
    tell(f"{name}: P1 and P3")
    findings = conditions(bench.module, bench.timing, bench.base_tick_s)
    broken: list[Falsified] = []
    if not any(each.verdict is Certainty.REJECTED for each in findings):
        tried, broken = falsify(bench, budget, seed, lambda done: tell(f"{name}: trial {done} of at most {budget}"))
        found = {each.condition for each in tried}
        findings = [*(each for each in findings if each.condition not in found), *tried]
    ordered = sorted(findings, key=lambda each: each.condition)
    return MissionReport(bench.workspace, ordered, {name: broken} if broken else {}, {name: bench})
