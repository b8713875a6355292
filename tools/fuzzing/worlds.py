"""Workspace files of every format, spoilt, and what may not be accepted of them."""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from pathlib import Path
from typing import Final

import shapely  # type: ignore[import-untyped]
from PIL import Image

from soter.geometry.draft import Spot
from soter.geometry.grid import GridMap
from soter.geometry.reading import read_workspace
from soter.geometry.workspace import Workspace
from soter.geometry.workspace_xml import BODY_RADIUS_M

WORLDS: Final = Path(__file__).resolve().parents[2] / "examples" / "worlds"
_PHI_SAFER_M: Final = 0.1
_MOST_BYTES: Final = 5000
"""Larger files take too long to read a hundred thousand times."""

_FAR_M: Final = 30_000.0
_MAP: Final = b"""image: map.pgm
mode: trinary
resolution: 0.1
origin: [-2.5, 3.0, 0.4]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
_PICTURE: Final = 40
"""So many pixels wide and high is the picture that is spoilt."""


def seeds(name: str) -> tuple[bytes, ...]:
    """Return good files of a format: `site.toml`, `geojson`, `plan`, `kml`, `map.yaml`, `pgm` or `png`."""
    if name == "map.yaml":
        return _MAP, _MAP + b"unknown: free\n", _MAP.replace(b"trinary", b"scale")
    if name in ("pgm", "png"):
        return tuple(_pictures(name))
    found = [path.read_bytes() for path in sorted(WORLDS.glob(f"*.{name.removeprefix('site.')}"))]
    return tuple(data for data in found if len(data) < _MOST_BYTES and b"workspace =" not in data)


def reader(name: str, folder: Path) -> Callable[[bytes], None]:
    """Return what reads a file of a format as a workspace, and raises an `AssertionError` if it is unsafe."""
    spots = [Spot("station 1", *_place(8.0, 8.0)), Spot("station 2", *_place(30.0, 30.0))]

    def read(data: bytes) -> None:
        path = folder / f"world.{name.removeprefix('site.').removeprefix('map.')}"
        path.write_bytes(data)
        if name == "map.yaml":
            (folder / "map.pgm").write_bytes(seeds("pgm")[0])
        elif name in ("pgm", "png"):
            path = folder / "map.yaml"
            path.write_bytes(_MAP.replace(b"map.pgm", f"world.{name}".encode()))
        check(read_workspace(path, phi_safer_m=_PHI_SAFER_M, stations=spots if path.suffix == ".yaml" else ()))

    return read


def check(made: Workspace) -> None:
    """Raise an `AssertionError` unless robots have room where they start and charge, as shapely sees it."""
    fence, kept_out = made.outlines()
    shapes = [shapely.Polygon(ring) for ring in kept_out]
    assert all(shape.is_valid for shape in shapes), "an area crosses itself"
    assert made.robots, "it has no robots"
    assert len({place.id for place in made.robots}) == len(made.robots), "two robots have the same number"
    for place in made.robots:
        for at in ((place.x_m, place.y_m), place.charger.centre):
            point = shapely.Point(at)
            assert max(map(abs, at)) < _FAR_M, f"{at} is far away"
            assert fence is None or shapely.Polygon(fence).buffer(1e-9).covers(point), f"{at} is outside"
            near_m = min((shape.distance(point) for shape in shapes), default=1.0) - BODY_RADIUS_M
            assert near_m >= _PHI_SAFER_M, f"{at} is {near_m:.3f} m from what is kept out"


def _pictures(name: str) -> list[bytes]:
    stream = random.Random(1)
    cells = [254 if stream.random() < 0.99 else stream.choice((0, 205)) for _ in range(_PICTURE * _PICTURE)]
    for row in range(_PICTURE):
        for column in range(_PICTURE):
            if min(row, column, _PICTURE - 1 - row, _PICTURE - 1 - column) < 2:
                cells[row * _PICTURE + column] = 0
            if min(abs(row - 9) + abs(column - 30), abs(row - 31) + abs(column - 8)) < 8:
                cells[row * _PICTURE + column] = 254
    picture = Image.new("L", (_PICTURE, _PICTURE))
    picture.putdata(cells)
    found = []
    for mode in ("L", "RGB") if name == "pgm" else ("L", "RGBA", "P", "1", "I;16"):
        out = io.BytesIO()
        picture.convert(mode).save(out, "PPM" if name == "pgm" else "PNG")
        found.append(out.getvalue())
    return found


def _place(column: float, row: float) -> tuple[float, float]:
    return GridMap(_PICTURE, _PICTURE, 0.1, -2.5, 3.0, 0.4, "").corner(column, row)


NAMES: Final = ("site.toml", "geojson", "plan", "kml", "map.yaml", "pgm", "png")
