"""The search finds what a sample misses, counts what it tries, and repeats."""

from __future__ import annotations

import math

import pytest

from soter.check.falsify import Vector, search


def valley(vector: Vector) -> float:
    """Negative within 0.05 of one place: a sample of a few hundred misses it in five dimensions."""
    return math.dist(vector, (0.21, 0.84, 0.4, 0.66, 0.93)) - 0.05


def test_it_finds_a_place_that_a_sample_misses() -> None:
    found = search(valley, 5, 1500, seed=1)
    assert found.score < 0.0
    assert valley(found.vector) == found.score
    assert found.evaluations < 1500, "it stops at the first counterexample"
    sampled = search(valley, 5, 1, seed=1)
    assert sampled.score > 0.0


def test_the_same_seed_tries_the_same_points() -> None:
    def tried_with(seed: int) -> list[Vector]:
        points: list[Vector] = []

        def level(vector: Vector) -> float:
            points.append(vector)
            return 1.0

        search(level, 3, 60, seed)
        return points

    tried, again = tried_with(7), tried_with(7)
    assert tried == again
    assert len(tried) == 60, "the budget is counted"
    assert all(0.0 <= value <= 1.0 for vector in tried for value in vector)


def test_points_that_say_nothing_are_passed_over() -> None:
    found = search(lambda vector: math.inf, 2, 30, seed=1)
    assert found == type(found)((), math.inf, 30)
    assert search(lambda vector: math.nan, 2, 30, seed=1).vector == ()


def test_known_points_cost_nothing_and_are_built_upon() -> None:
    near = ((0.2, 0.8, 0.4, 0.7, 0.9), 0.1)
    with_start = search(valley, 5, 400, seed=2, start=[near, ((0.5,) * 5, 0.9)])
    assert with_start.score < 0.0
    assert search(valley, 5, 400, seed=2, start=[((0.21, 0.84, 0.4, 0.66, 0.93), -0.05)]).evaluations == 0


@pytest.mark.parametrize(("dimensions", "budget"), [(0, 1), (1, 0)])
def test_nothing_to_search_is_refused(dimensions: int, budget: int) -> None:
    with pytest.raises(ValueError, match="allowed: at least 1"):
        search(valley, dimensions, budget, seed=1)
