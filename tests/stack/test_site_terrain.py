"""A site's terrain: a room of polygons is the room of boxes, and legs that are certified keep their distance."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
import shapely  # type: ignore[import-untyped]

from soter.errors import ConfigError
from soter.geometry.draft import Draft, Outline, Spot, site_of
from soter.geometry.site import NotRectangular, Site
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.stack.planners.space import SiteSpace
from soter.stack.routes import Routes
from soter.stack.site_terrain import SiteTerrain, terrain_of
from soter.stack.terrain import Terrain
from tests.geometry.drawn import drawn

BOXES = (Box(1.0, 1.0, 2.0, 1.5), Box(3.0, 2.0, 3.5, 4.0))
ROOM = Workspace(5.0, 6.0, BOXES, (RobotPlace(1, 0.5, 0.5, Box(0.25, 0.25, 0.75, 0.75)),))
RADIUS_M = 0.105
SLOPE = math.sin(0.35)


def turned(angle: float, x: float, y: float) -> tuple[float, float]:
    """Return where a place of the room is once it is turned, and moved to (-300, 1200)."""
    cos, sin = math.cos(angle), math.sin(angle)
    return -300.0 + cos * x - sin * y, 1200.0 + sin * x + cos * y


def as_site(angle: float) -> Site:
    """Return the room as polygons, turned and moved."""
    fence, boxes = ROOM.outlines()
    assert fence is not None
    draft = Draft("room", [Outline("fence", [turned(angle, *at) for at in fence])])
    draft.keep_outs += [Outline("box", [turned(angle, *at) for at in box]) for box in boxes]
    draft.stations.append(Spot("station", *turned(angle, 0.5, 0.5)))
    return site_of(draft, phi_safer_m=0.1, spacing_m=0.5)


@pytest.mark.parametrize("angle", [0.0, math.radians(30.0)])
def test_a_room_of_polygons_is_the_room_of_boxes(angle: float) -> None:
    stream, room, site = random.Random(7), Terrain(ROOM, RADIUS_M), terrain_of(as_site(angle), RADIUS_M)
    assert isinstance(site, SiteTerrain)
    for _ in range(300):
        a, b = ((stream.uniform(-0.2, 5.2), stream.uniform(-0.2, 6.2)) for _ in range(2))
        ta, tb = turned(angle, *a), turned(angle, *b)
        near = a[0] + stream.uniform(-0.1, 0.1), a[1] + stream.uniform(-0.1, 0.1)
        t_near = turned(angle, *near)
        # Outside it is the depth in one of the pieces there.
        inside = room.fence_m(*a) >= 0.0
        assert site.fence_m(*ta) == pytest.approx(room.fence_m(*a), abs=1e-9) if inside else site.fence_m(*ta) < 0.0
        assert site.clearance_m(*ta) == pytest.approx(room.clearance_m(*a), abs=1e-9)
        assert site.segment_clearance_m(*ta, *tb) == pytest.approx(room.segment_clearance_m(*a, *b), abs=1e-8)
        for needed_m in (0.03, 0.2):
            leg = room.leg_clearance_m(*a, *near, needed_m, SLOPE)
            found = site.leg_clearance_m(*ta, *t_near, needed_m, SLOPE)
            assert (found >= needed_m - 1e-9) == (leg >= needed_m - 1e-9)
            if not inside:
                continue
            kept = room.leg_fence_m(*a, *near, needed_m, SLOPE)
            assert (site.leg_fence_m(*ta, *t_near, needed_m, SLOPE) >= -1e-9) == (kept >= -1e-9)


def test_cells_to_retreat_to_are_as_far_as_they_must_be() -> None:
    site = terrain_of(as_site(0.5), RADIUS_M)
    fits = site.roomy_cells(0.3, 0.2)
    for x, y, fit in zip(site.cell_x.ravel()[::17], site.cell_y.ravel()[::17], fits.ravel()[::17], strict=True):
        assert fit == (site.fence_m(x, y) >= 0.3 and site.clearance_m(x, y) >= 0.2)


def test_whoever_knows_rectangles_only_is_refused() -> None:
    site = terrain_of(as_site(0.5), RADIUS_M)
    with pytest.raises(NotRectangular):
        _ = site.width_m


@pytest.mark.parametrize("seed", range(6))
def test_what_is_certified_keeps_its_distance_wherever_the_robot_strays(seed: int) -> None:
    stream, made_of = random.Random(seed), drawn(seed)
    made = site_of(made_of, phi_safer_m=0.1, spacing_m=0.5)
    terrain = terrain_of(made, RADIUS_M)
    fence = shapely.Polygon(made_of.fences[0].ring)
    kept = shapely.union_all([shapely.Polygon(each.ring) for each in made_of.keep_outs])
    low_x, low_y, high_x, high_y = made.bounds
    tried = 0
    for _ in range(1500):
        a = stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)
        if terrain.fence_m(*a) < 0.0 or terrain.clearance_m(*a) < 0.0:
            continue
        angle, length, needed_m = stream.uniform(0.0, math.tau), stream.uniform(0.02, 0.2), 0.05
        b = a[0] + length * math.cos(angle), a[1] + length * math.sin(angle)
        certified = (
            terrain.leg_fence_m(*a, *b, needed_m, SLOPE) >= 0.0
            and terrain.leg_clearance_m(*a, *b, needed_m, SLOPE) >= needed_m
        )
        if not certified:
            continue
        tried += 1
        # It may be anywhere in the cone that a leg that leads away allows, or off a leg that keeps its distance.
        aside = stream.uniform(-0.34, 0.34)
        far = stream.uniform(0.0, length * math.cos(aside))
        at = shapely.Point(a[0] + far * math.cos(angle + aside), a[1] + far * math.sin(angle + aside))
        least = min(fence.exterior.distance(shapely.Point(a)), needed_m) - 0.34 * length
        assert fence.covers(at)
        assert fence.exterior.distance(at) >= max(least, 0.0) - 1e-9
        assert kept.distance(at) - RADIUS_M >= -1e-9
    assert tried > 100


@pytest.mark.parametrize("seed", range(4))
def test_ways_keep_what_they_are_to_keep(seed: int) -> None:
    made = site_of(drawn(seed), phi_safer_m=0.1, spacing_m=0.5)
    terrain, station = terrain_of(made, RADIUS_M), made.robots[0].charger.centre
    routes = Routes(terrain, station, 0.1, 0.15)
    for place in made.robots[1:]:
        way = [place.charger.centre, *routes.legs(*place.charger.centre)]
        if len(way) == 1:
            continue
        assert way[-1] == station
        legs = list(pairwise(way))
        assert sum(math.dist(a, b) for a, b in legs) == pytest.approx(routes.distance_m(*way[0]))
        for a, b in legs:
            assert terrain.segment_clearance_m(*a, *b) >= 0.1 - 1e-8
            assert terrain.fence_along_m(*a, *b) >= 0.15 - 1e-8


def test_a_way_leads_round_the_corner_of_a_hall() -> None:
    draft = Draft("hall", [Outline("fence", [(0, 0), (10, 0), (10, 4), (4, 4), (4, 10), (0, 10)])])
    draft.stations.append(Spot("station", 9.0, 1.0))
    terrain = terrain_of(site_of(draft, phi_safer_m=0.1, spacing_m=0.5), RADIUS_M)
    legs = Routes(terrain, (9.0, 1.0), 0.1, 0.3).legs(1.0, 9.0)
    assert legs[:-1] == [pytest.approx((3.7, 3.7), abs=1e-5)]


def test_planners_get_out_of_where_they_may_not_be() -> None:
    made = as_site(0.5)
    space = SiteSpace(made, 0.2)
    for place in (turned(0.5, -0.5, 3.0), turned(0.5, 1.5, 1.2), turned(0.5, 4.0, 3.0)):
        space.begin(())
        found, checks = space.nearest_free(*place), space.checks
        assert found is not None
        # What is known already costs the same virtual time.
        space.begin(())
        assert (space.nearest_free(*place), space.checks) == (found, checks)
        space.begin([(*found, 0.3)])
        assert space.nearest_free(*place) != found
        space.begin(())
        assert space.is_free(*found)
        assert math.dist(found, place) < 1.0
    assert not space.is_open(*turned(0.5, 2.5, 3.0), *turned(0.5, 4.5, 3.0))
    assert space.is_open(*turned(0.5, 0.3, 3.0), *turned(0.5, 2.5, 3.0))


def test_a_station_in_a_narrow_place_is_refused_by_name() -> None:
    draft = Draft(
        "room", [Outline("fence", [(0, 0), (4, 0), (4, 4), (0, 4)])], [Outline("post", [(1, 1), (2, 1), (1, 2)])]
    )
    draft.stations.append(Spot("station", 0.9, 0.9))
    with pytest.raises(ConfigError, match="post"):
        site_of(draft, phi_safer_m=0.1, spacing_m=0.5)
