"""Sites: the fence and areas of any shape, and what is refused of them."""

from __future__ import annotations

import math
import pickle

import pytest
import shapely  # type: ignore[import-untyped]
from pydantic import TypeAdapter

from soter.errors import ConfigError
from soter.geometry.draft import Draft, Outline, Spot, circle, site_of
from soter.geometry.site import NotRectangular, Site, SitePlan, from_plain, plain
from soter.geometry.workspace import Workspace
from tests.geometry.drawn import drawn

HALL = [(0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0)]


def draft(**more: object) -> Draft:
    """Return an L-shaped hall with a round pond and two stations."""
    found = Draft("hall.toml", [Outline("fence", HALL)], [Outline("pond", circle(2.0, 2.0, 0.5, around=True))])
    found.stations += [Spot("station 1", 1.0, 8.0), Spot("station 2", 8.0, 1.0)]
    for name, value in more.items():
        setattr(found, name, value)
    return found


def site(**more: object) -> Site:
    return site_of(draft(**more), phi_safer_m=0.1, spacing_m=0.5)


def refused(**more: object) -> str:
    with pytest.raises(ConfigError) as failure:
        site(**more)
    return str(failure.value)


def test_it_goes_from_process_to_process() -> None:
    made = site()
    assert pickle.loads(pickle.dumps(made)) == made  # noqa: S301 - what was written a moment ago
    kind = TypeAdapter(Workspace | SitePlan)
    assert from_plain(kind.validate_json(kind.dump_json(plain(made)))) == made
    assert made.with_robots(1).robots == made.robots[:1]


def test_whoever_knows_rectangles_only_is_refused() -> None:
    made = site()
    for name in ("width_m", "depth_m", "boxes"):
        with pytest.raises(NotRectangular):
            getattr(made, name)


def test_a_line_between_two_places_inside_may_leave_a_fence() -> None:
    made = site()
    assert made.fence_along_m(1.0, 9.0, 9.0, 1.0) <= 0.0
    assert made.fence_along_m(3.5, 9.0, 3.5, 3.0) == pytest.approx(0.5)
    assert made.fence_m(5.0, 5.0) == pytest.approx(-1.0)
    assert made.fence_m(3.0, 3.0) == pytest.approx(math.sqrt(2.0))


def test_a_free_place_is_free() -> None:
    made = site()
    found = made.nearest_free(2.0, 2.0, 0.3)
    assert found is not None
    assert made.contains(*found)
    assert made.clearance_m(*found, 0.0) >= 0.3 - 1e-9
    assert math.dist(found, (2.0, 2.0)) <= 1.1 * (0.5 + 0.3 + 0.02)


@pytest.mark.parametrize(
    ("ring", "said"),
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "Self-intersection"),
        ([(0, 0), (2, 0), (2, 2), (2, 0.0001), (1, 1)], "spike"),
        ([(0, 0), (2, 0), (2, 0), (1, 1)], "twice"),
        ([(0, 0), (2, 0)], "corners"),
        ([(0, 0), (2, 0), (math.nan, 1)], "finite"),
        ([(0, 0), (2, 0), (1, 30_000.0)], "too far"),
        ([(0, 0), (0.001, 0), (0, 0.001)], "area"),
        ([(20, 20), (21, 20), (20, 21)], "outside"),
        ([(k, k * k) for k in range(20_001)], "20000"),
    ],
)
def test_bad_polygons_are_refused_by_name(ring: list[tuple[float, float]], said: str) -> None:
    message = refused(keep_outs=[Outline("the shed", ring)])
    assert "the shed" in message
    assert said in message


def test_places_that_robots_do_not_fit_are_refused() -> None:
    assert "charging station of robot 1" in refused(stations=[Spot("a", 5.0, 5.0)])
    assert "'pond'" in refused(stations=[Spot("a", 2.55, 2.0)])
    assert "station" in refused(stations=[])
    assert "0.300 m" in refused(stations=[Spot("a", 8.0, 1.0), Spot("b", 8.3, 1.0)])
    assert "fences" in refused(fences=[Outline("fences 1", HALL), Outline("fences 2", HALL)])


@pytest.mark.parametrize("seed", range(8))
def test_drawn_worlds_are_read_as_they_are(seed: int) -> None:
    made_of = drawn(seed)
    try:
        made = site_of(made_of, phi_safer_m=0.1, spacing_m=0.5)
    except ConfigError:
        return
    fence = shapely.Polygon(made_of.fences[0].ring)
    assert made.plan.fence is not None
    assert shapely.Polygon(made.plan.fence).equals(fence)
    for place in made.robots:
        assert made.fence_m(*place.charger.centre) == pytest.approx(
            fence.exterior.distance(shapely.Point(place.charger.centre)), abs=1e-8
        )
