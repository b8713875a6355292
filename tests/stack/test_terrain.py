"""Plane geometry over boxes against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace, crosses
from soter.stack.terrain import Point, Terrain
from tests.stack.ground import CASE, RADIUS_M, TERRAIN, between, boxes, clear_m, fence_m

anywhere = st.tuples(st.floats(-1.0, 6.0), st.floats(-1.0, 6.0))


def terrain_of(some: tuple[Box, ...]) -> Terrain:
    return Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)


@given(boxes(), anywhere)
def test_clearance_is_the_distance_to_the_nearest_box(some: tuple[Box, ...], at: Point) -> None:
    terrain = terrain_of(some)
    clearance = terrain.clearance_m(*at)
    if clear_m(terrain, *at) > -RADIUS_M:
        assert clearance == pytest.approx(clear_m(terrain, *at), abs=1e-12)
    else:
        assert clearance == pytest.approx(min(box.distance_m(*at) for box in some) - RADIUS_M, abs=1e-12)
    assert clearance == pytest.approx(terrain.workspace.clearance_m(*at, RADIUS_M), abs=1e-12), "one meaning everywhere"


@pytest.mark.parametrize("at", [(math.nan, 1.0), (1.0, math.inf), (-math.inf, 1.0)])
def test_a_place_that_is_not_finite_is_not_clear_of_all_boxes(at: Point) -> None:
    with pytest.raises(ValueError, match="allowed: finite"):
        TERRAIN.clearance_m(*at)


@given(boxes(), anywhere, anywhere)
def test_the_clearance_of_a_segment_is_the_least_along_it(some: tuple[Box, ...], a: Point, b: Point) -> None:
    terrain = terrain_of(some)
    exact = terrain.segment_clearance_m(*a, *b)
    sampled = min(clear_m(terrain, *point) for point in between(a, b, 400))
    spacing = math.dist(a, b) / 400
    if sampled == math.inf:
        assert exact == math.inf
    else:
        assert sampled - spacing / 2.0 - 1e-9 <= exact <= sampled + 1e-9
    assert exact == pytest.approx(terrain.segment_clearance_m(*b, *a), abs=1e-9)


@given(boxes(1), anywhere, anywhere)
def test_a_segment_crosses_a_box_iff_a_point_of_it_is_inside(some: tuple[Box, ...], a: Point, b: Point) -> None:
    assume(some)
    (box,) = some
    deepest = min(box.distance_m(*point) for point in between(a, b, 400))
    crossed = crosses(*a, *b, box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m)
    if deepest < -1e-9:
        assert crossed
    elif deepest > math.dist(a, b) / 400:
        assert not crossed


def test_touching_is_not_crossing() -> None:
    assert not crosses(0.0, 1.0, 5.0, 1.0, 1.0, 1.0, 2.0, 2.0)
    assert not crosses(0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0)
    assert not crosses(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0)
    assert crosses(1.5, 1.5, 1.5, 1.5, 1.0, 1.0, 2.0, 2.0)


@given(anywhere)
def test_the_fence(at: Point) -> None:
    assert TERRAIN.fence_m(*at) == pytest.approx(fence_m(*at))


def test_cells_hold_the_margins_of_their_middles() -> None:
    for column in range(0, 50, 7):
        for row in range(0, 50, 3):
            x, y = float(TERRAIN.cell_x[column, row]), float(TERRAIN.cell_y[column, row])
            assert (x, y) == pytest.approx((0.1 * column + 0.05, 0.1 * row + 0.05))
            assert TERRAIN.cell_fence[column, row] == pytest.approx(fence_m(x, y))
            assert TERRAIN.cell_clearance[column, row] == pytest.approx(clear_m(TERRAIN, x, y))


@given(anywhere, st.floats(0.05, 3.0))
def test_a_window_holds_every_cell_that_is_near(at: Point, reach_m: float) -> None:
    window = TERRAIN.window(*at, reach_m)
    near = (abs(TERRAIN.cell_x - at[0]) <= reach_m - 1e-9) & (abs(TERRAIN.cell_y - at[1]) <= reach_m - 1e-9)
    outside = np.ones_like(near)
    outside[window] = False
    assert not (near & outside).any()
    assert TERRAIN.cell_x[window].size > 0


@pytest.mark.parametrize("far_m", [20.0, 1e308, -1e308])
def test_a_window_is_at_the_edge_however_far_off_the_place_is(far_m: float) -> None:
    assert TERRAIN.window(far_m, far_m, 1.0) == TERRAIN.window(
        math.copysign(7.0, far_m), math.copysign(7.0, far_m), 1.0
    )


def test_a_large_room_has_larger_cells_instead_of_more() -> None:
    kilometres = Terrain(Workspace(2000.0, 500.0, (), ()), RADIUS_M)
    assert kilometres.cell_x.shape == (2000, 500)
    assert kilometres.cell_fence.max() == pytest.approx(250.0, abs=1.0)


def test_a_workspace_without_boxes_is_clear_everywhere() -> None:
    empty = Terrain(Workspace(3.0, 2.0, (), ()), RADIUS_M)
    assert empty.clearance_m(1.0, 1.0) == empty.segment_clearance_m(0.0, 0.0, 3.0, 2.0) == math.inf
    assert CASE.boxes
