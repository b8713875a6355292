"""Ways home: as long as they must be, never through boxes, and out of them by the way that leads outwards only."""

from __future__ import annotations

import heapq
import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, Workspace
from soter.stack.roadmap import Roadmap
from soter.stack.routes import Routes
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, Terrain
from tests.stack.ground import RADIUS_M, TERRAIN, between, boxes, inside

CLEAR_M = 0.15
GROWN_M = RADIUS_M + CLEAR_M
HOME = (1.0, 1.0)
ROUTES = Routes(TERRAIN, HOME, CLEAR_M, 0.5)


def depth_m(terrain: Terrain, x: float, y: float) -> float:
    """How deep a point is inside the grown boxes: 0 outside."""
    return max(
        (
            min(x - b.low_x_m + GROWN_M, b.high_x_m + GROWN_M - x, y - b.low_y_m + GROWN_M, b.high_y_m + GROWN_M - y)
            for b in terrain.boxes
        ),
        default=0.0,
    )


def length_m(way: list[Point]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(way))


@pytest.mark.parametrize(
    ("start", "way"),
    [
        ((0.5, 0.5), [HOME]),
        ((1.0, 1.0), [HOME]),
        # Past the box in the south, whose grown corners are at (1.745, 1.255) and (3.255, 1.255).
        ((4.0, 0.5), [(3.255, 1.255), (1.745, 1.255), HOME]),
        ((0.5, 4.0), [(0.745, 1.745), HOME]),
        ((1.45, 3.5), [(0.745, 3.255), (0.745, 1.745), HOME]),
    ],
)
def test_known_ways(start: Point, way: list[Point]) -> None:
    legs = ROUTES.legs(*start)
    assert len(legs) == len(way)
    for corner, known in zip(legs, way, strict=True):
        assert corner == pytest.approx(known, abs=1e-5)
    assert ROUTES.distance_m(*start) == pytest.approx(length_m([start, *way]), abs=1e-4)


@given(inside)
def test_the_distance_is_the_length_of_the_legs(start: Point) -> None:
    legs = ROUTES.legs(*start)
    if legs:
        assert legs[-1] == HOME
        assert ROUTES.distance_m(*start) == pytest.approx(length_m([start, *legs]), abs=1e-9)
    else:
        assert ROUTES.distance_m(*start) == math.inf


@settings(max_examples=200)
@given(boxes(), inside, inside)
def test_a_way_keeps_its_clearance_or_that_of_where_it_begins(
    some: tuple[Box, ...], start: Point, place: Point
) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    assume(depth_m(terrain, *place) <= 0.0)
    legs = Routes(terrain, place, CLEAR_M, -math.inf).legs(*start)
    beside = terrain.clearance_m(*start) >= 0.0
    kept_m, allowed = min(CLEAR_M, terrain.clearance_m(*start)), max(depth_m(terrain, *start), 0.0)
    for a, b in pairwise([start, *legs]):
        for point in between(a, b, 60):
            assert (
                (terrain.clearance_m(*point) >= kept_m - 2e-6) if beside else depth_m(terrain, *point) <= allowed + 2e-6
            )
        kept_m, allowed = CLEAR_M, 0.0


@given(st.floats(0.01, GROWN_M - 0.01), st.floats(0.3, 0.7), st.sampled_from(["west", "east", "north", "south"]))
def test_from_inside_a_grown_box_the_way_leads_outwards(depth: float, along: float, side: str) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, (Box(2.0, 2.0, 3.0, 3.0),), ()), RADIUS_M)
    low, high = 2.0 - GROWN_M, 3.0 + GROWN_M
    start = {
        "west": (low + depth, 2.0 + along), "east": (high - depth, 2.0 + along),
        "south": (2.0 + along, low + depth), "north": (2.0 + along, high - depth),
    }[side]  # fmt: skip
    legs = Routes(terrain, (0.6, 0.6), CLEAR_M, 0.0).legs(*start)
    assert legs
    depths = [depth_m(terrain, *point) for point in between(start, legs[0], 200)]
    assert max(depths) <= depths[0] + 1e-9


def grid_distance_m(terrain: Terrain, start: Point, place: Point) -> float:
    """Dijkstra over cells of 0.1 m and 16 directions: never shorter than the shortest way, and hardly longer."""
    moves = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if math.gcd(i, j) == 1]
    goal, queue = (round(place[0] * 10), round(place[1] * 10)), [(0.0, (round(start[0] * 10), round(start[1] * 10)))]
    best = {queue[0][1]: 0.0}
    while queue:
        length, (i, j) = heapq.heappop(queue)
        if (i, j) == goal:
            return length
        if length > best[i, j]:
            continue
        for di, dj in moves:
            there, through = (i + di, j + dj), length + 0.1 * math.hypot(di, dj)
            free = all(
                depth_m(terrain, (i + di * k / 8) / 10, (j + dj * k / 8) / 10) <= 1e-9
                and -0.5 <= (i + di) / 10 <= 5.5
                and -0.5 <= (j + dj) / 10 <= 5.5
                for k in range(1, 9)
            )
            if free and through < best.get(there, math.inf):
                best[there] = through
                heapq.heappush(queue, (through, there))
    return math.inf


@settings(max_examples=12)
@given(boxes(3), st.tuples(st.integers(0, 50), st.integers(0, 50)))
def test_the_way_is_as_short_as_any_on_a_grid(some: tuple[Box, ...], start: tuple[int, int]) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    at = (start[0] / 10, start[1] / 10)
    place = (2.5, 2.5)
    assume(depth_m(terrain, *at) <= 0.0 and depth_m(terrain, *place) <= 0.0)
    found = Routes(terrain, place, CLEAR_M, -math.inf).distance_m(*at)
    sampled = grid_distance_m(terrain, at, place)
    assert found <= sampled + 1e-4
    if sampled < math.inf:
        # Sixteen directions cost at most 2.8 %, cells at corners a little more.
        assert found >= sampled / 1.03 - 0.4


@given(inside)
def test_no_way_home_is_longer_than_the_longest(start: Point) -> None:
    distance = ROUTES.distance_m(*start)
    if TERRAIN.clearance_m(*start) > CLEAR_M:
        assert distance <= ROUTES.longest_m


def test_corners_keep_off_the_fence_and_extra_rectangles_are_kept_out_of() -> None:
    narrow = Terrain(Workspace(5.0, 5.0, (Box(0.0, 2.0, 4.0, 3.0),), ()), RADIUS_M)
    assert Routes(narrow, (1.0, 1.0), CLEAR_M, 0.5).legs(1.0, 4.0)
    assert Routes(narrow, (1.0, 1.0), CLEAR_M, 1.0).legs(1.0, 4.0) == [], "the only corner is 0.745 m from the fence"
    blocked = Routes(narrow, (1.0, 1.0), CLEAR_M, 0.5, [(4.1, 1.0, 6.0, 4.0)])
    assert blocked.legs(1.0, 4.0) == []
    assert blocked.distance_m(1.0, 4.0) == math.inf


@pytest.mark.parametrize("place", [(1e308, 1e308), (-1e308, 2.0), (1e308, -1e308)])
def test_from_a_place_beyond_all_numbers_nothing_overflows(place: Point) -> None:
    assert ROUTES.distance_m(*place) >= 1e300 or ROUTES.legs(*place) == []


rectangles = boxes().map(lambda found: tuple((b.low_x_m, b.low_y_m, b.high_x_m, b.high_y_m) for b in found))


@given(boxes(3), rectangles, st.data(), st.sampled_from([-math.inf, 0.0, 0.25]))
def test_corners_see_each_other_whatever_other_robots_keep_out_of(
    some: tuple[Box, ...], rooms: tuple[Rectangle, ...], data: st.DataObject, inset_m: float
) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    extra = [room for room in rooms if data.draw(st.booleans())] + [*data.draw(rectangles)]
    roadmap = Roadmap(terrain, CLEAR_M, inset_m, extra, rooms)
    alone = Roadmap(terrain, CLEAR_M, inset_m, extra)
    assert roadmap.corners == alone.corners
    for index, corner in enumerate(roadmap.corners):
        seen = [other for other, there in enumerate(roadmap.corners) if roadmap.sees(*corner, *there)]
        assert roadmap.neighbours[index].tolist() == alone.neighbours[index].tolist() == seen
    places = (HOME, *roadmap.corners)
    for at, ends, away_m in roadmap.looks(HOME):
        assert away_m.tolist() == pytest.approx([math.dist(at, places[end]) for end in ends])
        within = any(r[0] < at[0] < r[2] and r[1] < at[1] < r[3] for r in roadmap.rectangles)
        seen = [] if within else [end for end, there in enumerate(places) if roadmap.sees(*at, *there)]
        assert sorted(ends.tolist()) == seen


@given(boxes(), st.lists(inside, min_size=1, max_size=5))
def test_few_corners_are_looked_at_as_many_are(some: tuple[Box, ...], places: list[Point]) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, some, ()), RADIUS_M)
    few = Routes(terrain, HOME, CLEAR_M, 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("soter.stack.routes._FEW", 0)
        many = Routes(terrain, HOME, CLEAR_M, 0.0)
    for place in places:
        assert few.distance_m(*place) == pytest.approx(many.distance_m(*place), abs=1e-12)
