"""Checks the modules of a mission without opening its backend: conditions, proofs, and trials of unproved modules.

`soter check` shows what is found, and `soter run` asks whether the mission may be run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from soter.check.admission import admit, admit_declared, check_all, declare_all, refused_at
from soter.check.bench import TRIED_ROBOTS, ModuleBench
from soter.check.conditions import Certainty, Finding, conditions, rejection
from soter.check.falsify import Falsified, falsify
from soter.config import MissionFile
from soter.errors import ConfigError, IllFormedModule, account_of
from soter.geometry.workspace import Workspace
from soter.sdk import Backend, BackendConfig, Capabilities
from soter.specs import promises, promises_of
from soter.stack.declaration import Declared
from soter.stack.right_of_way import COLLISION

_REFUSED: Final = Certainty.ASSUMED, "not tested: another module of the mission is rejected, so that nothing can be run"
Progress = Callable[[str], None]


BUDGET: Final = 200
"""Trials of each module that is tested instead of proved, unless a user says otherwise."""

_PATIENCE_S: Final = 60.0


@dataclass(frozen=True)
class MissionReport:
    """What is known about the modules of a mission.

    Attributes:
        findings: one for each module and condition, in order of the modules' priority.
        counterexamples: by module, what was found.
        benches: by module, the bench that its counterexamples were found on.
        own: the modules of the user's own.
    """

    workspace: Workspace
    findings: Sequence[Finding]
    counterexamples: Mapping[str, Sequence[Falsified]] = field(default_factory=dict)
    benches: Mapping[str, ModuleBench] = field(default_factory=dict)
    own: Collection[str] = ()

    @property
    def rejected(self) -> bool:
        """Whether any condition fails."""
        return any(each.verdict is Certainty.REJECTED for each in self.findings)

    @property
    def complete(self) -> bool:
        """Whether no proof has a gap, and no module of the user's own rests on its author's word."""
        return not any(each.is_gap(self.own) for each in self.findings)


def check_mission(
    mission: MissionFile, budget: int = BUDGET, seed: int = 0, on_progress: Progress | None = None
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
    for name in admission.untried(mission.rta.order):
        found = by_module[name]
        if any(each.verdict is Certainty.REJECTED for each in found):
            continue
        if admission.refused:
            found += [Finding(name, condition, *_REFUSED) for condition in ("P2a", "P2b")]
            continue
        tried = try_module(mission, workspace, _patience_s(declared, capabilities), name, budget, seed, tell)
        found += tried.findings
        if tried.bench is not None and tried.broken:
            counterexamples[name], benches[name] = tried.broken, tried.bench
    findings = [each for found in by_module.values() for each in sorted(found, key=lambda one: one.condition)]
    return MissionReport(workspace, findings, counterexamples, benches, tuple(mission.rta.module))


def refused(mission: MissionFile, workspace: Workspace) -> tuple[str, ...]:
    """Return, in words, what `check_mission` refuses of a mission before it tries any module; the same raises.

    P2 of the user's own modules, which only trials tell, is not judged.
    """
    admission = admit(mission, workspace, promises_of(mission, workspace))
    own = tuple(mission.rta.module)
    return tuple(
        _in_words(each)
        for each in (*admission.findings, *admission.proofs)
        if each.verdict is Certainty.REJECTED or each.is_gap(own)
    )


def admitted(
    mission: MissionFile,
    workspace: Workspace,
    backend: type[Backend],
    config: BackendConfig,
    *,
    ill_formed: bool,
    unproved: bool,
    on_progress: Progress | None = None,
) -> tuple[str, ...]:
    """Refuse a mission that may not be run; return the conditions that are not proved if it may.

    The backend is not opened. Modules of the user's own, of which nothing is proved, are tried as by `soter check`.
    `ill_formed` admits modules that are not well-formed, for studies, and `unproved` those with conditions that are not
    proved, and without any trial; `on_progress` is called with what is being tried, in words.

    Raises:
        IllFormedModule: a module is not well-formed on robots with these promises.
        ConfigError: a condition is not proved, or a trial has broken it.
    """
    try:
        promised = promises(backend, config, mission, workspace)
        declared = declare_all(mission, workspace, promised)
        check_all(mission, declared)
    except IllFormedModule as failure:
        if ill_formed:
            return ()
        raise refused_at(failure, mission, workspace, backend, config) from failure
    admission = admit_declared(mission, declared, promised)
    own = [name for name in mission.rta.order if name in mission.rta.module]
    missing, tell = admission.unproved, on_progress or (lambda _: None)
    # A user's safe controller may break the rule of the shipped module that is tried, too.
    for name in admission.untried(mission.rta.order if own else ()):
        if unproved and name in own:
            missing += [Finding(name, condition, Certainty.ASSUMED, "it was not tried") for condition in ("P2a", "P2b")]
        elif not missing and not unproved:
            tried = try_module(mission, workspace, _patience_s(declared, promised), name, BUDGET, 0, tell)
            missing += [each for each in tried.findings if each.verdict is Certainty.REJECTED or each.is_gap(own)]
    if missing and not unproved:
        first, more = missing[0], len(missing) - 1
        table = "rta.module" if first.module in own else "rta"
        raise mission.refusal(
            f"{table}.{first.module}",
            f"{_in_words(first)}{f' (and {more} more: `soter check` lists them)' if more else ''}; "
            "--accept-unproved, or accept_unproved=True in Python, runs it all the same",
        )
    return tuple(_in_words(each) for each in missing)


def _in_words(found: Finding) -> str:
    return f"{found.condition} of module '{found.module}' is {found.verdict.value}: {found.text}"


@dataclass(frozen=True)
class Tried:
    """What trials of a module have found: about P2, and about P3 and the model if they were broken.

    Attributes:
        broken: the counterexamples.
        bench: where it was tried; None if it was not.
    """

    findings: Sequence[Finding]
    broken: Sequence[Falsified] = ()
    bench: ModuleBench | None = None


def try_module(
    mission: MissionFile, workspace: Workspace, patience_s: Mapping[int, float], name: str, budget: int, seed: int,
    tell: Progress,
) -> Tried:  # fmt: skip
    """Try a module of a mission, of which P2 is not proved, on simulated robots; `patience_s` is by robot."""
    # Only the user's module knows whether its rule is about several robots.
    robots = workspace.robots[:TRIED_ROBOTS]

    def untried(verdict: Certainty, why: str) -> Tried:
        return Tried([Finding(name, condition, verdict, why) for condition in ("P2a", "P2b")])

    if name == COLLISION and len(robots) < 2:
        return untried(Certainty.PROVED, "there is no second robot")
    # A robot may have to wait until the others are home, and for users' safe controllers, as the reserve pays for.
    patient_s = _PATIENCE_S + sum(patience_s[each.id] for each in robots)
    try:
        bench = ModuleBench(mission, workspace, name, len(robots), patient_s)
    except IllFormedModule as failure:
        return untried(
            Certainty.ASSUMED, f"not tested: simulated robots cannot do what the mission's promise: {failure}"
        )
    except ConfigError as failure:
        # The mission's own robots have it declared already.
        why = account_of(failure.__cause__ or failure)
        count = f"{len(robots)} of {len(workspace.robots)} robots"
        return untried(Certainty.ASSUMED, f"not tested: with {count} it cannot be made: {why}")
    tried, broken = falsify(bench, budget, seed, _counted(tell, name, budget))
    how = "one robot" if bench.robots == 1 else f"{bench.robots} robots jointly"
    return Tried([replace(each, text=f"{how}, not proved: {each.text}") for each in tried], broken, bench)


def _patience_s(declared: Mapping[int, Declared], promised: Mapping[int, Capabilities]) -> dict[int, float]:
    """Return how long each robot's longest way home takes, and users' modules may hold it up for."""
    return {
        robot_id: made.dock.longest_m / promised[robot_id].v_max_m_s
        + sum(each.lets_go_s for each in made.modules if math.isfinite(each.lets_go_s))
        for robot_id, made in declared.items()
    }


def check_module(
    bench: ModuleBench, budget: int = BUDGET, seed: int = 0, on_progress: Progress | None = None
) -> MissionReport:
    """Check one module of the user's own: P1 and P3 of its declaration, then trials for P2 and P3."""
    name, tell = bench.name, on_progress or (lambda _: None)
    tell(f"{name}: P1 and P3")
    findings = conditions(bench.module, bench.timing, bench.base_tick_s)
    broken: list[Falsified] = []
    if not any(each.verdict is Certainty.REJECTED for each in findings):
        tried, broken = falsify(bench, budget, seed, _counted(tell, name, budget))
        found = {each.condition for each in tried}
        findings = [*(each for each in findings if each.condition not in found), *tried]
    ordered = sorted(findings, key=lambda each: each.condition)
    return MissionReport(bench.workspace, ordered, {name: broken} if broken else {}, {name: bench}, (name,))


def _counted(tell: Progress, name: str, budget: int) -> Callable[[int], None]:
    tell(f"{name}: trial 1 of at most {budget}")
    return lambda done: tell(f"{name}: trial {min(done + 1, budget)} of at most {budget}")
