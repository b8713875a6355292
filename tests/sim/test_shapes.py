"""Ground truth in worlds of polygons, against shapely."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
import shapely  # type: ignore[import-untyped]

from soter.geometry.draft import site_of
from soter.geometry.workspace import Box
from soter_sim.boxes import Boxes
from soter_sim.fences import fence_of
from soter_sim.polygons import Polygons
from soter_sim.shapes import chord_to_polygon, meet_polygon, point_to_polygon
from tests.geometry.drawn import drawn

EXACT_M = 1e-9


@pytest.fixture(params=range(6))
def stream(request: pytest.FixtureRequest) -> random.Random:
    return random.Random(request.param)


def polygon(stream: random.Random) -> tuple[tuple[float, float], ...]:
    while True:
        angles = sorted(stream.uniform(0.0, math.tau) for _ in range(stream.randint(3, 9)))
        ring = [(far * math.cos(a), far * math.sin(a)) for a in angles for far in [stream.uniform(0.5, 3.0)]]
        if shapely.Polygon(ring).is_valid and shapely.Polygon(ring).area > 0.1:
            return tuple(ring)


def test_distances_of_points_and_chords(stream: random.Random) -> None:
    ring = polygon(stream)
    exact = shapely.Polygon(ring)
    for _ in range(100):
        x, y, dx, dy = (stream.uniform(-4.0, 4.0) for _ in range(4))
        point, chord = shapely.Point(x, y), shapely.LineString([(x, y), (x + dx, y + dy)])
        depth = -1.0 if exact.contains(point) else 1.0
        assert point_to_polygon(x, y, ring) == pytest.approx(depth * exact.exterior.distance(point), abs=EXACT_M)
        assert max(chord_to_polygon(x, y, dx, dy, ring), 0.0) == pytest.approx(exact.distance(chord), abs=EXACT_M)


def test_nothing_within_reach_is_left_out_and_most_beyond_it_is(stream: random.Random) -> None:
    corners = [(stream.uniform(-100.0, 100.0), stream.uniform(-100.0, 100.0)) for _ in range(300)]
    boxes = Boxes([Box(x, y, x + stream.uniform(0.1, 3.0), y + 1.0) for x, y in corners])
    polygons = Polygons([tuple((x + dx, y + dy) for dx, dy in polygon(stream)) for x, y in corners], 0.3)
    things: Any
    for things in (boxes, polygons):
        for reach_m in (0.1, 2.0, 3.0, 17.0, 60.0):
            x, y = stream.uniform(-90.0, 90.0), stream.uniform(-90.0, 90.0)
            near = things.near(x, y, reach_m)
            assert {each for each in things.all if things.point_to(x, y, each) < reach_m} <= set(near)
            # A cell is no wider than the reach, and what is within three times its width of its middle is kept.
            assert len(near) < len(things.all) * (0.03 + (7.0 * max(reach_m, 2.0) / 200.0) ** 2)
        assert things.near(0.0, 0.0, math.inf) is things.all


def test_a_disc_meets_a_polygon_when_it_touches_it(stream: random.Random) -> None:
    ring = polygon(stream)
    exact, met = shapely.Polygon(ring), 0
    for _ in range(200):
        x, y, dx, dy = (stream.uniform(-4.0, 4.0) for _ in range(4))
        radius = 0.105
        if exact.distance(shapely.Point(x, y)) <= radius:
            continue
        at = meet_polygon(x, y, dx, dy, ring, radius)
        least = exact.distance(shapely.LineString([(x, y), (x + dx, y + dy)]))
        assert (at <= 1.0) == (least < radius)
        if at <= 1.0:
            met += 1
            assert exact.distance(shapely.Point(x + at * dx, y + at * dy)) == pytest.approx(radius, abs=1e-8)
    assert met


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_is_outside_for_as_long_as_it_is(seed: int) -> None:
    stream, made_of = random.Random(seed), drawn(seed)
    fence = fence_of(site_of(made_of, phi_safer_m=0.1, spacing_m=0.5), 1e-6)
    inside = shapely.Polygon(made_of.fences[0].ring)
    low_x, low_y, high_x, high_y = inside.bounds
    for _ in range(100):
        x, y = stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)
        angle, length = stream.uniform(0.0, math.tau), stream.choice((0.02, 0.3, 3.0))
        dx, dy = length * math.cos(angle), length * math.sin(angle)
        chord = shapely.LineString([(x, y), (x + dx, y + dy)])
        outside_m = sum((last - first) * length for first, last in fence.outside(x, y, dx, dy))
        assert outside_m == pytest.approx(chord.difference(inside).length, abs=1e-5)
        # Where it begins has been looked at before.
        margin = min(fence.margin(x, y, x, y), fence.margin(x, y, x + dx, y + dy))
        if inside.covers(chord):
            assert margin == pytest.approx(inside.exterior.distance(chord), abs=1e-8)
        else:
            assert margin <= EXACT_M
