"""Checks the modules of a mission without opening its backend: what admits it, and trials of what nothing is proved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from soter.check import Certainty, Falsified, Finding, conditions, falsify
from soter.check.admission import admit_declared, declare_all
from soter.check.bench import ModuleBench
from soter.config import MissionFile
from soter.errors import IllFormedModule
from soter.geometry.workspace import Workspace
from soter.registry import load_backend
from soter.sdk import Capabilities
from soter.specs import promises, read_options
from soter.stack.declaration import Declared
from soter.stack.right_of_way import COLLISION

TRIED_ROBOTS: Final = 4
"""Of the mission's robots, so many take part in trials, the first."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class MissionReport:
    """What is known about the modules of a mission.

    Attributes:
        workspace: where.
        findings: one for each module and condition, in order of the modules' right to drive.
        counterexamples: by module.
        benches: what the counterexamples of a module were found on.
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
        """Whether there is no proof with a gap."""
        return not any(each.verdict is Certainty.PARTLY for each in self.findings)


def check_mission(
    mission: MissionFile, budget: int = 200, seed: int = 0, on_progress: Progress | None = None
) -> MissionReport:
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
        return MissionReport(workspace, [Finding(failure.module, failure.condition, Certainty.REJECTED, text)])


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


class _Checker:
    def __init__(
        self,
        mission: MissionFile,
        workspace: Workspace,
        capabilities: Mapping[int, Capabilities],
        budget: int,
        seed: int,
        tell: Progress,
    ) -> None:
        self._mission, self._workspace, self._budget, self._seed, self._tell = mission, workspace, budget, seed, tell
        self._capabilities: Final = capabilities
        self._declared: Final[dict[int, Declared]] = declare_all(mission, workspace, capabilities)
        self._broken: dict[str, Sequence[Falsified]] = {}
        self._benches: dict[str, ModuleBench] = {}

    def report(self) -> MissionReport:
        self._tell("P1 and P3")
        admission = admit_declared(self._mission, self._declared, self._capabilities)
        known = (*admission.findings, *admission.proofs)
        by_module = {name: [each for each in known if each.module == name] for name in self._mission.rta.order}
        for name, found in by_module.items():
            rejected = any(each.verdict is Certainty.REJECTED for each in found)
            if not rejected and not any(each.condition == "P2a" for each in found):
                found += self._try(name, not admission.refused)
        findings = [each for found in by_module.values() for each in sorted(found, key=lambda one: one.condition)]
        return MissionReport(self._workspace, findings, self._broken, self._benches)

    def _try(self, name: str, well_formed: bool) -> list[Finding]:
        """Return P2 of a module that nothing is proved of, as trials show it."""
        if not well_formed:
            text = "not tested: another module of the mission is rejected, so that nothing can be run"
            return [Finding(name, condition, Certainty.ASSUMED, text) for condition in ("P2a", "P2b")]
        # A rule may be about several robots, and whether it is, only the user's module knows.
        robots = min(len(self._workspace.robots), TRIED_ROBOTS)
        if name == COLLISION and robots < 2:
            return [Finding(name, each, Certainty.PROVED, "there is no second robot") for each in ("P2a", "P2b")]
        try:
            bench = ModuleBench(self._mission, self._workspace, name, robots)
        except IllFormedModule as failure:
            text = f"not tested: simulated robots cannot do what the mission's promise: {failure}"
            return [Finding(name, condition, Certainty.ASSUMED, text) for condition in ("P2a", "P2b")]
        budget = self._budget
        found, broken = falsify(bench, budget, self._seed, lambda done: self._tell(f"{name}: trial {done} of {budget}"))
        if broken:
            self._broken[name], self._benches[name] = broken, bench
        how = "one robot" if robots == 1 else f"{robots} robots jointly"
        return [
            Finding(each.module, each.condition, each.verdict, f"{how}, not proved: {each.text}", each.figures)
            for each in found
        ]
