"""The criteria of the evaluation: what was asked for, what was found, and whether that is enough."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from scipy.stats import chi2

from soter.runner import RunResult
from soter.sdk import RULES
from tools.acceptance.cases import MODULES, PLANNERS, Case

MOST_STALL_S: Final = 60.0
MOST_NO_PROGRESS_S: Final = 180.0
LEAST_AC_SHARE: Final = 0.802
CONFIDENCE: Final = 0.95


class Verdict(Enum):
    """How a criterion stands."""

    REACHED = "PASS"
    NOT_REACHED = "NOT REACHED"
    INCOMPLETE = "INCOMPLETE"


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of the evaluation.

    Attributes:
        case: what was run.
        result: what came out; None while it has not been run.
    """

    case: Case
    result: RunResult | None


@dataclass(frozen=True, slots=True)
class Criterion:
    """One criterion, judged.

    Attributes:
        text: what is asked for.
        found: what was found.
        verdict: whether that is enough; a failure counts even while runs are missing.
    """

    text: str
    found: str
    verdict: Verdict


def upper_rate(violations: int, hours: float) -> float:
    """Return the 95 % upper bound on the rate of a Poisson process: for no violation in T hours, about 3/T."""
    return float(chi2.ppf(CONFIDENCE, 2 * (violations + 1))) / 2.0 / hours


def criteria(outcomes: Sequence[Outcome]) -> list[Criterion]:
    """Judge all runs."""
    groups = {name: [o for o in outcomes if o.case.group == name] for name in
              ("protected", "unprotected", "without", "repeated", "planner")}  # fmt: skip
    protected = groups["protected"]
    found = [
        _worst(protected, "no violation of any kind, by truth, with all modules", _violations, 0.0, "violations"),
        _worst(protected, f"no stall longer than {MOST_STALL_S:g} s", lambda r: r.longest_stall_s, MOST_STALL_S, "s"),
        _worst(
            protected, f"never longer than {MOST_NO_PROGRESS_S:g} s without progress", lambda r: r.no_progress_s,
            MOST_NO_PROGRESS_S, "s",
        ),
    ]  # fmt: skip
    found += [_share([o for o in protected if o.case.subject == "grid" and o.case.engine == engine], engine)
              for engine in ("kinematic", "pybullet")]  # fmt: skip
    found.append(
        _each(groups["unprotected"], "without any module, every run has all four kinds of violation", _all_kinds)
    )
    for left_out in MODULES:
        runs = [o for o in groups["without"] if o.case.subject == left_out]
        found.append(_each(runs, f"without the {left_out} module, every run has {left_out} violations", _own_kind))
    results = {o.case.name: o.result for o in outcomes}
    for engine in ("kinematic", "pybullet"):
        runs = [o for o in groups["repeated"] if o.case.engine == engine]
        text = f"two runs of one seed are the same, one of them on a loaded machine ({engine})"
        found.append(_same(runs, results, text))
    for planner, does in PLANNERS.items():
        runs = [o for o in groups["planner"] if o.case.subject == planner]
        found.append(
            _each(runs, f"a planner that {does} for robot 1: no violation, robot 2 reaches targets", _harmless)
        )
    return found


def _violations(result: RunResult) -> float:
    # A run without truth proves nothing.
    return float("inf") if result.violations is None else float(sum(result.violations.values()))


def _done(outcomes: Iterable[Outcome]) -> list[tuple[Case, RunResult]]:
    return [(o.case, o.result) for o in outcomes if o.result is not None]


def _verdict(reached: bool, outcomes: Sequence[Outcome], done: int) -> Verdict:
    if not reached:
        return Verdict.NOT_REACHED
    return Verdict.REACHED if outcomes and done == len(outcomes) else Verdict.INCOMPLETE


def _worst(
    outcomes: Sequence[Outcome], text: str, figure: Callable[[RunResult], float], bound: float, unit: str
) -> Criterion:
    done = _done(outcomes)
    if not done:
        return Criterion(text, "not run", Verdict.INCOMPLETE)
    worst, name = max((figure(result), case.name) for case, result in done)
    where = f" ({name})" if worst > 0.0 else ""
    reached = all(figure(result) <= bound for _, result in done)
    return Criterion(text, f"at most {worst:g} {unit}{where}, {len(done)} runs", _verdict(reached, outcomes, len(done)))


def _share(outcomes: Sequence[Outcome], engine: str) -> Criterion:
    text = f"grid: the AC in control at least {LEAST_AC_SHARE:.1%} of the time, mean of the seeds ({engine})"
    shares = [result.ac_share for _, result in _done(outcomes)]
    if not shares:
        return Criterion(text, "not run", Verdict.INCOMPLETE)
    mean = statistics.fmean(shares)
    found = f"{mean:.1%} ({min(shares):.1%} to {max(shares):.1%})"
    return Criterion(text, found, _verdict(mean >= LEAST_AC_SHARE, outcomes, len(shares)))


def _each(outcomes: Sequence[Outcome], text: str, holds: Callable[[str, RunResult], bool]) -> Criterion:
    done = _done(outcomes)
    good = sum(holds(case.subject, result) for case, result in done)
    found = f"{good} of {len(done)} runs" if done else "not run"
    return Criterion(text, found, _verdict(good == len(done), outcomes, len(done)))


def _all_kinds(_subject: str, result: RunResult) -> bool:
    return result.violations is not None and all(result.violations[rule] > 0 for rule in RULES)


def _own_kind(subject: str, result: RunResult) -> bool:
    return result.violations is not None and result.violations[subject] > 0


def _harmless(_subject: str, result: RunResult) -> bool:
    return _violations(result) == 0.0 and result.targets_reached > 0


def _same(outcomes: Sequence[Outcome], results: Mapping[str, RunResult | None], text: str) -> Criterion:
    pairs = [
        (outcome.result, first)
        for outcome in outcomes
        if outcome.result is not None and (first := results.get(outcome.case.repeats)) is not None
    ]
    same = [
        again.trace_sha256 == first.trace_sha256 and again.deterministic and first.deterministic
        for again, first in pairs
    ]
    found = f"{sum(same)} of {len(same)} pairs" if same else "not run"
    return Criterion(text, found, _verdict(all(same), outcomes, len(same)))
