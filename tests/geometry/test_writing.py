"""Workspaces that are written are read again as the same ones, in every format, or refused by what does not fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soter.config.toml_text import toml
from soter.errors import ConfigError
from soter.geometry.draft import Draft, Outline, Spot, site_of
from soter.geometry.earth import Projection
from soter.geometry.reading import read_workspace
from soter.geometry.site import GeoOrigin, Site
from soter.geometry.workspace import Box, Point, RobotPlace, Workspace
from soter.geometry.writing import as_geojson, as_plan, as_tables, left_out
from soter.geometry.writing_xml import OFF_M, as_kml, as_xml
from tests.geometry.drawn import drawn

pytest.importorskip("pymap3d")

ORIGIN = GeoOrigin(47.6187, 9.4402)
STATED_M = 3e-4
"""Nine decimals of a degree are a tenth of a millimetre each way."""

ROOM = [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)]
BOX = [(2.0, 0.0), (3.0, 0.0), (3.0, 1.0), (2.0, 1.0)]


def read(data: bytes, ending: str) -> Workspace:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"written{ending}"
        path.write_bytes(data)
        return read_workspace(path)


def written(made: Workspace, ending: str, origin: GeoOrigin = ORIGIN) -> bytes:
    if ending == ".xml":
        return as_xml(made, "here")
    if ending == ".kml":
        return as_kml(made, origin, "here")
    return json.dumps(as_plan(made, origin) if ending == ".plan" else as_geojson(made, origin)).encode()


def site(draft: Draft) -> Site:
    return site_of(draft, phi_safer_m=0.1, spacing_m=0.5)


def room(*areas: tuple[str, list[Point]], fence: list[Point] | None = ROOM) -> Site:
    outlines = [Outline(name, ring, 0.5) for name, ring in areas]
    fences = [] if fence is None else [Outline("fence", fence)]
    return site(Draft("room", fences=fences, keep_outs=outlines, stations=[Spot("station 1", 4.5, 2.5)]))


@settings(max_examples=8, derandomize=True, deadline=None)
@given(seed=st.integers(0, 10_000), lat_deg=st.floats(-80.0, 80.0), lon_deg=st.floats(-180.0, 180.0))
@pytest.mark.parametrize("ending", [".geojson", ".plan", ".kml"])
def test_places_on_earth_stay_where_they_are(ending: str, seed: int, lat_deg: float, lon_deg: float) -> None:
    draft, origin = drawn(seed), GeoOrigin(lat_deg, lon_deg)
    draft.keep_outs = [replace(each, height_m=0.5 + n) for n, each in enumerate(draft.keep_outs)]
    draft.starts = [
        replace(each, robot_id=n + 7, x_m=each.x_m + 0.02, heading_rad=0.5 * n) for n, each in enumerate(draft.stations)
    ]
    try:
        made = site(draft)
    except ConfigError:
        assume(False)  # too little room for the stations
    again = read(written(made, ending, origin), ending)
    assert isinstance(again, Site)
    assert again.plan.origin is not None
    # KML says no origin, and each origin has a plane of its own: they are compared on earth.
    before, after = Projection(origin, "test"), Projection(again.plan.origin, "test")

    def same(one: Point, other: Point) -> bool:
        return before.point(*after.place(*other)) == pytest.approx(one, abs=STATED_M)

    rings = [[each.plan.fence or (), *(area.ring for area in each.plan.areas)] for each in (made, again)]
    for ring, other in zip(*rings, strict=True):
        assert all(same(*each) for each in zip(ring, other, strict=True))
    for one, place in zip(made.robots, again.robots, strict=True):
        assert same(one.charger.centre, place.charger.centre)
    if ending == ".geojson":
        assert [each.height_m for each in again.plan.areas] == [each.height_m for each in made.plan.areas]
        assert [each.id for each in again.robots] == [each.id for each in made.robots]
        for one, place in zip(made.robots, again.robots, strict=True):
            assert same((one.x_m, one.y_m), (place.x_m, place.y_m))
            assert place.heading_rad == pytest.approx(one.heading_rad)
    if ending != ".plan":
        assert [each.name for each in again.plan.areas] == [each.name for each in made.plan.areas]


sides_m = st.tuples(st.floats(0.0, 8.0), st.floats(0.0, 2.0), st.floats(0.05, 2.0), st.floats(0.05, 0.5))


@settings(max_examples=25, derandomize=True, deadline=None)
@given(
    boxes=st.lists(sides_m, max_size=5),
    height_m=st.floats(0.1, 3.0),
    starts=st.lists(st.floats(3.0, 3.5), min_size=1, max_size=4),
)
def test_rectangles_are_the_same_in_xml(
    boxes: list[tuple[float, float, float, float]], height_m: float, starts: list[float]
) -> None:
    made = Workspace(
        10.0,
        4.0,
        tuple(Box(x, y, x + length_m, y + width_m, height_m) for x, y, length_m, width_m in boxes),
        tuple(
            RobotPlace(7 - n, 1.0 + 2.0 * n, y, Box(0.8 + 2.0 * n, 3.0, 1.2 + 2.0 * n, 3.4, 0.0), y - 3.0)
            for n, y in enumerate(starts)
        ),
    )
    assert read(as_xml(made, "here"), ".xml") == made
    polygons = read(toml(as_tables(made)).encode(), ".toml")
    again = read(as_xml(polygons, "here"), ".xml")
    assert again.bounds == made.bounds
    assert [each.id for each in again.robots] == [each.id for each in made.robots]
    for one, box in zip(made.boxes, again.boxes, strict=True):
        for name in ("low_x_m", "low_y_m", "high_x_m", "high_y_m", "height_m"):
            assert getattr(box, name) == pytest.approx(getattr(one, name), abs=OFF_M)


def test_a_room_that_was_on_earth_is_a_rectangle_again() -> None:
    there = read(written(room(("box", BOX)), ".geojson"), ".geojson")
    again = read(written(there, ".xml"), ".xml")
    (box,) = again.boxes
    assert again.bounds == pytest.approx((0.0, 0.0, 6.0, 4.0), abs=OFF_M)
    assert (box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m) == pytest.approx((2.0, 0.0, 3.0, 1.0), abs=OFF_M)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (room(fence=None), "fence: there is none"),
        (room(fence=ROOM[:3]), "fence: it has 3 corners, not 4"),
        (room(fence=[(-1.0, 0.0), *ROOM[1:3], (-1.0, 4.0)]), "fence: its lowest corner is (-1, 0), not (0, 0)"),
        (room(("box", BOX), ("bed", [(1.0, 1.0), (2.0, 1.5), (1.5, 2.5), (0.5, 2.0)])), "bed: its edges are not along"),
        (room(("bar", [*BOX, (2.5, 0.5)])), "bar: it has 5 corners, not 4"),
        (room(("out", [(2.0, -1.0), (3.0, -1.0), (3.0, 1.0), (2.0, 1.0)])), "it lies outside the workspace"),
        (Site(replace(room().plan, robots=())), "there is no robot"),
    ],
)
def test_what_is_no_rectangle_with_boxes_is_not_written_as_xml(made: Site, said: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        as_xml(made, "here")
    assert "here" in str(refusal.value)
    assert said in str(refusal.value)


def test_names_in_kml_are_kept_and_none_is_taken_for_the_fence() -> None:
    names = ["a <b> & 'c'", "Fence, hole 1"]
    made = room((names[0], BOX), (names[1], [(x, y + 2.5) for x, y in BOX]))
    again = read(written(made, ".kml"), ".kml")
    assert isinstance(again, Site)
    assert [each.name for each in again.plan.areas] == [names[0], "area Fence, hole 1"]
    with pytest.raises(ConfigError, match=r"'\\x01', which XML cannot hold"):
        written(room(("a\x01", BOX)), ".kml")
    with pytest.raises(ConfigError, match="has no fence"):
        written(room(("box", BOX), fence=None), ".kml")


def test_what_a_format_has_no_place_for_is_said() -> None:
    start = RobotPlace(2, 4.5, 1.0, Box(4.0, 2.0, 5.0, 3.0, 0.0))
    made = Site(replace(room(("box", BOX)).plan, robots=(start,), origin=ORIGIN))
    assert left_out(made, ".geojson") == []
    assert left_out(made, ".xml") == ["names", "origin"]
    assert left_out(made, ".kml") == ["heights", "sides of stations", "starts", "ids"]
    assert left_out(made, ".plan") == ["names", *left_out(made, ".kml")]
    assert left_out(room(), ".plan") == []
