"""The runs in which adversaries take the AC's place, and what is asked of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Final

from soter.cli.overrides import merge
from soter.config import Mission, load_mission
from soter.faults import read_faults
from soter.faults.robot import widened
from soter.registry import load_backend
from soter.rta import SpeedBound
from soter.runner import RunResult
from soter.sdk import RULES
from soter.stack.adversaries import BUILT_IN, PREFIX
from soter.stack.declaration import timing_of
from tools.acceptance.cases import CHARGE_FROM_SEED, SURVEILLANCE, Case
from tools.acceptance.judge import Criterion, Outcome, Verdict
from tools.acceptance.store import ROOT

HOUR_S: Final = 3600.0
SEEDS: Final = (1, 2, 3)
ENGINES: Final = ("kinematic", "pybullet")
ATTACKERS: Final = ("chase", "fastest-to-boundary", "pincer", "search")
"""Those that come nearest to the edges."""

DISTANCES: Final = ("collision", "obstacle", "geofence")
"""The rules whose margins are distances."""

TIGHT: Final = 0.6
"""The least margin seen is at most this part of R(H): the modules are not merely timid."""

USED_UP: Final = 0.1
"""The same where latency, age and jitter are used up too."""

LINKS: Final[Mapping[str, tuple[str, ...]]] = {
    "late": ("fault=[{kind='delay', commands_s=0.05}]",),
    "old": ("fault=[{kind='delay', samples_s=0.05}]",),
    "jittery": ("fault=[{kind='delay', commands_s=0.02, jitter_s=0.07}]",),
    "lossy": ("fault=[{kind='loss', commands=0.3}]",),
}
"""Links at their declared bounds, which leave little of what the default modules can wait for.

Delays are whole ticks where they can be: what is declared beyond these is never used up, since robots act at ticks.
"""

STRETCHED: Final = (
    "workspace=../tools/acceptance/alone.xml",
    "rta.modules=['obstacle', 'geofence', 'battery']",
    "rta.obstacle.phi_safer_m=0.3",
    "rta.geofence.phi_safer_inset_m=0.5",
    "fault=[{kind='delay', commands_s=1.1}]",
)
"""The worst latency that the obstacle module, given room, can admit, and modules that look at every tick.

Without the collision module: it admits no such latency, whatever room it is given. So the robot is alone.
"""

APART: Final = (
    "workspace=../tools/acceptance/wide.xml",
    "rta.modules=['collision', 'geofence', 'battery']",
    "rta.collision.phi_safe_m=1.2",
    "rta.collision.phi_safer_m=1.9",
    "rta.collision.delta_s=0.05",
    "rta.geofence.phi_safer_inset_m=0.5",
    "fault=[{kind='delay', commands_s=1.1}]",
)
"""The same latency for two robots that keep so far apart that the collision module can admit it, in an empty hall."""

_WORST_LATENCY_S: Final = 1.15


def adversary_cases() -> list[Case]:
    """Return every run with an adversary."""
    cases = [
        _case("adversary", name, engine, seed) for engine in ENGINES for name in BUILT_IN for seed in SEEDS
    ]  # fmt: skip
    for link, settings in LINKS.items():
        cases += [_case(link, name, ENGINES[0], seed, *settings) for name in ATTACKERS for seed in SEEDS]
    for name in ("fastest-to-boundary", "search"):
        told = f"adversaries.{name}.facts.latency_s={_WORST_LATENCY_S:g}"
        cases += [_case("stretched", name, ENGINES[0], seed, *STRETCHED, told) for seed in SEEDS]
    for name in ("chase", "pincer", "search"):
        told = f"adversaries.{name}.facts.latency_s={_WORST_LATENCY_S:g}"
        cases += [_case("apart", name, ENGINES[0], seed, *APART, told) for seed in SEEDS]
    return cases


def _case(group: str, name: str, engine: str, seed: int, *settings: str) -> Case:
    options = ["--backend", engine, "--ac", f"{PREFIX}{name}", *CHARGE_FROM_SEED]
    for setting in settings:
        options += ["--set", setting]
    return Case(
        f"{group}-{name}-{engine}-{seed}", group, SURVEILLANCE, tuple(options), HOUR_S, engine, name, seed
    )  # fmt: skip


@cache
def _mission(case: Case) -> Mission:
    settings = [value for option, value in zip(case.options, case.options[1:], strict=False) if option == "--set"]
    return load_mission(ROOT / case.mission, {**merge({}, settings), "seed": case.seed})


def least_m(outcome: Outcome, rule: str) -> float | None:
    """Return the least margin of a rule that truth saw, to the edge of the module's phi_safe; None without a truth."""
    return None if outcome.result is None else (outcome.result.min_margin or {}).get(rule)


@cache
def reach_m(case: Case) -> Mapping[str, float]:
    """Return R(H) of every enabled module whose margin is a distance, on the robots that promise the most."""
    mission = _mission(case)
    # Robots of both engines promise the same; this one needs no library.
    declared = load_backend(ENGINES[0]).robot_class.declared
    faults = [table.made_for(1, 0, mission.base_tick_s) for table in read_faults(mission, [1, 2]) if table.hits(1)]
    promised = widened(declared, faults)
    timing, speed = timing_of(promised, mission.base_tick_s), SpeedBound(promised.v_max_m_s, promised.brake_m_s2)
    found: dict[str, float] = {}
    for rule in DISTANCES:
        if rule in mission.rta.modules:
            delta_s = getattr(mission.rta, rule).delta_s
            horizon_s = timing.ahead_s(delta_s) + timing.latency_s + timing.sample_age_s + timing.jitter_s
            found[rule] = speed.bound(horizon_s) * (2.0 if rule == "collision" else 1.0)
    return found


def kept(result: RunResult) -> bool:
    """Return whether truth saw no violation of a rule that a module of the run keeps."""
    if result.violations is None or result.min_margin is None:
        return False
    return not any(result.violations[rule] for rule in RULES if rule in result.modules)


def least_part(outcomes: Iterable[Outcome], rule: str) -> tuple[float, Outcome] | None:
    """Return the least margin of a rule as a part of R(H), and the run; None where it was not run."""
    parts = [
        (margin / bounds[rule], outcome)
        for outcome in outcomes
        if rule in (bounds := reach_m(outcome.case)) and (margin := least_m(outcome, rule)) is not None
    ]
    return min(parts, key=lambda part: (part[0], part[1].case.name), default=None)


def adversary_criteria(outcomes: Sequence[Outcome]) -> list[Criterion]:
    """Judge all runs."""
    found = []
    for engine in ENGINES:
        runs = [o for o in outcomes if o.case.engine == engine]
        found.append(_kept(runs, f"no violation by truth of a rule that is kept, whoever the AC is ({engine})"))
    plain = [o for o in outcomes if o.case.group == "adversary"]
    for engine in ENGINES:
        runs = [o for o in plain if o.case.engine == engine]
        found += [_tight(runs, rule, TIGHT, f"with the robots as they are ({engine})") for rule in DISTANCES]
    rest = [o for o in outcomes if o.case.group != "adversary"]
    found += [_tight(rest, rule, USED_UP, "with latency, age and jitter used up") for rule in DISTANCES]
    return found


def _kept(runs: Sequence[Outcome], text: str) -> Criterion:
    done = [(o.case, o.result) for o in runs if o.result is not None]
    broken = [case.name for case, result in done if not kept(result)]
    where = f" ({', '.join(broken)})" if broken else ""
    verdict = Verdict.NOT_REACHED if broken else Verdict.REACHED if len(done) == len(runs) else Verdict.INCOMPLETE
    return Criterion(text, f"broken in {len(broken)} of {len(done)} runs{where}", verdict)


def _tight(runs: Sequence[Outcome], rule: str, most: float, when: str) -> Criterion:
    text = f"{rule}: the least margin is at least 0, and at most {most:g} R(H), {when}"
    least = least_part(runs, rule)
    if least is None:
        return Criterion(text, "not run", Verdict.INCOMPLETE)
    part, outcome = least
    metres = part * reach_m(outcome.case)[rule]
    if 0.0 <= part <= most:
        complete = all(o.result is not None for o in runs)
        verdict = Verdict.REACHED if complete else Verdict.INCOMPLETE
    else:
        verdict = Verdict.NOT_REACHED
    return Criterion(text, f"{metres:.3f} m = {part:.2f} R(H) ({outcome.case.name})", verdict)
