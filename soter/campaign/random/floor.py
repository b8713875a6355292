"""Draws rooms: their size, and the boxes in them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Final

import shapely  # type: ignore[import-untyped]
from shapely.affinity import affine_transform  # type: ignore[import-untyped]

from soter.campaign.random.room import Patch, Ring

LEAST_M: Final = 1.0
MOST_M: Final = 12.0
WALL_M: Final = (0.08, 0.4)
"""Least and largest thickness of walls."""


@dataclass(frozen=True)
class Floor:
    """A room without robots.

    Attributes:
        style: the style that it was drawn in.
        width: its length along x before it is turned, in metres.
        depth: its length along y before it is turned, in metres.
    """

    style: str
    width: float
    depth: float
    fence: Ring
    boxes: tuple[Ring, ...] = ()

    @property
    def inside(self) -> shapely.Polygon:
        """The area inside the fence."""
        return shapely.Polygon(self.fence)

    @property
    def wide_m(self) -> float:
        """The diameter of the largest disc that fits between fence and boxes."""
        free = self.inside.difference(shapely.union_all([shapely.Polygon(box) for box in self.boxes]))
        return 2.0 * float(shapely.maximum_inscribed_circle(free, 0.01).length)

    @property
    def longest_m(self) -> float:
        """The approximate length of the longest way through the room."""
        if self.style == "serpentine":
            return (len(self.boxes) + 2) * max(self.width, self.depth)
        return (2.0 if self.boxes or len(self.fence) != 4 else 1.0) * (self.width + self.depth)

    def scaled(self, times: float) -> Floor:
        """Return the same room enlarged by a factor."""

        def larger(ring: Ring) -> Ring:
            return tuple((round(x * times, 3), round(y * times, 3)) for x, y in ring)

        return Floor(
            self.style, self.width * times, self.depth * times, larger(self.fence), tuple(map(larger, self.boxes))
        )

    def reshaped(self, rng: Random) -> Floor:
        """Return the room with another outline and other boxes, turned and moved.

        Boxes at the fence become notches in it; corners of the fence and of boxes are cut.
        """
        boxes = [shapely.Polygon(box) for box in self.boxes]
        inside = self.inside
        if rng.random() < 0.6:
            at_fence = [box for box in boxes if not inside.boundary.disjoint(box)]
            boxes = [box for box in boxes if inside.boundary.disjoint(box)]
            inside = inside.difference(shapely.union_all(at_fence))
            inside = max(getattr(inside, "geoms", [inside]), key=lambda part: part.area)
            boxes = [box for box in boxes if inside.covers(box)]
        # A ring of notches would leave a fence with a hole.
        inside = shapely.Polygon(inside.exterior)
        for corner in self.fence:
            if rng.random() < 0.3:
                reach_m = rng.uniform(0.05, 0.3) * min(self.width, self.depth)
                inside = _cut(inside, corner, reach_m)
        boxes = [_cut(box, rng.choice(box.exterior.coords), rng.uniform(0.02, 0.2)) for box in boxes]
        angle_rad = rng.choice((0.0, rng.uniform(-math.pi, math.pi)))
        east_m, north_m = (rng.choice((0.0, rng.uniform(-50.0, 50.0), rng.uniform(-9000.0, 9000.0))) for _ in range(2))
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        moved = [cos, -sin, sin, cos, east_m, north_m]
        fence, *kept_out = (_ring(affine_transform(each, moved)) for each in (inside, *boxes))
        return Floor(self.style, self.width, self.depth, fence, tuple(kept_out))


def draw_floor(rng: Random, nasty: bool) -> Floor:
    """Return a room of 1 to 12 m, randomly turned and mirrored."""
    width = math.exp(rng.uniform(math.log(LEAST_M), math.log(MOST_M)))
    if not nasty:
        width = max(width, rng.uniform(1.3, 3.0))
    depth = min(MOST_M, max(LEAST_M, width * math.exp(rng.uniform(-0.6, 0.6))))
    width, depth = round(width, 2), round(depth, 2)
    styles = [name for name, (least_m, _) in STYLES.items() if min(width, depth) >= least_m]
    style = rng.choice(styles)
    boxes = STYLES[style][1](rng, width, depth, nasty)
    if rng.random() < 0.5:
        width, depth = depth, width
        boxes = [Patch(box.low_y, box.low_x, box.high_y, box.high_x) for box in boxes]
    if rng.random() < 0.5:
        boxes = [Patch(width - box.high_x, box.low_y, width - box.low_x, box.high_y) for box in boxes]
    kept = tuple(_kept(box, width, depth).ring for box in boxes if _solid(box, width, depth))
    return Floor(style, width, depth, Patch(0.0, 0.0, width, depth).ring, kept)


def _cut(polygon: shapely.Polygon, corner: tuple[float, float], reach_m: float) -> shapely.Polygon:
    """Return a polygon with one corner cut off, if that leaves a single piece."""
    left = polygon.difference(shapely.Point(corner).buffer(reach_m, quad_segs=1))
    return left if isinstance(left, shapely.Polygon) and left.area > 0.5 * polygon.area else polygon


def _ring(polygon: shapely.Polygon) -> Ring:
    """Return the corners of a polygon, rounded to millimetres, without those on a straight line."""
    corners = shapely.orient_polygons(polygon.simplify(1e-4)).exterior.coords[:-1]
    # Corners a millimetre apart may be the same after rounding.
    return tuple(dict.fromkeys((round(x, 3), round(y, 3)) for x, y in corners))


def _kept(box: Patch, width: float, depth: float) -> Patch:
    """Return the part of a box inside the room, rounded to millimetres."""
    return Patch(
        round(max(0.0, box.low_x), 3), round(max(0.0, box.low_y), 3),
        round(min(width, box.high_x), 3), round(min(depth, box.high_y), 3),
    )  # fmt: skip


def _solid(box: Patch, width: float, depth: float) -> bool:
    kept = _kept(box, width, depth)
    return min(kept.high_x - kept.low_x, kept.high_y - kept.low_y) >= 0.02


def _gap(rng: Random, nasty: bool) -> float:
    """Return the width of a gap: comfortable, or hardly more than a robot and its clearance from boxes."""
    if nasty:
        return rng.choice((rng.uniform(0.22, 1.0), rng.uniform(0.3, 0.6)))
    return rng.uniform(0.6, 1.6)


def _open(_rng: Random, _width: float, _depth: float, _nasty: bool) -> list[Patch]:
    return []


def _boxes(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    found = []
    for _ in range(rng.randint(1, 8 if nasty else 5)):
        x, y = rng.uniform(0.0, width), rng.uniform(0.0, depth)
        most = 0.35 * min(width, depth)
        found.append(Patch(x, y, x + rng.uniform(0.1, most), y + rng.uniform(0.1, most)))
    return found


def _pillars(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    side, pitch = rng.uniform(0.1, 0.5), _gap(rng, nasty)
    pitch += side
    return [
        Patch(x * pitch - side, y * pitch - side, x * pitch, y * pitch)
        for x in range(1, int(width / pitch) + 1)
        for y in range(1, int(depth / pitch) + 1)
    ][:40]


def _corridor(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    gap = min(_gap(rng, nasty), 0.8 * depth)
    low = rng.uniform(0.1, depth - gap - 0.05)
    begin, end = rng.uniform(0.2, 0.45) * width, rng.uniform(0.6, 1.0) * width
    return [Patch(begin, 0.0, end, low), Patch(begin, low + gap, end, depth)]


def _doorway(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    at, thick = rng.uniform(0.35, 0.65) * width, rng.uniform(*WALL_M)
    return _wall_with_door(rng, at, thick, 0.0, depth, nasty)


def _wall_with_door(rng: Random, at: float, thick: float, low: float, high: float, nasty: bool) -> list[Patch]:
    """Return a wall along y, at an x, with a gap in it."""
    gap = min(_gap(rng, nasty), 0.8 * (high - low))
    door = rng.uniform(low, high - gap)
    return [Patch(at, low, at + thick, door), Patch(at, door + gap, at + thick, high)]


def _l_shape(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    """Return a bay, a corridor out of it, and a turn."""
    gap, bay = min(_gap(rng, nasty), 0.3 * min(width, depth)), rng.uniform(0.3, 0.45) * width
    low = rng.uniform(0.0, 0.3) * depth
    right = width - rng.uniform(0.0, 0.15) * width
    return [
        Patch(bay, 0.0, width, low),
        Patch(bay, low + gap, right - gap, depth),
        Patch(right, low, width, depth),
    ]


def _gaps(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    """Return a row of boxes with gaps between them."""
    low, high = sorted((rng.uniform(0.1, 0.5) * depth, rng.uniform(0.5, 0.9) * depth))
    found: list[Patch] = []
    x = rng.uniform(0.0, 0.3) * width
    while x < 0.9 * width and len(found) < 6:
        wide = rng.uniform(0.15, 0.3) * width
        found.append(Patch(x, low, x + wide, high))
        x += wide + _gap(rng, nasty)
    return found


def _rooms(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    """Return walls for rooms in a row, some of them cut in two, joined by doors."""
    count = rng.randint(2, 3)
    found = []
    for index in range(1, count):
        thick = rng.uniform(*WALL_M)
        found += _wall_with_door(rng, width * index / count - thick / 2.0, thick, 0.0, depth, nasty)
    for index in range(count):
        if rng.random() < 0.4:
            low, high = width * index / count, width * (index + 1) / count
            walls = _wall_with_door(rng, rng.uniform(0.4, 0.6) * depth, rng.uniform(*WALL_M), low, high, nasty)
            found += [Patch(wall.low_y, wall.low_x, wall.high_y, wall.high_x) for wall in walls]
    return found


def _serpentine(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    """Return walls for parallel lanes, joined at alternating ends."""
    gap, thick = min(_gap(rng, nasty), 0.4 * depth), rng.uniform(*WALL_M)
    count = min(int(width / (gap + thick)), rng.randint(2, 16))
    walls = [index * (gap + thick) + gap for index in range(max(1, count))]
    return [
        Patch(at, *((gap, at + thick, depth) if index % 2 else (0.0, at + thick, depth - gap)))
        for index, at in enumerate(walls)
    ]


def _bays(rng: Random, width: float, depth: float, nasty: bool) -> list[Patch]:
    """Return walls for parallel bays, as for parking, with a lane along them."""
    gap, thick = _gap(rng, nasty), rng.uniform(*WALL_M)
    deep = rng.uniform(0.3, 0.7) * depth
    return [
        Patch(index * (gap + thick) + gap, 0.0, (index + 1) * (gap + thick), deep)
        for index in range(int(width / (gap + thick)))
    ]


Boxes = Callable[[Random, float, float, bool], list[Patch]]

STYLES: Final[dict[str, tuple[float, Boxes]]] = {
    "open": (0.0, _open),
    "boxes": (1.5, _boxes),
    "pillars": (2.0, _pillars),
    "corridor": (1.8, _corridor),
    "doorway": (1.8, _doorway),
    "l-shape": (2.5, _l_shape),
    "gaps": (2.0, _gaps),
    "rooms": (3.5, _rooms),
    "serpentine": (1.8, _serpentine),
    "bays": (1.8, _bays),
}
"""By style: the least size of a room in metres, and the function that draws its boxes."""
