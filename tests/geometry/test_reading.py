"""Workspaces from TOML, GeoJSON, KML and QGroundControl's plans: the same world in all of them, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from soter.config.toml_text import toml
from soter.errors import ConfigError
from soter.geometry.earth import FARTHEST_M, Projection
from soter.geometry.reading import read_workspace
from soter.geometry.site import GeoOrigin, Site
from soter.geometry.writing import as_geojson, as_tables

pytest.importorskip("pymap3d")

WORLDS = sorted(
    path
    for path in (Path(__file__).parents[2] / "examples" / "worlds").iterdir()
    if "patrol" not in path.name and not path.name.startswith("flat")
)
ORIGIN = GeoOrigin(47.6187, 9.4402)
FENCE = [(-20.0, -15.0), (20.0, -15.0), (20.0, 15.0), (2.0, 15.0), (0.0, 2.0), (-20.0, 10.0)]
SHED = [(5.0, -8.0), (9.0, -8.0), (9.0, -2.0)]
STATIONS = [(-15.0, -10.0), (15.0, 10.0)]
POND = "<Placemark><name>pond</name><{0}><coordinates>9.44,47.6 9.45,47.6 9.44,47.61</coordinates></{0}></Placemark>"


def earth(at: tuple[float, float]) -> tuple[float, float]:
    """Return latitude and longitude."""
    return Projection(ORIGIN, "test").place(*at)


def geojson() -> dict[str, Any]:
    def lonlat(ring: list[tuple[float, float]]) -> list[list[float]]:
        return [list(reversed(earth(at))) for at in ring]

    def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
        return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}

    return {
        "type": "FeatureCollection",
        "origin": [ORIGIN.lon_deg, ORIGIN.lat_deg],
        "features": [
            feature("Polygon", [lonlat([*FENCE, FENCE[0]])], soter="fence"),
            feature("Polygon", [lonlat([*SHED, SHED[0]])], soter="keep_out", name="shed"),
            *(feature("Point", lonlat([at])[0], soter="station") for at in STATIONS),
        ],
    }


def plan() -> dict[str, Any]:
    def latlon(ring: list[tuple[float, float]]) -> list[list[float]]:
        return [list(earth(at)) for at in ring]

    return {
        "fileType": "Plan",
        "mission": {"plannedHomePosition": [ORIGIN.lat_deg, ORIGIN.lon_deg, 400.0]},
        "geoFence": {
            "version": 2,
            "polygons": [
                {"inclusion": True, "polygon": latlon(FENCE)},
                {"inclusion": False, "polygon": latlon(SHED)},
            ],
            "circles": [],
        },
        "rallyPoints": {"points": [[*at, 50.0] for at in latlon(STATIONS)]},
    }


def circle(radius_m: float) -> dict[str, Any]:
    return {"inclusion": False, "circle": {"center": list(earth((0.0, 0.0))), "radius": radius_m}}


def kml(*, fence: str = "fence") -> str:
    def text(ring: list[tuple[float, float]]) -> str:
        return " ".join(f"{lon:.9f},{lat:.9f},0" for lat, lon in map(earth, ring))

    def area(name: str, ring: list[tuple[float, float]]) -> str:
        inner = f"<LinearRing><coordinates>{text([*ring, ring[0]])}</coordinates></LinearRing>"
        polygon = f"<Polygon><outerBoundaryIs>{inner}</outerBoundaryIs></Polygon>"
        return f"<Placemark><name>{name}</name>{polygon}</Placemark>"

    points = "".join(
        f"<Placemark><Point><coordinates>{text([at])}</coordinates></Point></Placemark>" for at in STATIONS
    )
    inside = area(fence, FENCE) + area("shed", SHED) + points
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{inside}</Document></kml>'


def read(path: Path, text: str | dict[str, Any]) -> Site:
    path.write_text(text if isinstance(text, str) else json.dumps(text), encoding="utf-8")
    found = read_workspace(path)
    assert isinstance(found, Site)
    return found


def refusal(path: Path, text: str | dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as failure:
        read(path, text)
    assert str(path) in str(failure.value)
    return str(failure.value)


@pytest.mark.parametrize("name", ["a.geojson", "a.plan", "a.kml"])
def test_places_on_earth_are_where_they_are_in_every_format(name: str, tmp_path: Path) -> None:
    texts: dict[str, str | dict[str, Any]] = {"a.geojson": geojson(), "a.plan": plan(), "a.kml": kml()}
    made = read(tmp_path / name, texts[name])
    assert made.plan.fence is not None
    assert made.plan.origin is not None
    # A file without an origin has its own: distances are the same.
    east, north = Projection(made.plan.origin, "test").point(*earth((0.0, 0.0)))
    for (x, y), (found_x, found_y) in zip(FENCE, made.plan.fence, strict=True):
        assert (found_x - east, found_y - north) == pytest.approx((x, y), abs=1e-3)
    (shed,) = made.plan.areas
    assert len(shed.ring) == len(SHED)
    for (x, y), place in zip(STATIONS, made.robots, strict=True):
        assert (place.x_m - east, place.y_m - north) == pytest.approx((x, y), abs=1e-3)
        assert place.charger.centre == pytest.approx((place.x_m, place.y_m))


def test_the_error_of_the_plane_is_bounded() -> None:
    from pymap3d.vincenty import vdist  # type: ignore[import-untyped]

    project = Projection(ORIGIN, "test")
    for far_m, bound_m in ((1_000.0, 1e-4), (10_000.0, 5e-3), (FARTHEST_M, 0.1)):
        for turn in range(8):
            at = far_m * math.cos(turn), far_m * math.sin(turn)
            lat, lon = project.place(*at)
            assert project.point(lat, lon) == pytest.approx(at, abs=1e-3 + bound_m)
            true_m, _ = vdist(ORIGIN.lat_deg, ORIGIN.lon_deg, lat, lon)
            assert abs(float(true_m) - far_m) <= bound_m + 1e-3


@pytest.mark.parametrize("name", ["a.geojson", "a.plan", "a.kml"])
def test_a_site_where_longitudes_end_is_like_any_other(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.geometry.test_reading.ORIGIN", GeoOrigin(-17.0, 180.0))
    without_origin = geojson()
    del without_origin["origin"]
    texts: dict[str, str | dict[str, Any]] = {"a.geojson": without_origin, "a.plan": plan(), "a.kml": kml()}
    made = read(tmp_path / name, texts[name])
    assert made.plan.origin is not None
    assert made.plan.fence is not None
    assert abs(made.plan.origin.lon_deg) == pytest.approx(180.0, abs=1e-3)
    project = Projection(made.plan.origin, "test")
    east, north = project.point(*earth((0.0, 0.0)))
    for (x, y), (found_x, found_y) in zip(FENCE, made.plan.fence, strict=True):
        assert (found_x - east, found_y - north) == pytest.approx((x, y), abs=1e-3)
        assert project.point(*project.place(found_x, found_y)) == pytest.approx((found_x, found_y), abs=1e-6)


@pytest.mark.parametrize("origin", [[-170.55, -47.62], [-170.56, -47.6], [9.5, -47.6], [100.0, 0.0]])
def test_an_origin_on_the_other_side_of_the_earth_is_too_far_away(origin: list[float], tmp_path: Path) -> None:
    assert "is too far away, allowed: at most 20000 m" in refusal(
        tmp_path / "a.geojson", {**geojson(), "origin": origin}
    )


def test_whole_degrees_are_as_exact_as_others() -> None:
    project = Projection(GeoOrigin(47.0, 9.0), "test")
    assert project.point(47, 10) == project.point(47.0, 10.0)


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.name)
def test_the_shipped_worlds_are_read_and_written(path: Path, tmp_path: Path) -> None:
    made = read_workspace(path)
    assert isinstance(made, Site)
    again = read(tmp_path / "again.toml", toml(as_tables(made)))
    assert again.plan.fence == made.plan.fence
    assert [area.ring for area in again.plan.areas] == [area.ring for area in made.plan.areas]
    assert again.robots == made.robots
    if made.plan.origin is not None:
        there = read(tmp_path / "there.geojson", as_geojson(made, made.plan.origin))
        assert there.plan.fence is not None
        assert made.plan.fence is not None
        for one, other in zip(there.plan.fence, made.plan.fence, strict=True):
            assert one == pytest.approx(other, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda each: each.update(type="Feature"), "FeatureCollection"),
        (lambda each: each.update(crs={"type": "name", "properties": {"name": "EPSG:25832"}}), "WGS 84"),
        (lambda each: each["features"][1]["properties"].pop("soter"), "shed"),
        (lambda each: each["features"][1]["properties"].update(soter="keepout"), "keep_out"),
        (lambda each: each["features"][1]["geometry"].update(type="LineString"), "shed"),
        (lambda each: each["features"][1]["geometry"]["coordinates"][0].append([500000.0, 5300000.0]), "shed"),
        (lambda each: each["features"][1]["geometry"]["coordinates"][0].insert(1, [9.44, -47.6]), "shed"),
        (lambda each: each["features"][1]["geometry"]["coordinates"][0].insert(1, ["a", 1]), "shed"),
        (
            lambda each: each["features"][1]["geometry"]["coordinates"][0].insert(1, [9.5, math.nan]),
            "shed: latitude nan, longitude 9.5; allowed: finite numbers of degrees",
        ),
        (
            lambda each: each["features"][2]["geometry"].update(coordinates=[-math.inf, 47.5]),
            "feature 3: latitude 47.5, longitude -inf; allowed: finite numbers of degrees",
        ),
        (
            lambda each: each["features"][1]["properties"].update(height_m=math.nan),
            "shed: its property height_m is nan",
        ),
        (lambda each: each.update(origin=[math.nan, 1.0]), "origin: it is [nan, 1.0]; allowed: longitude and latitude"),
        (lambda each: each["features"][1]["geometry"]["coordinates"].append([[9.4, 47.6]]), "hole"),
        (lambda each: each["features"][1]["geometry"].update(coordinates=[]), "shed: it has no corners"),
        (
            lambda each: each["features"][1]["geometry"].update(type="MultiPolygon", coordinates=[]),
            "shed: it has no polygons",
        ),
        (lambda each: each["features"][1].pop("geometry"), "feature 2"),
        (lambda each: each["features"][1]["geometry"].pop("coordinates"), "shed"),
        (lambda each: each["features"][1]["geometry"]["coordinates"][0].append([]), "shed"),
        (lambda each: each["features"][1]["geometry"].update(coordinates=[9.4, 47.6]), "shed"),
        (lambda each: each["features"][1]["geometry"]["coordinates"][0].insert(1, [10**400, 1]), "digits"),
        (lambda each: each["features"].append(each["features"][0]), "outer boundaries"),
        (lambda each: each.update(origin=[200.0, 1.0]), "origin"),
        (lambda each: each.update(features=[]), "neither"),
        (lambda each: each.update(features=each["features"][:2]), "station"),
    ],
)
def test_bad_geojson_is_refused_by_feature(change: Any, said: str, tmp_path: Path) -> None:
    bad = geojson()
    change(bad)
    assert said in refusal(tmp_path / "bad.geojson", bad)


@pytest.mark.parametrize(
    ("name", "text", "key"),
    [
        ("a.geojson", json.dumps(geojson()).replace('"features": ', '"features": [], "features": '), "features"),
        ("a.geojson", json.dumps(geojson()).replace('"soter": "keep', '"soter": "fence", "soter": "keep'), "soter"),
        ("a.plan", json.dumps(plan()).replace('"geoFence": ', '"geoFence": {}, "geoFence": '), "geoFence"),
    ],
)
def test_a_key_that_is_given_twice_is_refused(name: str, text: str, key: str, tmp_path: Path) -> None:
    assert refusal(tmp_path / name, text).endswith(f": an object has its key '{key}' 2 times, allowed: once")


@pytest.mark.parametrize(
    "change",
    [
        lambda each: each["geometry"].update(coordinates=[True, 47.6]),
        lambda each: each["geometry"].update(coordinates=[9.4, False]),
        lambda each: each["geometry"].update(coordinates="x"),
        lambda each: each.update(geometry=None),
        lambda each: each["properties"].update(side_m=True),
        lambda each: each["properties"].update(side_m=-1),
        lambda each: each["properties"].update(robot=True),
        lambda each: each["properties"].update(name="north \ud800"),
    ],
)
def test_one_feature_that_is_wrong_is_all_that_is_complained_of(change: Any, tmp_path: Path) -> None:
    bad = geojson()
    change(bad["features"][2])
    said = refusal(tmp_path / "bad.geojson", bad)
    assert "feature 3: " in said
    assert "\n" not in said


def test_a_long_name_is_cut_in_messages(tmp_path: Path) -> None:
    bad = geojson()
    bad["features"][0]["properties"]["name"] = "y" * 5000
    bad["features"].append(bad["features"][0])
    assert f"2 outer boundaries ({'y' * 57}..., {'y' * 57}...)" in refusal(tmp_path / "bad.geojson", bad)
    bad["features"][1]["properties"].update(name="z" * 5000, height_m=-1)
    assert f": {'z' * 57}...: its property" in refusal(tmp_path / "bad.geojson", bad)


@pytest.mark.parametrize(
    ("properties", "said"),
    [
        ({"soter": "start", "robot": 0}, "id is 0, allowed: a whole number from 1 to 254"),
        ({"soter": "start", "heading_deg": "east"}, "its property heading_deg is 'east', allowed: a number"),
        ({"radius_m": 1e300}, "its property radius_m is 1e+300, allowed: at most 20000"),
        ({"side_m": 1e5}, "it is 100000 m wide, allowed: at most 20000 m"),
        ({"side_m": 0.01}, "it is 0.01 m wide, allowed: at least 0.1 m"),
    ],
)
def test_what_is_allowed_of_a_feature_is_said_as_it_is(properties: dict[str, Any], said: str, tmp_path: Path) -> None:
    bad = geojson()
    added = json.loads(json.dumps(bad["features"][2]))
    added["properties"].update(properties)
    bad["features"].append(added)
    assert refusal(tmp_path / "bad.geojson", bad).splitlines()[0].endswith(said)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda each: each.update(fileType="Mission"), "fileType"),
        (lambda each: each["geoFence"]["polygons"][1].update(inclusion="no"), "polygon 2"),
        (lambda each: each["geoFence"]["polygons"][0]["polygon"].insert(0, [147.0, 9.0]), "polygon 1"),
        (lambda each: each["geoFence"].update(circles=[circle(-1)]), "circle 1: its radius is -1, allowed: above 0"),
        (lambda each: each["geoFence"].update(circles=[circle(math.nan)]), "circle 1: its radius is nan"),
        (lambda each: each["geoFence"].update(circles=[circle(1e300)]), "1e+300, allowed: above 0, at most 20000, in"),
        (
            lambda each: each["geoFence"]["polygons"][1]["polygon"].insert(0, [math.nan, 9.5]),
            "geoFence polygon 2: latitude nan, longitude 9.5; allowed: finite numbers of degrees",
        ),
        (lambda each: each["geoFence"].update(version=1), "geoFence.version: it is 1, allowed: 2, as QGroundControl"),
        (lambda each: each.update(geoFence=[]), "geoFence"),
        (lambda each: each.update(mission=5), "mission: it is 5, allowed: an object"),
        (lambda each: each["geoFence"].update(polygons=5), "polygons: it is 5, allowed: a list"),
        (
            lambda each: each["geoFence"]["polygons"][1].update(polygon=5),
            "geoFence polygon 2: its polygon is 5, allowed: a list",
        ),
        (lambda each: each.update(rallyPoints={"points": []}), "station"),
    ],
)  # fmt: skip
def test_bad_plans_are_refused_by_feature(change: Any, said: str, tmp_path: Path) -> None:
    bad = plan()
    change(bad)
    assert said in refusal(tmp_path / "bad.plan", bad)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<kml><Document>", "well-formed"),
        ("<gpx/>", "kml"),
        ('<!DOCTYPE kml [<!ENTITY a "b">]><kml/>', "refused"),
        (kml(fence="yard"), "fence"),
        (kml().replace("9.4", "a9.4", 1), "fence"),
        (kml().replace(f">{earth(FENCE[0])[1]:.9f},", ">nan,", 1), "longitude nan; allowed: finite numbers of degrees"),
        (
            kml().replace("</LinearRing></outer", "</LinearRing><LinearRing><coordinates/></LinearRing></outer", 1),
            "fence: a <outerBoundaryIs> has 2 lists of coordinates, allowed: one",
        ),
        (
            kml().replace("</coordinates>", "</coordinates><coordinates>9,47 9,48 8,47</coordinates>", 1),
            "fence: a <outerBoundaryIs> has 2 lists of coordinates, allowed: one",
        ),
        (kml().replace(",0 ", ",0 <x/>", 1), "fence: there is a <x> among its coordinates, allowed: text"),
        (
            kml().replace("<Placemark><name>shed", f"{POND.format('LineString')}<Placemark><name>shed"),
            "pond: it has places in a <LineString>, allowed: in the boundaries of a Polygon, and in a Point",
        ),
        (
            kml().replace("<Placemark><name>shed", f"{POND.format('LinearRing')}<Placemark><name>shed"),
            "pond: it has places in a <LinearRing>, allowed: in the boundaries of a Polygon, and in a Point",
        ),
        (kml().replace("outerBoundaryIs", "outer", 4), "fence: it has places in a <LinearRing>, allowed: in the bound"),
    ],
)
def test_bad_kml_is_refused(text: str, said: str, tmp_path: Path) -> None:
    assert said in refusal(tmp_path / "bad.kml", text)


def test_comments_among_coordinates_and_holes_in_one_element_are_read(tmp_path: Path) -> None:
    def hole(x: float) -> str:
        text = " ".join(f"{lon:.9f},{lat:.9f}" for lat, lon in map(earth, [(x, 0.0), (x + 1.0, 0.0), (x, 1.0)]))
        return f"<LinearRing><coordinates>{text}</coordinates></LinearRing>"

    holes = f"</outerBoundaryIs><innerBoundaryIs>{hole(-9.0)}{hole(-6.0)}</innerBoundaryIs>"
    made = read(
        tmp_path / "a.kml", kml().replace("</outerBoundaryIs>", holes, 1).replace(",0 ", ",0 <!-- gate --> ", 1)
    )
    assert made.plan.fence is not None
    assert len(made.plan.fence) == len(FENCE)
    assert [area.name for area in made.plan.areas] == ["fence, hole 1", "fence, hole 2", "shed"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[fence", "TOML"),
        (
            f'a = """\n{"b." * 20}c"""\n{"b." * 19}"d e" . c = 1',
            ":3: tables or lists are nested too deeply, allowed: at",
        ),
        (f"[{'b.' * 20}c]", ":1: tables or lists are nested too deeply, allowed: at most 20 levels"),
        ("[fence]\npolygon = [[0, 0], [1, 0]]\ncircle = {x_m = 0.0, y_m = 0.0, radius_m = 1.0}", "one of"),
        ("[fence]\ncircle = {x_m = 0.0, y_m = nan, radius_m = 1.0}", "finite"),
        ("[fence]\ncircle = {x_m = 0.0, y_m = 0.0, radius = 1.0}", "radius_m"),
        ("[[keep_out]]\npolygon = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]", "keep_out 1"),
        ("[fence]\npolygon = [[0.0, 0.0], [30000.0, 0.0], [0.0, 1.0]]", "20000"),
        (
            "[fence]\npolygon = [[0.0, 0.0, 2.5], [3.0, 0.0], [0.0, 1.0]]",
            ":2: fence.polygon.0: it is [0.0, 0.0, 2.5], allowed: two numbers; a corner is x and y",
        ),
    ],
)
def test_bad_toml_is_refused_by_key(text: str, said: str, tmp_path: Path) -> None:
    assert said in refusal(tmp_path / "bad.toml", text)


DOTS = "b." * 200 + "c = 1"


@pytest.mark.parametrize("text", [f'"{DOTS}"', f"'{DOTS}'", f'"""\n{DOTS}\n\\""" "\n{DOTS}"""', f"'''\n{DOTS}''''"])
def test_texts_and_comments_of_toml_may_have_many_dots(text: str, tmp_path: Path) -> None:
    whole = f"# {DOTS}\n[[keep_out]]\nname = {text} # {DOTS}\ncircle = {{ x_m = 5.5, y_m = 5.5, radius_m = 0.5 }}\n"
    made = read(tmp_path / "a.toml", f"{whole}[[station]]\nx_m = 0.0\ny_m = 0.0")
    assert DOTS in made.plan.areas[0].name


def test_a_file_that_is_too_long_needs_fewer_corners(tmp_path: Path) -> None:
    assert refusal(tmp_path / "long.geojson", " " * 1_000_001).endswith(
        "this workspace file is longer than 1000000 bytes, the most that is read; simplify its polygons to fewer "
        "corners"
    )
