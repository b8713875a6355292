"""Fences with very many corners against shapely: distances are exact near by, and a tenth less at most far away."""

from __future__ import annotations

import math
import random

import pytest
import shapely  # type: ignore[import-untyped]

from soter.geometry.draft import Draft, Outline, Spot, site_of
from soter.geometry.far import FarPieces
from soter.geometry.site import Site

EXACT_M = 1e-9
PLACES = 400


@pytest.fixture(params=range(6))
def site(request: pytest.FixtureRequest) -> Site:
    """Return a site far from the origin, whose fence bends to and fro, in large and in small, with bays."""
    stream = random.Random(request.param)
    waves = [(stream.randint(2, 40), stream.uniform(0.0, math.tau), stream.uniform(0.0, 0.04)) for _ in range(4)]
    corners = stream.randint(300, 1500)

    def far_m(angle: float) -> float:
        small = stream.uniform(0.0, 0.05) if request.param % 2 else 0.0
        return 12.0 * (1.0 + sum(high * math.sin(count * angle + at) for count, at, high in waves)) + small

    angles = [math.tau * each / corners for each in range(corners)]
    ring = [
        (-300.0 + wide * math.cos(angle), 1200.0 + 0.6 * wide * math.sin(angle))
        for angle in angles
        for wide in [far_m(angle)]
    ]
    spots = [Spot("station 1", -301.0, 1200.0), Spot("station 2", -299.0, 1200.0)]
    return site_of(Draft("bays", [Outline("fence", ring)], stations=spots), phi_safer_m=0.1, spacing_m=0.5)


def places(site: Site) -> list[tuple[float, float]]:
    stream, (low_x, low_y, high_x, high_y) = random.Random(1), site.bounds
    return [(stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)) for _ in range(PLACES)]


def test_distances_are_exact_up_to_a_quarter_of_a_metre_and_beyond_that_a_tenth_less_at_most(site: Site) -> None:
    polygon, seen = shapely.Polygon(site.plan.fence), set()
    assert isinstance(site.from_fence, FarPieces)
    unders_m = site.unders_m[: len(site.plan.far_around)]
    for x, y in places(site):
        if not polygon.contains(shapely.Point(x, y)):
            assert site.fence_m(x, y) <= EXACT_M
            continue
        true_m, found_m = polygon.exterior.distance(shapely.Point(x, y)), site.fence_m(x, y)
        less_m = max([under_m for under_m in unders_m if true_m > 10.0 * under_m], default=0.0)
        assert true_m - less_m - EXACT_M <= found_m <= true_m + EXACT_M
        seen.add((less_m, found_m < true_m - EXACT_M))
    assert seen >= {(0.0, False), *((under_m, True) for under_m in unders_m)}


def test_a_distance_changes_by_no_more_than_a_metre_a_metre(site: Site) -> None:
    stream, band = random.Random(2), 0
    for x, y in places(site):
        for _ in range(6):
            angle, far_m = stream.uniform(0.0, math.tau), stream.choice((1e-4, 0.02, 0.3))
            then_x, then_y = x + far_m * math.cos(angle), y + far_m * math.sin(angle)
            before_m, then_m = site.fence_m(x, y), site.fence_m(then_x, then_y)
            assert abs(then_m - before_m) <= far_m + EXACT_M
            band += 0.2 < before_m < 0.3 or 1.8 < before_m < 2.2
            x, y = then_x, then_y
    assert band > 20


def test_a_leg_is_as_far_from_the_fence_as_it_is(site: Site) -> None:
    polygon, spots, sure = shapely.Polygon(site.plan.fence), places(site), 0
    for a, b in zip(spots[::2], spots[1::2], strict=True):
        line = shapely.LineString([a, b])
        true_m = polygon.exterior.distance(line) if polygon.contains(line) else 0.0
        for needed_m in (0.3, 1.2, 2.5):
            assert site.outside.line_keeps(*a, *b, needed_m) == (true_m >= needed_m)
            if true_m > 0.0:
                assert site.fence_along_m(*a, *b, needed_m) == pytest.approx(min(true_m, needed_m), abs=EXACT_M)
            surely = site.from_fence.surely_keeps(*a, *b, needed_m)
            assert true_m >= needed_m or not surely
            sure += surely
    assert sure > 10


def test_a_fence_with_few_corners_is_exact_everywhere() -> None:
    ring = [(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)]
    spots = [Spot("station 1", 5.0, 5.0), Spot("station 2", 9.0, 5.0)]
    plain = site_of(Draft("room", [Outline("fence", ring)], stations=spots), phi_safer_m=0.1, spacing_m=0.5)
    assert plain.plan.far_around == ()
    assert plain.from_fence is plain.outside
    assert plain.fence_m(15.0, 10.0) == 10.0
