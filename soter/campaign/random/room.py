"""Rooms as plain numbers, and the workspace files that say them; knows nothing of how SOTER reads or uses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import shapely  # type: ignore[import-untyped]
from defusedxml.ElementTree import parse

BOX_HEIGHT_M: Final = 1.0


@dataclass(frozen=True)
class Patch:
    """An axis-aligned rectangle, seen from above: a box, or a charging station.

    Attributes:
        low_x: west edge, metres.
        low_y: south edge.
        high_x: east edge.
        high_y: north edge.
    """

    low_x: float
    low_y: float
    high_x: float
    high_y: float

    @property
    def centre(self) -> tuple[float, float]:
        """The middle, metres."""
        return (self.low_x + self.high_x) / 2.0, (self.low_y + self.high_y) / 2.0

    @property
    def polygon(self) -> shapely.Polygon:
        """The same for shapely."""
        return shapely.box(self.low_x, self.low_y, self.high_x, self.high_y)


@dataclass(frozen=True)
class Start:
    """Where one robot starts: its id, metres east and north, radians."""

    id: int
    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class DrawnRoom:
    """A fence from the origin, boxes, starts, and as many stations, those of the robots in their order."""

    width: float
    depth: float
    robots: tuple[Start, ...]
    stations: tuple[Patch, ...]
    boxes: tuple[Patch, ...] = ()

    def only(self, kept: Sequence[int]) -> DrawnRoom:
        """Return it with the robots and the stations at these places in their order."""
        robots, stations = tuple(self.robots[at] for at in kept), tuple(self.stations[at] for at in kept)
        return replace(self, robots=robots, stations=stations)

    def xml(self) -> str:
        """Return the workspace file."""
        lines = ["<configuration>", f'  <dimension x="{self.width!r}" y="{self.depth!r}" z="1"/>', "  <robots>"]
        for start in self.robots:
            place = f'<start x="{start.x!r}" y="{start.y!r}" heading="{start.heading!r}"/>'
            lines.append(f'    <robot id="{start.id}">{place}</robot>')
        lines += ["  </robots>", "  <obstacles>"]
        lines += [_box(box, BOX_HEIGHT_M) for box in self.boxes]
        lines += ["  </obstacles>", "  <charging_stations>"]
        lines += [_box(station, 0.0) for station in self.stations]
        return "\n".join([*lines, "  </charging_stations>", "</configuration>", ""])

    @classmethod
    def read(cls, path: Path) -> DrawnRoom:
        """Read a workspace file that SOTER accepts, with a reader of its own."""
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
        stations, boxes = patches["charging_stations"], patches["obstacles"]
        return cls(float(size["x"]), float(size["y"]), tuple(robots), stations, boxes)


def _box(patch: Patch, height_m: float) -> str:
    low, high = f'x="{patch.low_x!r}" y="{patch.low_y!r}"', f'x="{patch.high_x!r}" y="{patch.high_y!r}"'
    return f'    <box><low {low} z="0"/><high {high} z="{height_m:g}"/></box>'
