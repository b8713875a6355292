"""The search finds what a sample misses, counts what it tries, and repeats."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import pytest

from soter.check.falsify import search
from soter.check.trial import Vector


def tried(
    score: Callable[[Vector], float],
    dimensions: int,
    budget: int,
    seed: int,
    start: Sequence[tuple[Vector, float]] = (),
) -> list[tuple[Vector, float]]:
    """Search, and return the points in the order in which they were tried, with their scores."""
    points: list[tuple[Vector, float]] = []

    def noted(vector: Vector) -> float:
        points.append((vector, score(vector)))
        return points[-1][1]

    search(noted, dimensions, budget, seed, start)
    return points


def valley(vector: Vector) -> float:
    """Negative within 0.05 of one place: a sample of a few hundred misses it in five dimensions."""
    return math.dist(vector, (0.21, 0.84, 0.4, 0.66, 0.93)) - 0.05


def test_it_finds_a_place_that_a_sample_misses() -> None:
    found = tried(valley, 5, 1500, seed=1)
    assert found[-1][1] < 0.0
    assert len(found) < 1500, "it stops at the first counterexample"
    assert all(score >= 0.0 for _, score in found[:-1])
    ((_, sampled),) = tried(valley, 5, 1, seed=1)
    assert sampled > 0.0


def test_the_same_seed_tries_the_same_points() -> None:
    once, again = (tried(lambda vector: 1.0, 3, 60, seed=7) for _ in range(2))
    assert once == again
    assert len(once) == 60, "the budget is counted"
    assert all(0.0 <= value <= 1.0 for vector, _ in once for value in vector)


def test_points_that_say_nothing_are_passed_over() -> None:
    assert len(tried(lambda vector: math.inf, 2, 30, seed=1)) == 30
    assert len(tried(lambda vector: math.nan, 2, 30, seed=1)) == 30


def test_known_points_cost_nothing_and_are_built_upon() -> None:
    near = ((0.2, 0.8, 0.4, 0.7, 0.9), 0.1)
    with_start = tried(valley, 5, 400, seed=2, start=[near, ((0.5,) * 5, 0.9)])
    assert with_start[-1][1] < 0.0
    assert tried(valley, 5, 400, seed=2, start=[((0.21, 0.84, 0.4, 0.66, 0.93), -0.05)]) == []


@pytest.mark.parametrize(("dimensions", "budget"), [(0, 1), (1, 0)])
def test_nothing_to_search_is_refused(dimensions: int, budget: int) -> None:
    with pytest.raises(ValueError, match="allowed: at least 1"):
        search(valley, dimensions, budget, seed=1)
