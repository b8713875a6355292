"""Rooms as plain numbers, and their workspace files; independent of SOTER's own reader."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import shapely  # type: ignore[import-untyped]
from defusedxml.ElementTree import parse

BOX_HEIGHT_M: Final = 1.0

Ring = tuple[tuple[float, float], ...]
"""Corners of a polygon in order, counter-clockwise, in metres."""


@dataclass(frozen=True)
class Patch:
    """An axis-aligned rectangle, seen from above: a box, or a charging station. In metres east (x) and north (y)."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float

    @property
    def centre(self) -> tuple[float, float]:
        """The middle, metres."""
        return (self.low_x + self.high_x) / 2.0, (self.low_y + self.high_y) / 2.0

    @property
    def ring(self) -> Ring:
        """Its corners, the first one in the south-west."""
        return (
            (self.low_x, self.low_y), (self.high_x, self.low_y), (self.high_x, self.high_y), (self.low_x, self.high_y),
        )  # fmt: skip


@dataclass(frozen=True)
class Start:
    """The start of one robot: its id, metres east and north, radians."""

    id: int
    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class DrawnRoom:
    """A fence, boxes, starts, and as many stations, in the order of the robots.

    A room with a fence from the origin and boxes along the axes is written as XML, any other as TOML.
    """

    fence: Ring
    robots: tuple[Start, ...]
    stations: tuple[Patch, ...]
    boxes: tuple[Ring, ...] = ()

    @property
    def inside(self) -> shapely.Polygon:
        """The area inside the fence."""
        return shapely.Polygon(self.fence)

    @property
    def kept_out(self) -> shapely.Geometry:
        """The area of the boxes."""
        return shapely.union_all([shapely.Polygon(box) for box in self.boxes])

    def only(self, kept: Sequence[int]) -> DrawnRoom:
        """Return the room with only the robots and stations at these indices."""
        robots, stations = tuple(self.robots[at] for at in kept), tuple(self.stations[at] for at in kept)
        return replace(self, robots=robots, stations=stations)

    def write(self, folder: Path) -> str:
        """Write the workspace file into a folder; return its name."""
        fence, boxes = patch_of(self.fence), [patch_of(box) for box in self.boxes]
        if fence is None or fence.ring[0] != (0.0, 0.0) or None in boxes:
            name, text = "workspace.toml", self._toml()
        else:
            name, text = "workspace.xml", self._xml(fence, [box for box in boxes if box])
        (folder / name).write_text(text, encoding="utf-8")
        return name

    def _xml(self, fence: Patch, boxes: Sequence[Patch]) -> str:
        lines = ["<configuration>", f'  <dimension x="{fence.high_x!r}" y="{fence.high_y!r}" z="1"/>', "  <robots>"]
        for start in self.robots:
            place = f'<start x="{start.x!r}" y="{start.y!r}" heading="{start.heading!r}"/>'
            lines.append(f'    <robot id="{start.id}">{place}</robot>')
        lines += ["  </robots>", "  <obstacles>"]
        lines += [_box(box, BOX_HEIGHT_M) for box in boxes]
        lines += ["  </obstacles>", "  <charging_stations>"]
        lines += [_box(station, 0.0) for station in self.stations]
        return "\n".join([*lines, "  </charging_stations>", "</configuration>", ""])

    def _toml(self) -> str:
        tables = [f"[fence]\npolygon = {_toml_ring(self.fence)}\n"]
        tables += [f"[[keep_out]]\npolygon = {_toml_ring(box)}\n" for box in self.boxes]
        for station in self.stations:
            x, y, side = (round(value, 7) for value in (*station.centre, station.high_x - station.low_x))
            tables.append(f"[[station]]\nx_m = {x!r}\ny_m = {y!r}\nside_m = {side!r}\n")
        for start in self.robots:
            place = f"x_m = {start.x!r}\ny_m = {start.y!r}\nheading_rad = {start.heading!r}"
            tables.append(f"[[robot]]\nid = {start.id}\n{place}\n")
        return "\n".join(tables)

    @classmethod
    def read(cls, path: Path) -> DrawnRoom:
        """Read a workspace file this package wrote, with its own reader (independent of SOTER's)."""
        return cls._read_toml(path) if path.suffix == ".toml" else cls._read_xml(path)

    @classmethod
    def _read_xml(cls, path: Path) -> DrawnRoom:
        root = parse(path).getroot()
        assert root is not None
        size = next(root.iterfind("dimension")).attrib
        robots = []
        for robot in root.iterfind("robots/robot"):
            start = next(robot.iterfind("start")).attrib
            heading = float(start.get("heading", 0.0))
            robots.append(Start(int(robot.attrib["id"]), float(start["x"]), float(start["y"]), heading))
        patches = {
            tag: tuple(
                Patch(*(float(next(box.iterfind(corner)).attrib[axis]) for corner in ("low", "high") for axis in "xy"))
                for box in root.iterfind(f"{tag}/box")
            )
            for tag in ("obstacles", "charging_stations")
        }
        fence = Patch(0.0, 0.0, float(size["x"]), float(size["y"]))
        boxes = tuple(box.ring for box in patches["obstacles"])
        return cls(fence.ring, tuple(robots), patches["charging_stations"], boxes)

    @classmethod
    def _read_toml(cls, path: Path) -> DrawnRoom:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        stations = []
        for station in tables["station"]:
            x, y, half = station["x_m"], station["y_m"], station["side_m"] / 2.0
            stations.append(Patch(*(round(corner, 6) for corner in (x - half, y - half, x + half, y + half))))
        return cls(
            tuple(map(tuple, tables["fence"]["polygon"])),
            tuple(Start(each["id"], each["x_m"], each["y_m"], each["heading_rad"]) for each in tables["robot"]),
            tuple(stations),
            tuple(tuple(map(tuple, each["polygon"])) for each in tables.get("keep_out", ())),
        )


def patch_of(ring: Ring) -> Patch | None:
    """Return the rectangle along the axes with these corners; None if they are not those of one."""
    found = Patch(*shapely.Polygon(ring).bounds)
    return found if found.ring == ring else None


def _toml_ring(ring: Ring) -> str:
    return f"[{', '.join(f'[{x!r}, {y!r}]' for x, y in ring)}]"


def _box(patch: Patch, height_m: float) -> str:
    low, high = f'x="{patch.low_x!r}" y="{patch.low_y!r}"', f'x="{patch.high_x!r}" y="{patch.high_y!r}"'
    return f'    <box><low {low} z="0"/><high {high} z="{height_m:g}"/></box>'
