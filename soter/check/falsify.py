"""Falsification: sampled and searched starts, an adversarial AC up to the switch, then the safe controller alone.

The worst is searched for by sampling, then by the cross-entropy method, over points of the unit cube: Rubinstein and
Kroese, "The Cross-Entropy Method", Springer 2004. Evaluations are sequential and limited by number, never by time, so
that the same seed finds the same point on every host. The method is small; a library's optimisers would mainly add
derivatives, which scores of simulated trials do not have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from soter.check.bench import ModuleBench
from soter.check.conditions import Certainty, Finding
from soter.check.trial import Attempt, BrokenObligation, Obligation, Vector, Way

BATCH: Final = 20
"""Number of points drawn from one distribution before it is fitted anew."""

_ELITE: Final = 5
_SAMPLED: Final = 0.4
_LEAST_SPREAD: Final = 0.01
_SMOOTHING: Final = 0.7


def search(
    score: Callable[[Vector], float],
    dimensions: int,
    budget: int,
    seed: int,
    start: Sequence[tuple[Vector, float]] = (),
) -> None:
    """Look for the point with the least score; stop at the first that is negative, which is a counterexample.

    Args:
        score: called with every point of the unit cube that is tried; returns its score, infinite if the point says
            nothing.
        dimensions: dimensions of the cube, at least 1.
        budget: largest number of evaluations.
        seed: seed of all random numbers.
        start: points with known scores, which do not count as evaluations.
    """
    if dimensions < 1 or budget < 1:
        raise ValueError(f"dimensions is {dimensions} and budget {budget}, allowed: at least 1")
    random = np.random.default_rng(seed)
    known = sorted(start, key=lambda each: each[1])
    tried = 0

    def evaluate(points: np.ndarray) -> bool:
        """Score points until one is a counterexample; return whether to go on."""
        nonlocal tried
        for point in points:
            if tried >= budget:
                return False
            vector = tuple(float(value) for value in point)
            value = score(vector)
            tried += 1
            known.append((vector, math.inf if math.isnan(value) else value))
            if value < 0.0:
                return False
        return True

    sampled = 0 if known else max(1, math.ceil(_SAMPLED * budget))
    going = not (known and known[0][1] < 0.0) and evaluate(_stratified(random, dimensions, sampled))
    mean, spread = np.full(dimensions, 0.5), np.full(dimensions, 0.3)
    while going:
        known.sort(key=lambda each: each[1])
        elite = np.array([vector for vector, value in known[:_ELITE] if math.isfinite(value)])
        if len(elite) >= 2:
            mean = _SMOOTHING * elite.mean(axis=0) + (1.0 - _SMOOTHING) * mean
            spread = _SMOOTHING * elite.std(axis=0) + (1.0 - _SMOOTHING) * spread
        drawn = random.normal(mean, np.maximum(spread, _LEAST_SPREAD), size=(BATCH, dimensions))
        # Reflect into the unit interval, so that angles and places near an edge stay near it.
        going = evaluate(1.0 - np.abs(drawn % 2.0 - 1.0))


def _stratified(random: np.random.Generator, dimensions: int, count: int) -> np.ndarray:
    """Return a Latin hypercube sample: every coordinate has one point in each of `count` equal slices."""
    slices = np.argsort(random.random((count, dimensions)), axis=0)
    return (slices + random.random((count, dimensions))) / max(count, 1)


@dataclass(frozen=True, slots=True)
class Falsified:
    """A point whose trial broke an obligation."""

    breach: BrokenObligation
    vector: Vector
    trial: Attempt
    evaluations: int


def falsify(
    subject: ModuleBench,
    budget: int = 200,
    seed: int = 0,
    on_trial: Callable[[int], None] | None = None,
) -> tuple[list[Finding], list[Falsified]]:
    """Try to break P2a, P2b and P3 of one module.

    The first trial begins where the mission has its robots. Half of the others search for the least margin, half for
    the longest time to come back; every trial counts for all obligations.

    `budget` is the largest number of trials, and `on_trial` is called with the number of trials done.

    Returns:
        A finding for P2a and P2b, and for P3 and the model if they were broken; and the counterexamples.
    """
    trials: list[tuple[Vector, Attempt]] = []

    def scored(obligation: Obligation) -> Callable[[Vector], float]:
        def score(vector: Vector) -> float:
            trial = subject.run(vector)
            trials.append((vector, trial))
            if on_trial is not None:
                on_trial(len(trials))
            if obligation is Obligation.P2A:
                # One search finds robots that leave phi_safe, whether the AC or the SC drove them out.
                return min(trial.score(Obligation.P2A), trial.score(Obligation.P3))
            return trial.score(obligation)

        return score

    if (begin := subject.own_start) is not None and scored(Obligation.P2A)(begin) < 0.0:
        return _findings(subject, trials), _broken(trials)
    half = max(1, budget // 2)
    search(scored(Obligation.P2A), subject.dimensions, max(1, half - len(trials)), seed)
    known = [(vector, trial.score(Obligation.P2B)) for vector, trial in trials]
    if not any(value < 0.0 for _, value in known):
        search(scored(Obligation.P2B), subject.dimensions, max(1, budget - half), seed + 1, known)
    return _findings(subject, trials), _broken(trials)


def _broken(trials: Sequence[tuple[Vector, Attempt]]) -> list[Falsified]:
    """Return the first counterexample of every obligation that was broken."""
    found: dict[Obligation, Falsified] = {}
    for count, (vector, trial) in enumerate(trials, start=1):
        for breach in trial.breaches if trial.valid else ():
            found.setdefault(breach.obligation, Falsified(breach, vector, trial, count))
    return list(found.values())


def _findings(subject: ModuleBench, trials: Sequence[tuple[Vector, Attempt]]) -> list[Finding]:
    name = subject.module.name
    valid = [trial for _, trial in trials if trial.valid]
    figures: dict[str, float | int | str | None] = {"trials": len(trials), "valid": len(valid)}
    findings = [
        Finding(name, each.breach.obligation.value, Certainty.REJECTED, _in_words(each, valid), {
            **figures, "found_after": each.evaluations, "time_s": each.breach.time_s,
            "x_m": each.breach.x_m, "y_m": each.breach.y_m, **_failed(each, valid),
        })
        for each in _broken(trials)
    ]  # fmt: skip
    broken = {each.condition for each in findings}
    surprised = sum(trial.surprises for trial in valid)
    if surprised:
        unfit = next((trial.unfit for trial in valid if trial.unfit), "the margin fell by more than R(T)")
        text = f"the model does not fit the robot at {surprised} looks: {unfit}"
        findings.append(Finding(name, "model", Certainty.REJECTED, text, {**figures, "surprises": surprised}))
    if "P2a" not in broken:
        findings.append(_p2a(subject, valid, figures))
    if "P2b" not in broken:
        findings.append(_p2b(subject, valid, figures))
    return sorted(findings, key=lambda each: each.condition)


def _failed(found: Falsified, valid: Sequence[Attempt]) -> dict[str, int]:
    """Return in how many trials the module's safe controller drove, and failed; empty if that is not what was found."""
    if not (found.trial.failure and found.breach.obligation is Obligation.P2B):
        return {}
    return {"driven": sum(trial.driven for trial in valid), "failed": sum(bool(trial.failure) for trial in valid)}


def _in_words(found: Falsified, valid: Sequence[Attempt]) -> str:
    if not (counts := _failed(found, valid)):
        return found.breach.text
    return f"{found.breach.text}; it failed in {counts['failed']} of the {counts['driven']} trials in which it drove"


def _p2a(subject: ModuleBench, valid: Sequence[Attempt], figures: dict[str, float | int | str | None]) -> Finding:
    name, phi_safe = subject.module.name, subject.module.phi_safe
    if phi_safe is None:
        text = "the rule is given by predicates only: there is no region that could be left"
        return Finding(name, "P2a", Certainty.ASSUMED, text, figures)
    if not valid:
        return Finding(name, "P2a", Certainty.ASSUMED, "no trial began inside phi_safe", figures)
    if failed := sum(bool(trial.failure) for trial in valid):
        text = f"its safe controller failed in {failed} trial{'s' if failed > 1 else ''}: P2b has what it failed with"
        return Finding(name, "P2a", Certainty.ASSUMED, text, figures)
    # A trial whose AC, or late switch, led out of phi_safe says nothing about the safe controller.
    kept = [trial for trial in valid if not trial.breaches]
    if not kept:
        return Finding(name, "P2a", Certainty.ASSUMED, "no trial got as far as its safe controller", figures)
    least = min(trial.least_margin for trial in kept)
    count = f"{len(kept)} trial{'s' if len(kept) > 1 else ''}"
    text = f"{count}, no safe controller left phi_safe; least margin {least:.3f} {phi_safe.unit}"
    return Finding(name, "P2a", Certainty.TESTED, text, {**figures, "least_margin": least})


def _p2b(subject: ModuleBench, valid: Sequence[Attempt], figures: dict[str, float | int | str | None]) -> Finding:
    name = subject.module.name
    returns = [trial.return_s for trial in valid if not math.isnan(trial.return_s)]
    if not returns:
        return Finding(name, "P2b", Certainty.ASSUMED, "the safe controller was never needed in any trial", figures)
    longest, lets_go_s = max(returns), subject.module.lets_go_s
    home, charge = (sum(way in trial.ways for trial in valid) for way in (Way.HOME, Way.CHARGE))
    figures = {
        **figures,
        "returns": len(returns),
        "longest_s": longest,
        "driven_home": home,
        "driven_to_charge": charge,
    }
    text = f"{len(returns)} return{'s' if len(returns) > 1 else ''} to phi_safer, the longest after {longest:.1f} s"
    # A robot that is driven home in spite of its safe controller says nothing for that controller.
    alone = any(Way.ITSELF in trial.ways for trial in valid)
    if home:
        text = (
            f"{home} of {text}, came only once the robot had stood for lets_go_s = {lets_go_s:g} s and SOTER drove it "
            f"home (A16): its own controller did not bring it back{'' if alone else ', and did so in no other trial'}"
        )
        return Finding(name, "P2b", Certainty.PARTLY if alone else Certainty.REJECTED, text, figures)
    if charge:
        text += f"; in {charge} of them it had to charge, and was driven home after lets_go_s = {lets_go_s:g} s (P2c)"
        if not alone:
            text += ", and its own controller brought it back in no trial"
            return Finding(name, "P2b", Certainty.ASSUMED, text, figures)
    elif longest > lets_go_s:
        text += f"; the {lets_go_s:g} s of P2c count only while a robot stands, or has to charge"
    return Finding(name, "P2b", Certainty.TESTED, text, figures)
