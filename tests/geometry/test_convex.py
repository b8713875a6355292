"""Convex pieces against shapely: distances, legs, directions, and what is outside of a fence."""

from __future__ import annotations

import math
import random

import pytest
import shapely  # type: ignore[import-untyped]

from soter.geometry.convex import Pieces
from soter.geometry.decompose import anticlockwise, pieces_around, pieces_of
from soter.geometry.draft import circle
from soter.geometry.workspace import Ring

EXACT_M = 1e-9
PLACES = 40


def star(stream: random.Random, x: float, y: float) -> Ring:
    angles = sorted(stream.uniform(0.0, math.tau) for _ in range(stream.randint(3, 11)))
    return tuple(
        (x + far * math.cos(angle), y + far * math.sin(angle)) for angle in angles for far in [stream.uniform(1.0, 8.0)]
    )


def rings(stream: random.Random) -> list[Ring]:
    """Return polygons of any shape, far from the origin."""
    found: list[Ring] = []
    while not found:
        drawn = [star(stream, stream.uniform(-320.0, -280.0), stream.uniform(1180.0, 1220.0)) for _ in range(4)]
        found = [
            anticlockwise(ring) for ring in drawn if shapely.Polygon(ring).is_valid and shapely.Polygon(ring).area > 0.1
        ]
    return found


@pytest.fixture(params=range(12))
def stream(request: pytest.FixtureRequest) -> random.Random:
    return random.Random(request.param)


def test_pieces_are_convex_and_cover_their_polygon_once(stream: random.Random) -> None:
    for ring in rings(stream):
        polygon, pieces = shapely.Polygon(ring), [shapely.Polygon(piece) for piece in pieces_of(ring)]
        assert all(math.isclose(piece.convex_hull.area, piece.area, rel_tol=1e-9) for piece in pieces)
        assert sum(piece.area for piece in pieces) == pytest.approx(polygon.area, abs=1e-9)
        assert shapely.union_all(pieces).symmetric_difference(polygon).area == pytest.approx(0.0, abs=1e-9)


def test_distances_and_legs_are_those_of_shapely(stream: random.Random) -> None:
    kept_out = rings(stream)
    pieces = Pieces([piece for ring in kept_out for piece in pieces_of(ring)])
    union = shapely.union_all([shapely.Polygon(ring) for ring in kept_out])
    for _ in range(PLACES):
        here, there = ((stream.uniform(-340.0, -260.0), stream.uniform(1160.0, 1240.0)) for _ in range(2))
        true_m, found_m = union.distance(shapely.Point(here)), pieces.distance_m(*here)
        if true_m == 0.0:
            assert found_m <= EXACT_M
            continue
        assert found_m == pytest.approx(true_m, abs=EXACT_M)
        leg_m = union.distance(shapely.LineString([here, there]))
        assert max(pieces.segment_m(*here, *there), 0.0) == pytest.approx(leg_m, abs=1e-8)
        for enough_m in (0.1, 3.0):
            assert max(pieces.segment_m(*here, *there, enough_m), 0.0) == pytest.approx(min(leg_m, enough_m), abs=1e-8)
            assert pieces.line_keeps(*here, *there, enough_m) == (leg_m >= enough_m)
            assert pieces.keeps(*here, enough_m) == (true_m >= enough_m)
        assert [pieces.keeps(*here, true_m + by_m) for by_m in (-EXACT_M, EXACT_M)] == [True, False]


def test_lines_may_be_as_long_as_they_like(stream: random.Random) -> None:
    for kept_out in (rings(stream)[:1], [ring for _ in range(12) for ring in rings(stream)]):
        pieces = Pieces([piece for ring in kept_out for piece in pieces_of(ring)])
        union = shapely.union_all([shapely.Polygon(ring) for ring in kept_out])
        for far_m in (30.0, 300.0, 1e4, 1e8):
            here = (stream.uniform(-340.0, -260.0), stream.uniform(1160.0, 1240.0))
            there = (-300.0 + stream.uniform(-far_m, far_m), 1200.0 + far_m)
            line_m = union.distance(shapely.LineString([here, there]))
            slack_m = 1e-8 + 1e-15 * far_m
            assert max(pieces.segment_m(*here, *there, 2.0), 0.0) == pytest.approx(min(line_m, 2.0), abs=slack_m)


def test_the_distance_is_1_lipschitz_and_falls_fastest_where_walls_say(stream: random.Random) -> None:
    pieces = Pieces([piece for ring in rings(stream) for piece in pieces_of(ring)])
    for _ in range(PLACES):
        x, y = stream.uniform(-320.0, -280.0), stream.uniform(1180.0, 1220.0)
        dx, dy = stream.uniform(-1.0, 1.0), stream.uniform(-1.0, 1.0)
        change = abs(pieces.distance_m(x + dx, y + dy) - pieces.distance_m(x, y))
        assert change <= math.hypot(dx, dy) + EXACT_M
        walls = pieces.walls(x, y, 5.0)
        near = pieces.distance_m(x, y)
        assert (near > 5.0) == (not walls)
        if walls:
            away_m, ux, uy = min(walls)
            assert away_m == pytest.approx(near, abs=EXACT_M)
            assert math.hypot(ux, uy) == pytest.approx(1.0)
            step = 1e-4
            if away_m > step:
                assert pieces.distance_m(x + step * ux, y + step * uy) == pytest.approx(away_m - step, abs=1e-7)


def test_what_is_outside_of_a_fence_is_its_bounding_box_without_its_inside(stream: random.Random) -> None:
    for ring in rings(stream):
        polygon, outside = shapely.Polygon(ring), Pieces(pieces_around(ring))
        low_x, low_y, high_x, high_y = polygon.bounds
        for _ in range(PLACES // 4):
            x, y = stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)
            found_m = min(x - low_x, high_x - x, y - low_y, high_y - y, outside.distance_m(x, y))
            if polygon.contains(shapely.Point(x, y)):
                assert found_m == pytest.approx(polygon.exterior.distance(shapely.Point(x, y)), abs=EXACT_M)
            else:
                assert found_m <= EXACT_M


def test_of_many_edges_that_are_about_as_near_none_is_left_out(stream: random.Random) -> None:
    """Between two sides of a long fence, those of both are about as near."""
    angles = [math.tau * each / 400 for each in range(400)]
    off_m = [stream.uniform(0.0, 0.05) for _ in angles]
    ring = [(20.0 * math.cos(at), (2.0 + off) * math.sin(at)) for at, off in zip(angles, off_m, strict=True)]
    polygon, outside = shapely.Polygon(ring), Pieces(pieces_around(tuple(ring)))
    for _ in range(PLACES):
        x, y = stream.uniform(-15.0, 15.0), stream.uniform(-0.2, 0.2)
        for _ in range(4):
            x, y = x + stream.uniform(-0.1, 0.1), y + stream.uniform(-0.1, 0.1)
            exact_m = polygon.exterior.distance(shapely.Point(x, y))
            assert outside.distance_m(x, y) == pytest.approx(exact_m, abs=EXACT_M)


def test_what_stands_out_a_little_does_not_hide_the_wall_behind_it(stream: random.Random) -> None:
    """Straight before a tip the wall is farther, a little aside it is nearer."""
    wall = ((-9.0, -1.0), (9.0, -1.0), (9.0, 0.0), (-9.0, 0.0))
    tips = [(at / 4.0 + stream.uniform(-0.05, 0.05), stream.uniform(0.0, 0.02)) for at in range(-32, 33)]
    spikes = [((x - 1e-3, 0.0), (x + 1e-3, 0.0), (x, out_m)) for x, out_m in tips if out_m > 0.0]
    pieces, shapes = Pieces([wall, *spikes]), [shapely.Polygon(wall), *map(shapely.Polygon, spikes)]
    union = shapely.union_all(shapes)
    for _ in range(PLACES):
        x, y = stream.uniform(-8.0, 8.0), stream.uniform(0.1, 0.6)
        assert pieces.distance_m(x, y) == pytest.approx(union.distance(shapely.Point(x, y)), abs=EXACT_M)


@pytest.mark.parametrize("radius_m", [0.02, 0.2, 3.0, 900.0])
def test_circles_are_off_to_the_safe_side(radius_m: float) -> None:
    around, within = (shapely.Polygon(circle(5.0, -7.0, radius_m, around=each)) for each in (True, False))
    exact = shapely.Point(5.0, -7.0).buffer(radius_m, quad_segs=2048)
    assert around.covers(exact.buffer(-1e-5 * radius_m))
    assert exact.buffer(1e-5 * radius_m).covers(within)
    assert within.exterior.distance(shapely.Point(5.0, -7.0)) >= radius_m - max(0.0101, 0.035 * min(radius_m, 0.3))
