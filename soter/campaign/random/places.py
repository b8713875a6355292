"""Places robots and charging stations in a room so that robots can reach their stations."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Final

import shapely  # type: ignore[import-untyped]
from shapely import Point
from shapely.geometry.base import BaseGeometry  # type: ignore[import-untyped]

from soter.campaign.random.floor import Floor
from soter.campaign.random.room import DrawnRoom, Patch, Start, patch_of

_CANDIDATES: Final = 12
_TRIES: Final = 40
STATION_M: Final = (0.1, 0.5)


@dataclass(frozen=True)
class Needs:
    """The least distances of places, in metres.

    Attributes:
        fence: from the fence to centres of stations, and to return paths.
        boxes: from boxes to centres of robots on their return paths.
        spot: from boxes to centres of starts and stations.
        apart: between starts, and between stations.
        passing: from a robot on its station to the centre of one that passes.
        station: least width of a station.
    """

    fence: float
    boxes: float
    spot: float
    apart: float
    passing: float
    station: float


def furnish(rng: Random, floor: Floor, count: int, needs: Needs, nasty: bool) -> DrawnRoom | None:
    """Return the room with 1 to `count` robots and as many stations; None if none fits.

    In ordinary rooms every robot can reach its station while all others stand on theirs; in nasty ones maybe not.
    """
    ways = _largest(_free(floor, needs.fence, needs.boxes))
    spots = ways.intersection(_free(floor, needs.fence, needs.spot))
    if spots.is_empty or spots.area <= 1e-4:
        return None
    score = rng.choice(_SCORES)(rng, floor)
    stations: list[tuple[float, float]] = []
    starts: list[tuple[float, float]] = []
    for _ in range(count):
        station = _spot(rng, spots, stations, needs.apart, score)
        if station is None:
            break
        at_home = rng.random() < 0.5 and _far_from(station, starts, needs.apart)
        start = station if at_home else _spot(rng, spots, starts, needs.apart, None)
        if start is None:
            break
        tried = [*stations, station], [*starts, start]
        if not nasty and not _well_formed(ways, *tried, needs.passing):
            continue
        stations, starts = tried
    if not starts:
        return None
    robots = tuple(
        Start(number, *place, round(rng.uniform(-math.pi, math.pi), 2) if rng.random() < 0.7 else 0.0)
        for number, place in enumerate(starts, start=1)
    )
    placed = tuple(_station(rng, floor, at, needs.station) for at in stations)
    return DrawnRoom(floor.fence, robots, placed, floor.boxes)


def _free(floor: Floor, fence: float, boxes: float) -> BaseGeometry:
    """Return the area that centres may be in."""
    kept_out = [shapely.Polygon(box).buffer(boxes) for box in floor.boxes]
    return floor.inside.buffer(-fence, join_style="mitre").difference(shapely.union_all(kept_out))


def _largest(area: BaseGeometry) -> BaseGeometry:
    return max(getattr(area, "geoms", [area]), key=lambda part: part.area)


def _spot(
    rng: Random,
    area: BaseGeometry,
    taken: Sequence[tuple[float, float]],
    apart: float,
    score: Callable[[tuple[float, float]], float] | None,
) -> tuple[float, float] | None:
    """Return a random place in an area, the best of a few by a score; None if none was found."""
    shapely.prepare(area)
    low_x, low_y, high_x, high_y = area.bounds
    found: list[tuple[float, float]] = []
    for _ in range(_TRIES * _CANDIDATES):
        at = round(rng.uniform(low_x, high_x), 3), round(rng.uniform(low_y, high_y), 3)
        if _far_from(at, taken, apart) and shapely.contains_xy(area, *at):
            found.append(at)
            if score is None or len(found) == _CANDIDATES:
                break
    return max(found, key=score or (lambda _: 0.0), default=None)


def _far_from(at: tuple[float, float], others: Sequence[tuple[float, float]], apart: float) -> bool:
    return all(math.dist(at, other) >= apart for other in others)


def _well_formed(
    ways: BaseGeometry, stations: Sequence[tuple[float, float]], starts: Sequence[tuple[float, float]], passing: float
) -> bool:
    """Whether every robot can get from its start to its station while all others stand on theirs."""
    for index, (station, start) in enumerate(zip(stations, starts, strict=True)):
        discs = [Point(other).buffer(passing) for at, other in enumerate(stations) if at != index]
        left = ways.difference(shapely.union_all(discs))
        home = [part for part in getattr(left, "geoms", [left]) if part.distance(Point(station)) == 0.0]
        # The start itself may lie in another station's disc, as long as the rest is mostly in one piece.
        if not home or home[0].area < 0.5 * ways.area or home[0].distance(Point(start)) > passing:
            return False
    return True


def _station(rng: Random, floor: Floor, at: tuple[float, float], least: float) -> Patch:
    """Return a station around a place in the room; a square unless the room is a rectangle along the axes."""
    x, y = at
    most = math.sqrt(2.0) * floor.inside.exterior.distance(Point(at))
    wide, deep = (min(max(least, rng.uniform(*STATION_M)), most) for _ in range(2))
    if rng.random() < 0.5 or patch_of(floor.fence) is None or floor.fence[0] != (0.0, 0.0):
        wide = deep = min(max(0.4, least), wide, deep)
    half_x, half_y = round(wide / 2.0, 3), round(deep / 2.0, 3)
    return Patch(round(x - half_x, 6), round(y - half_y, 6), round(x + half_x, 6), round(y + half_y, 6))


Score = Callable[[tuple[float, float]], float]


def _anywhere(_rng: Random, _floor: Floor) -> Score:
    return lambda _: 0.0


def _together(rng: Random, floor: Floor) -> Score:
    low_x, low_y, high_x, high_y = floor.inside.bounds
    at = rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)
    return lambda place: -math.dist(at, place)


def _by_the_fence(_rng: Random, floor: Floor) -> Score:
    fence = floor.inside.exterior
    return lambda place: -fence.distance(Point(place))


def _by_boxes(_rng: Random, floor: Floor) -> Score:
    boxes = shapely.union_all([shapely.Polygon(box) for box in floor.boxes])
    return lambda place: -boxes.distance(Point(place)) if floor.boxes else 0.0


_SCORES: Final = (_anywhere, _anywhere, _together, _by_the_fence, _by_boxes)
"""Ways to place stations: anywhere, near each other, near the fence, near boxes and in corridors."""
