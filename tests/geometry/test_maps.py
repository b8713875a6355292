"""Maps as workspaces: distances against shapely, what files say, what is refused, and where ways lead."""

from __future__ import annotations

import json
import math
import random
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely  # type: ignore[import-untyped]
from numpy.typing import NDArray
from PIL import Image

from soter.config import load_mission
from soter.errors import ConfigError
from soter.geometry.cells import merged, pack
from soter.geometry.clearance import EXACT_CELLS, Field
from soter.geometry.draft import Spot
from soter.geometry.grid import GridMap
from soter.geometry.reading import read_workspace
from soter.geometry.site import Site, SitePlan
from soter.geometry.writing import as_tables
from soter.record.foxglove import workspace_scene
from soter.stack.routes import Routes
from soter.stack.site_terrain import terrain_of
from soter_sim.boxes import obstacles_of
from tests.geometry.slam import FREE, OCCUPIED, UNKNOWN

EXAMPLES = Path(__file__).parents[2] / "examples" / "worlds"
HEAD = {"resolution": 0.5, "origin": [10.0, -20.0, 0.0], "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.25}


def grid(seed: int, *, side: int = 60, share: float = 0.01, cell_m: float = 0.05) -> GridMap:
    """Return a map with boxes and specks, somewhere, at an angle."""
    stream = np.random.default_rng(seed)
    occupied = stream.random((side, side + 10)) < share
    for _ in range(4):
        row, column, high, wide = stream.integers(0, side, 4)
        occupied[row : row + high // 4, column : column + wide // 4] = True
    x, y = stream.uniform(-9000.0, 9000.0, 2)
    return GridMap(side + 10, side, cell_m, float(x), float(y), float(stream.uniform(-3.0, 3.0)), pack(occupied))


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_exact_near_and_lower_bounds_far(seed: int) -> None:
    made, stream = grid(seed, share=(0.0, 0.001, 0.01, 0.1)[seed], side=80), random.Random(seed)
    field = Field(made)
    kept = shapely.union_all([shapely.Polygon(ring) for ring in made.rings()])
    shapely.prepare(kept)
    lines = []
    for _ in range(60):
        u, v = stream.uniform(0.0, made.columns), stream.uniform(0.0, made.rows)
        a = made.corner(u, v)
        b = made.corner(stream.uniform(0.0, made.columns), stream.uniform(0.0, made.rows))
        c = made.corner(u + stream.gauss(0.0, 2.0), v + stream.gauss(0.0, 2.0))
        true_m, found_m = kept.distance(shapely.Point(a)), field.distance_m(*a)
        if true_m >= EXACT_CELLS * made.cell_m:
            assert EXACT_CELLS * made.cell_m - 1e-9 <= found_m <= true_m + 1e-9
            assert found_m >= 0.7 * true_m - made.cell_m
        elif true_m > 0.0:
            assert found_m == pytest.approx(true_m, abs=1e-8)
        else:
            assert -0.5 * made.cell_m <= found_m <= 1e-9
        # It changes by a metre a metre at most.
        assert abs(found_m - field.distance_m(*c)) <= math.dist(a, c) + 1e-9
        true_m, enough_m = kept.distance(shapely.LineString([a, b])), stream.uniform(0.05, 1.0)
        assert max(field.segment_m(*a, *b, enough_m), 0.0) == pytest.approx(min(true_m, enough_m), abs=1e-8)
        assert field.segment_m(*a, *b) <= true_m + 1e-9
        # A line that keeps its distance is not nearer by rounding: who asks compares with the same number.
        assert (field.segment_m(*a, *b, enough_m) >= enough_m) == (true_m >= enough_m)
        assert field.line_keeps(*a, *b, enough_m) == (true_m >= enough_m)
        assert field.keeps(*a, enough_m) == (kept.distance(shapely.Point(a)) >= enough_m)
        if abs(true_m - 0.2) > 1e-6:
            lines.append((a, b, true_m > 0.2))
        walls = field.walls(*a, 0.5)
        assert min((away for away, _, _ in walls), default=0.5) <= max(field.distance_m(*a), 0.0) + 1e-8 or not walls
    starts, ends = (np.array([line[end] for line in lines]) for end in (0, 1))
    assert field.lines_keep(starts, ends, 0.2).tolist() == [line[2] for line in lines]


@pytest.mark.parametrize("needed_m", [0.07, 0.3, 1.0, 2.5])
def test_many_lines_across_a_large_map_keep_what_each_of_them_does(needed_m: float) -> None:
    made, stream = grid(5, side=400, share=0.0002), random.Random(5)
    field = Field(made)
    places = [made.corner(stream.uniform(-40.0, 450.0), stream.uniform(-40.0, 440.0)) for _ in range(300)]
    kept = [field.line_keeps(*a, *b, needed_m) for a, b in pairwise(places)]
    assert field.lines_keep(np.array(places[:-1]), np.array(places[1:]), needed_m).tolist() == kept
    assert 0 < sum(kept) < len(kept)


def test_beside_the_map_nothing_is_nearer_than_what_is_in_it() -> None:
    made = grid(3)
    field, kept = Field(made), shapely.union_all([shapely.Polygon(ring) for ring in made.rings()])
    for u, v in ((-7.0, 12.0), (80.0, 70.0), (20.0, -300.0)):
        at = made.corner(u, v)
        assert 0.0 < field.distance_m(*at) <= kept.distance(shapely.Point(at)) + 1e-9
        assert field.segment_m(*at, *made.corner(30.0, 30.0)) <= field.distance_m(*at)


@pytest.mark.parametrize("seed", range(3))
def test_simulated_robots_have_the_same_obstacles(seed: int) -> None:
    made, stream = grid(seed), random.Random(seed)
    field, world = Field(made), obstacles_of(Site(SitePlan(made.ring(0, 0, 70, 60), (), (), (), map=made)))
    for _ in range(100):
        at = made.corner(stream.uniform(0.0, 70.0), stream.uniform(0.0, 60.0))
        true_m = min(world.point_to(*at, box) for box in world.near(*at))
        assert max(true_m, 0.0) == pytest.approx(max(field.distance_m(*at), 0.0), abs=1e-8)


def test_rectangles_are_the_cells() -> None:
    occupied = np.random.default_rng(1).random((30, 40)) < 0.5
    again = np.zeros((30, 40), dtype=int)
    for low_column, low_row, high_column, high_row in merged(occupied).tolist():
        again[low_row:high_row, low_column:high_column] += 1
    assert (again == occupied).all()


def test_the_eye_gets_no_more_than_it_can_use() -> None:
    occupied = np.random.default_rng(1).random((150, 151)) < 0.4
    made = GridMap(151, 150, 1.0, 0.0, 0.0, 0.0, pack(occupied))
    seen = np.zeros_like(occupied)
    for (west, south), _, (east, north), _ in made.outlines():
        seen[round(south) : round(north), round(west) : round(east)] = True
    assert len(made.rings()) > 4000 >= len(made.outlines())
    assert seen[occupied].all()


def test_a_way_leads_wherever_cells_do() -> None:
    walls = np.zeros((80, 120), dtype=np.bool_)
    walls[:, 39:41] = walls[:, 79:81] = True
    walls[10:24, 39:41] = walls[56:70, 79:81] = False  # doors of 0.7 m
    made = GridMap(120, 80, 0.05, -400.0, 90.0, 0.7, pack(walls))
    site = Site(SitePlan(made.ring(0, 0, 120, 80), (), (), (), map=made))
    routes = Routes(terrain_of(site, 0.105), made.corner(20.0, 70.0), 0.15, 0.1)
    kept = shapely.union_all([shapely.Polygon(ring) for ring in made.rings()])
    for u, v in ((100.0, 10.0), (60.0, 40.0), (110.0, 70.0), (12.0, 9.0)):
        at = made.corner(u, v)
        way = [at, *routes.legs(*at)]
        assert way[-1] == routes.place
        assert kept.distance(shapely.LineString(way)) >= 0.105 + 0.15 - 1e-6
        assert routes.distance_m(*at) == pytest.approx(sum(math.dist(*leg) for leg in pairwise(way)))
    # Past the edges of the two doors it is 8.5 m.
    assert routes.distance_m(*made.corner(100.0, 10.0)) < 1.2 * 8.5
    closed = GridMap(120, 80, 0.05, 0.0, 0.0, 0.0, pack(walls | (np.arange(120) == 40)))
    beyond = Site(SitePlan(closed.ring(0, 0, 120, 80), (), (), (), map=closed))
    assert Routes(terrain_of(beyond, 0.105), (1.0, 3.5), 0.15, 0.1).distance_m(5.0, 0.5) == math.inf


def test_the_nearest_free_place_is_free() -> None:
    made = grid(2, side=200, share=0.0)
    field = Field(made)
    site = Site(SitePlan(made.ring(0, 0, made.columns, made.rows), (), (), (), map=made))
    for row, column in np.argwhere(made.occupied())[::97].tolist():
        at = site.nearest_free(*made.corner(column + 0.5, row + 0.5), 0.3)
        assert at is not None
        assert site.contains(*at)
        assert field.distance_m(*at) >= 0.3
    everywhere = Field(GridMap(9, 9, 1.0, 0.0, 0.0, 0.0, pack(np.ones((9, 9), dtype=np.bool_))))
    assert everywhere.nearest_free(4.0, 4.0, 0.1) is None


# --- files -------------------------------------------------------------------------------------------------


def written(folder: Path, picture: Any = None, name: str = "map.pgm", **more: Any) -> Path:
    """Write a map of JSON, which is YAML, and its picture: free, with a wall around, a dark and a grey cell."""
    if picture is None:
        picture = np.full((12, 16), FREE, dtype=np.uint8)
        picture[0] = picture[-1] = picture[:, 0] = picture[:, -1] = OCCUPIED
        picture[2, 3], picture[9, 12] = OCCUPIED, UNKNOWN
    if isinstance(picture, bytes):
        (folder / name).write_bytes(picture)
    else:
        (picture if isinstance(picture, Image.Image) else Image.fromarray(picture)).save(folder / name)
    path = folder / "map.yaml"
    path.write_text(json.dumps({"image": name, **HEAD, **more}))
    return path


def cells(path: Path) -> NDArray[np.bool_]:
    """Return which cells are occupied, the southernmost row first."""
    made = read_workspace(path, inhabited=False)
    assert isinstance(made, Site)
    assert made.plan.map is not None
    return made.plan.map.occupied()


def test_pictures_are_seen_from_above_and_begin_in_the_north(tmp_path: Path) -> None:
    made = read_workspace(written(tmp_path), inhabited=False)
    assert made.bounds == pytest.approx((10.0, -20.0, 18.0, -14.0))
    assert made.clearance_m(10.0 + 3.5 * 0.5, -14.0 - 2.5 * 0.5, 0.0) < 0.0
    assert made.clearance_m(10.0 + 12.5 * 0.5, -14.0 - 9.5 * 0.5, 0.0) < 0.0
    assert made.clearance_m(14.0, -17.0, 0.0) == pytest.approx(math.hypot(2.0, 1.5))
    turned = read_workspace(written(tmp_path, origin=[10.0, -20.0, math.pi / 2]), inhabited=False)
    assert turned.bounds == pytest.approx((4.0, -20.0, 10.0, -12.0))


def test_what_is_dark_is_occupied_and_what_is_grey_unknown(tmp_path: Path) -> None:
    known = cells(written(tmp_path))
    assert known[12 - 1 - 2, 3]
    assert known[12 - 1 - 9, 12]
    assert cells(written(tmp_path, unknown="free")).sum() == known.sum() - 1
    assert (cells(written(tmp_path, name="map.png")) == known).all()
    # In a scale, grey is occupied to some part, and only what is transparent is unknown.
    assert (cells(written(tmp_path, mode="scale", unknown="free", free_thresh=0.19)) == known).all()
    picture = np.zeros((12, 16, 2), dtype=np.uint8)
    picture[..., 0], picture[..., 1] = FREE, 255
    picture[3, 3] = FREE, 0
    transparent = Image.fromarray(picture)
    assert cells(written(tmp_path, transparent, "map.png", mode="scale")).sum() == 1
    assert cells(written(tmp_path, transparent, "map.png", mode="scale", unknown="free")).sum() == 0
    negative = 255 - np.array(Image.open(written(tmp_path).with_name("map.pgm")))
    assert (cells(written(tmp_path, negative, negate=1)) == known).all()


def test_pictures_of_many_kinds(tmp_path: Path) -> None:
    known = cells(written(tmp_path))
    grey = Image.open(tmp_path / "map.pgm").copy()
    values = np.array(grey)
    for picture, name in (
        (grey.convert("RGB"), "a.png"), (grey.convert("RGBA"), "b.png"), (grey.convert("P"), "c.png"),
        (Image.fromarray(values.astype(np.uint16) * 257), "d.png"),
    ):  # fmt: skip
        assert (cells(written(tmp_path, picture, name)) == known).all()
    plain = f"P2 # as text\n16 12\n255\n{' '.join(map(str, values.ravel()))}\n".encode()
    wide = b"P5 16 12 65535\n" + (values.astype(">u2") * 257).tobytes()
    for data in (plain, wide):
        assert (cells(written(tmp_path, data)) == known).all()


ALL_UNKNOWN = np.full((9, 9), UNKNOWN, dtype=np.uint8)


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("image", {"image": "none.pgm"}),
        ("image", {"image": "."}),
        ("image", {"image": ""}),
        ("image", {"picture": ALL_UNKNOWN}),
        ("image", {"picture": b"P5 16 12 255\n" + bytes(100)}),
        ("image", {"picture": b"P5 60000 60000 255\n"}),
        ("image", {"picture": b"P5 16 2 255\n" + bytes(32)}),
        ("image", {"picture": b"P5 16 12 0\n" + bytes(192)}),
        ("image", {"picture": b"Pf 16 12 -1.0\n" + bytes(768)}),
        ("image", {"picture": b"GIF89a"}),
        ("image", {"picture": b""}),
        ("resolution", {"resolution": 0.0}),
        ("resolution", {"resolution": -0.05}),
        ("resolution", {"resolution": "fine"}),
        ("resolution", {"resolution": math.nan}),
        ("origin", {"origin": [0.0, 0.0]}),
        ("origin.0", {"origin": [math.inf, 0.0, 0.0]}),
        ("origin.1", {"origin": [0.0, 1e6, 0.0]}),
        ("origin.2", {"origin": [0.0, 0.0, 90.0]}),
        ("origin.2", {"origin": [0.0, 0.0, math.nan]}),
        ("occupied_thresh", {"occupied_thresh": 1.5}),
        ("free_thresh", {"free_thresh": -0.1}),
        ("free_thresh", {"free_thresh": 0.65}),
        ("negate", {"negate": 2}),
        ("mode", {"mode": "raw"}),
        ("unknown", {"unknown": "maybe"}),
        ("colour", {"colour": 1}),
        ("edge of the map", {"origin": [19_999.0, 0.0, 0.0]}),
    ],
)
def test_bad_maps_are_refused_by_key(key: str, change: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        read_workspace(written(tmp_path, **change), inhabited=False)
    assert str(tmp_path / "map.yaml") in str(refused.value)
    assert key in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"free_thresh": 0.65}, "free_thresh is 0.65, allowed: below occupied_thresh, which is 0.65"),
        ({"negate": 2}, "negate: it is 2, allowed: at most 1"),
        ({"negate": "no"}, "negate: it is 'no', allowed: a whole number"),
        ({"origin": [0.0, 0.0, 0.0, 1.0]}, "origin: it is [0.0, 0.0, 0.0, 1.0], allowed: at most 3 of them"),
    ],
)
def test_what_is_allowed_of_a_map_is_said_once(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        read_workspace(written(tmp_path, **change), inhabited=False)
    assert str(refused.value) == f"{tmp_path / 'map.yaml'}: {said}"


def test_numbers_may_be_written_as_ros_takes_them(tmp_path: Path) -> None:
    file = written(tmp_path)
    before = cells(file)
    file.write_text(file.read_text().replace('"resolution": 0.5', '"resolution": 5e-1'))
    assert "5e-1" in file.read_text()
    assert np.array_equal(cells(file), before)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("!!bool maybe", "'maybe' is no bool"),
        ("!!int ''", "'' is no int"),
        ("!!float ''", "'' is no float"),
        ("!!timestamp abc", "'abc' is no timestamp"),
        ("1:30", "'1:30' is no int"),
        ("1:30.5", "'1:30.5' is no float"),
    ],
)
def test_a_value_that_does_not_fit_its_tag_is_refused_with_its_line(value: str, said: str, tmp_path: Path) -> None:
    file = written(tmp_path)
    file.write_text(file.read_text().replace('"negate": 0', f'\n"negate": {value}'))
    with pytest.raises(ConfigError) as refused:
        read_workspace(file, inhabited=False)
    assert str(refused.value) == f"{file}:2: {said} that is read, allowed: plain numbers and texts"


def test_a_key_that_is_given_twice_is_refused_with_its_line(tmp_path: Path) -> None:
    file = written(tmp_path)
    file.write_text(file.read_text().replace("{", '{"resolution": 5.0,\n', 1))
    with pytest.raises(ConfigError, match=r"map.yaml:2: resolution: it is given twice"):
        read_workspace(file, inhabited=False)


def test_values_from_elsewhere_in_a_map_are_refused_before_they_multiply(tmp_path: Path) -> None:
    file = tmp_path / "map.yaml"
    names = "abcd"
    lists = [f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]" for before, name in pairwise(names)]
    file.write_text("\n".join(["image: map.pgm", "a: &a [0, 0]", *lists]))
    with pytest.raises(ConfigError) as refused:
        read_workspace(file, inhabited=False)
    assert str(refused.value) == (
        f"{file}:3: *a stands for a value from elsewhere in the file; allowed: the value itself"
    )


@pytest.mark.parametrize(
    "text", ["", "- 1", "image: [", "a: &a [*a]", "\0", "[" * 400, "image: !!python/name:os.system"]
)
def test_what_is_no_map_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(ConfigError):
        read_workspace(tmp_path / "map.yaml")


def test_the_mission_says_where_stations_are_in_a_map(tmp_path: Path) -> None:
    map_, stations = written(tmp_path), [Spot("station 1", 12.0, -16.5), Spot("station 2", 15.0, -17.0)]
    with pytest.raises(ConfigError, match="station"):
        read_workspace(map_)
    made = read_workspace(map_, stations=stations, starts=[Spot("robot 7", 14.0, -16.0, 7, 1.0)])
    (robot,) = made.robots
    assert (robot.id, robot.x_m, robot.heading_rad, robot.charger.centre) == (7, 14.0, 1.0, (12.0, -16.5))
    with pytest.raises(ConfigError, match=r"start of robot 1.*a free place is"):
        read_workspace(map_, stations=[Spot("station 1", 11.7, -15.2)])
    for other in ("l-hall.toml", "park.kml"):
        with pytest.raises(ConfigError, match="station"):
            read_workspace(EXAMPLES / other, stations=stations)
    with pytest.raises(ConfigError, match="station"):
        read_workspace(EXAMPLES.parent / "surveillance.xml", stations=stations)


def test_a_station_of_the_mission_is_blamed_on_the_mission(tmp_path: Path) -> None:
    map_ = written(tmp_path)
    file = tmp_path / "office.toml"
    file.write_text(
        f'workspace = "{map_.name}"\n\n[[station]]\nx_m = 15.0\ny_m = -17.0\n\n[[station]]\nx_m = 11.7\ny_m = -15.2\n'
        "[[start]]\nid = 1\nx_m = 15.0\ny_m = -17.0\n[[start]]\nid = 2\nx_m = 14.0\ny_m = -16.0\n"
    )
    with pytest.raises(ConfigError) as refusal:
        load_mission(file).read_workspace()
    assert (refusal.value.source, refusal.value.line) == (str(file), 7)
    assert refusal.value.key == "charging station of robot 2"
    with pytest.raises(ConfigError) as refusal:
        load_mission(file, {"start": [{"id": n, "x_m": 11.7, "y_m": -15.2} for n in (1, 2)]}).read_workspace()
    assert f"{file}:7: charging station of robot 2: " in str(refusal.value)
    assert "command line: start of robot 1: " in str(refusal.value)
    assert "command line: start of robot 2: " in str(refusal.value)


def test_the_shipped_map_is_a_workspace_that_is_written_down_and_drawn() -> None:
    made = load_mission(EXAMPLES / "flat-patrol.toml").read_workspace()
    assert isinstance(made, Site)
    assert len(made.robots) == 4
    assert made.with_robots(2).field is made.field
    assert len(workspace_scene(made).entities[0].lines) > 100
    with pytest.raises(ConfigError, match="map"):
        as_tables(made)


@pytest.mark.parametrize(
    "change",
    [{"packed": "?"}, {"packed": "eJw="}, {"columns": 9}, {"rows": 10**6}, {"packed": pack(np.ones((1, 8), bool))}],
)
def test_cells_that_are_not_those_of_a_map(change: dict[str, Any]) -> None:
    good: dict[str, Any] = {"columns": 16, "rows": 4, "packed": pack(np.zeros((4, 16), dtype=np.bool_))}
    assert not GridMap(cell_m=0.1, x_m=0.0, y_m=0.0, yaw_rad=0.0, **good).occupied().any()
    with pytest.raises(ValueError, match="cells"):
        GridMap(cell_m=0.1, x_m=0.0, y_m=0.0, yaw_rad=0.0, **{**good, **change}).occupied()
    with pytest.raises(ValueError, match="cells"):
        GridMap(16, 4, 0.0, 0.0, 0.0, 0.0, "")
