"""The geometry that planners rely on, judged by shapely."""

from __future__ import annotations

import math

from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, box  # type: ignore[import-untyped]
from shapely.geometry import Point as ShapelyPoint
from shapely.ops import unary_union  # type: ignore[import-untyped]

from soter.stack.planners.space import FreeSpace
from tests.stack.planners.places import CASE, GROWN_M

SHAPES = [box(b.low_x_m - GROWN_M, b.low_y_m - GROWN_M, b.high_x_m + GROWN_M, b.high_y_m + GROWN_M) for b in CASE.boxes]
BLOCKED = unary_union(SHAPES)

inside = st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0))
anywhere = st.tuples(st.floats(-1.0, 6.0), st.floats(-1.0, 6.0))
discs = st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.floats(0.1, 0.9)), max_size=3)


@settings(max_examples=400, deadline=None, derandomize=True)
@given(a=inside, b=inside, around=discs)
def test_segment_is_open_as_shapely_says(
    a: tuple[float, float], b: tuple[float, float], around: list[tuple[float, float, float]]
) -> None:
    space = FreeSpace(CASE, GROWN_M)
    space.begin(around)
    line = LineString([a, b])
    gap = min([line.distance(BLOCKED), *(line.distance(ShapelyPoint(x, y)) - r for x, y, r in around)])
    overlap = line.intersection(BLOCKED).length
    assume(gap > 1e-6 or gap < -1e-6 or overlap > 1e-6)
    assert space.is_open(*a, *b) == (gap > 0.0)
    assert space.is_open(*b, *a) == (gap > 0.0)
    assert space.checks == 2


@settings(max_examples=200, deadline=None, derandomize=True)
@given(point=anywhere)
def test_nearest_free_point_is_the_nearest(point: tuple[float, float]) -> None:
    space = FreeSpace(CASE, GROWN_M)
    assume(not space.is_free(*point))
    found = space.nearest_free(*point)
    assert found is not None
    assert space.is_free(*found)
    exact = box(0.0, 0.0, 5.0, 5.0).difference(BLOCKED).distance(ShapelyPoint(point))
    assert math.isclose(math.dist(found, point), exact, abs_tol=1e-6)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(point=anywhere, around=discs)
def test_nearest_free_point_is_free_of_discs(
    point: tuple[float, float], around: list[tuple[float, float, float]]
) -> None:
    space = FreeSpace(CASE, GROWN_M)
    space.begin(around)
    assume(not space.is_free(*point))
    found = space.nearest_free(*point)
    assert found is not None
    assert space.is_free(*found)
    assert not space.in_disc(*found)
    round_ones = [ShapelyPoint(x, y).buffer(r, quad_segs=64) for x, y, r in around]
    free = box(0.0, 0.0, 5.0, 5.0).difference(unary_union([BLOCKED, *round_ones]))
    assert math.dist(found, point) > free.distance(ShapelyPoint(point)) - 1e-3
