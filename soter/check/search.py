"""Search for the worst: sampling, then the cross-entropy method, over points of the unit cube.

Rubinstein and Kroese, "The Cross-Entropy Method", Springer 2004. Scores are evaluated one after another and counted,
never timed, so that the same seed finds the same point everywhere. The method is small; what an optimiser of a library
would add are derivatives, which scores of simulated trials do not have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

Vector = tuple[float, ...]

BATCH: Final = 20
"""Points drawn from one distribution before it is fitted anew."""

_ELITE: Final = 5
_SAMPLED: Final = 0.4
_LEAST_SPREAD: Final = 0.01
_SMOOTHING: Final = 0.7


@dataclass(frozen=True, slots=True)
class Found:
    """The worst point of a search.

    Attributes:
        vector: the point; empty if there was no point with a finite score.
        score: its score; negative is a counterexample.
        evaluations: how many points were tried.
    """

    vector: Vector
    score: float
    evaluations: int


def search(
    score: Callable[[Vector], float],
    dimensions: int,
    budget: int,
    seed: int,
    start: Sequence[tuple[Vector, float]] = (),
) -> Found:
    """Look for the point with the least score; stop at the first that is negative.

    Args:
        score: of a point of the unit cube; infinite where the point says nothing.
        dimensions: of the cube, at least 1.
        budget: evaluations, at most.
        seed: everything random is drawn from it.
        start: points that are known already; they cost nothing.
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

    going = not (known and known[0][1] < 0.0) and evaluate(_stratified(random, dimensions, _sample_size(budget, known)))
    mean, spread = np.full(dimensions, 0.5), np.full(dimensions, 0.3)
    while going:
        known.sort(key=lambda each: each[1])
        elite = np.array([vector for vector, value in known[:_ELITE] if math.isfinite(value)])
        if len(elite) >= 2:
            mean = _SMOOTHING * elite.mean(axis=0) + (1.0 - _SMOOTHING) * mean
            spread = _SMOOTHING * elite.std(axis=0) + (1.0 - _SMOOTHING) * spread
        drawn = random.normal(mean, np.maximum(spread, _LEAST_SPREAD), size=(BATCH, dimensions))
        going = evaluate(_folded(drawn))
    known.sort(key=lambda each: each[1])
    if not known or not math.isfinite(known[0][1]):
        return Found((), math.inf, tried)
    return Found(known[0][0], known[0][1], tried)


def _sample_size(budget: int, known: Sequence[tuple[Vector, float]]) -> int:
    return 0 if known else max(1, math.ceil(_SAMPLED * budget))


def _stratified(random: np.random.Generator, dimensions: int, count: int) -> np.ndarray:
    """Return a Latin hypercube: every coordinate has one point in each of `count` equal slices."""
    slices = np.argsort(random.random((count, dimensions)), axis=0)
    return (slices + random.random((count, dimensions))) / max(count, 1)


def _folded(points: np.ndarray) -> np.ndarray:
    """Fold the line back into the unit interval, as a mirror does: angles and places near an edge stay near it."""
    return 1.0 - np.abs(points % 2.0 - 1.0)
