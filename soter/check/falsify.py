"""Falsification: sampled and searched starts, an adversarial AC up to the switch, then the safe controller alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from soter.check.conditions import Finding, Verdict
from soter.check.search import Vector, search
from soter.check.trial import Breach, Obligation, Subject, Trial


@dataclass(frozen=True, slots=True)
class Falsified:
    """A point that breaks an obligation.

    Attributes:
        breach: what it broke, and where.
        vector: the point, to be run again.
        trial: what happened.
        evaluations: trials it took to find it.
    """

    breach: Breach
    vector: Vector
    trial: Trial
    evaluations: int


def falsify(
    subject: Subject,
    budget: int = 200,
    seed: int = 0,
    on_trial: Callable[[int], None] | None = None,
) -> tuple[list[Finding], list[Falsified]]:
    """Try to break P2a, P2b and P3 of one module.

    Half of the budget looks for the least margin, half for the longest time to come back; every trial counts for all
    obligations.

    Args:
        subject: what is to be broken.
        budget: trials, at most.
        seed: everything random is drawn from it.
        on_trial: told how many trials are done.

    Returns:
        A finding for P2a and P2b, and for P3 and the model if they were broken; and the counterexamples.
    """
    trials: list[tuple[Vector, Trial]] = []

    def scored(obligation: Obligation) -> Callable[[Vector], float]:
        def score(vector: Vector) -> float:
            trial = subject.run(vector)
            trials.append((vector, trial))
            if on_trial is not None:
                on_trial(len(trials))
            if obligation is Obligation.P2A:
                # Whoever leaves phi_safe is found by the same search, whether the AC or the SC drove it there.
                return min(trial.score(Obligation.P2A), trial.score(Obligation.P3))
            return trial.score(obligation)

        return score

    half = max(1, budget // 2)
    search(scored(Obligation.P2A), subject.dimensions, half, seed)
    known = [(vector, trial.score(Obligation.P2B)) for vector, trial in trials]
    if not any(value < 0.0 for _, value in known):
        search(scored(Obligation.P2B), subject.dimensions, max(1, budget - half), seed + 1, known)
    return _findings(subject, trials), _broken(trials)


def _broken(trials: Sequence[tuple[Vector, Trial]]) -> list[Falsified]:
    """Return the first counterexample of every obligation that was broken."""
    found: dict[Obligation, Falsified] = {}
    for count, (vector, trial) in enumerate(trials, start=1):
        for breach in trial.breaches if trial.valid else ():
            found.setdefault(breach.obligation, Falsified(breach, vector, trial, count))
    return list(found.values())


def _findings(subject: Subject, trials: Sequence[tuple[Vector, Trial]]) -> list[Finding]:
    name = subject.module.name
    valid = [trial for _, trial in trials if trial.valid]
    figures: dict[str, float | int | str | None] = {"trials": len(trials), "valid": len(valid)}
    findings = [
        Finding(name, each.breach.obligation.value, Verdict.REJECTED, each.breach.text, {
            **figures, "found_after": each.evaluations, "time_s": each.breach.time_s,
            "x_m": each.breach.x_m, "y_m": each.breach.y_m,
        })
        for each in _broken(trials)
    ]  # fmt: skip
    broken = {each.condition for each in findings}
    surprised = sum(trial.surprises for trial in valid)
    if surprised:
        unfit = next((trial.unfit for trial in valid if trial.unfit), "the margin fell by more than R(T)")
        text = f"the model does not fit the robot at {surprised} looks: {unfit}"
        findings.append(Finding(name, "model", Verdict.REJECTED, text, {**figures, "surprises": surprised}))
    if "P2a" not in broken:
        findings.append(_p2a(subject, valid, figures))
    if "P2b" not in broken:
        findings.append(_p2b(subject, valid, figures))
    return sorted(findings, key=lambda each: each.condition)


def _p2a(subject: Subject, valid: Sequence[Trial], figures: dict[str, float | int | str | None]) -> Finding:
    name, phi_safe = subject.module.name, subject.module.phi_safe
    if phi_safe is None:
        text = "the rule is given by predicates only: there is no region that could be left"
        return Finding(name, "P2a", Verdict.ASSUMED, text, figures)
    if not valid:
        return Finding(name, "P2a", Verdict.ASSUMED, "no trial began inside phi_safe", figures)
    # One that the AC, or a late switch, has led out says nothing about the safe controller.
    kept = [trial for trial in valid if not trial.breaches]
    if not kept:
        return Finding(name, "P2a", Verdict.ASSUMED, "no trial got as far as its safe controller", figures)
    least = min(trial.least_margin for trial in kept)
    text = f"{len(kept)} trials, no safe controller left phi_safe; least margin {least:.3f} {phi_safe.unit}"
    return Finding(name, "P2a", Verdict.TESTED, text, {**figures, "least_margin": least})


def _p2b(subject: Subject, valid: Sequence[Trial], figures: dict[str, float | int | str | None]) -> Finding:
    name = subject.module.name
    returns = [trial.return_s for trial in valid if not math.isnan(trial.return_s)]
    if not returns:
        return Finding(name, "P2b", Verdict.ASSUMED, "the safe controller was never needed in any trial", figures)
    longest = max(returns)
    text = f"{len(returns)} returns to phi_safer, the longest after {longest:.1f} s"
    return Finding(name, "P2b", Verdict.TESTED, text, {**figures, "returns": len(returns), "longest_s": longest})
