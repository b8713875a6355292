"""The roadmap past boxes: corners around which paths may lead, and which of them see each other.

Lozano-Perez and Wesley, "An algorithm for planning collision-free paths among polyhedral obstacles", CACM 1979.
Axis-aligned boxes grown to rectangles keep it exact and small; its straight legs can be certified one by one. The
robots of a fleet keep out of nearly the same rectangles, so that most of the work is done once for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.edges import Floats, Indices
from soter.geometry.workspace import crosses, grown
from soter.stack.site_routes import Rectangle, around, covered
from soter.stack.terrain import Point, Terrain, crossing

_ROUNDING_M: Final = 1e-9

_AT_ONCE: Final = 256
"""How many places are looked from together: memory holds so many rows of numbers at a time, not one for each corner."""

_Counts = NDArray[np.int16]


class Roadmap:
    """The corners around which paths may lead, and which of them see each other; shared by all goals.

    Args:
        terrain: fence and boxes.
        clearance_m: body clearance of paths from boxes, as far as the ends of the path allow.
        inset_m: distance of the corners of paths from the fence.
        extra: more rectangles to keep out of, already grown: robots that stand in the way.
        shared: rectangles of which other roadmaps have most as well; what is found out about them is kept. It makes no
            difference to the roadmap.
    """

    def __init__(
        self,
        terrain: Terrain,
        clearance_m: float,
        inset_m: float,
        extra: Sequence[Rectangle] = (),
        shared: tuple[Rectangle, ...] = (),
    ) -> None:
        self._terrain: Final = terrain
        self._clearance_m: Final = clearance_m
        grow_m = terrain.body_radius_m + clearance_m
        boxes = tuple(grown(box, grow_m) for box in terrain.boxes)
        self.rectangles: Final = boxes + tuple(extra)
        self.edges: Final[Floats] = np.array(self.rectangles, dtype=np.float64).reshape(-1, 4)
        self._sights: Final = _sights_of(terrain, inset_m, tuple(dict.fromkeys(boxes + shared)))
        self._left_out: Final = self._sights.corners.keys() - {*self.rectangles}
        self._added: Final = {*self.rectangles} - self._sights.corners.keys()
        known: list[int] = []
        corners: list[Point] = []
        for rectangle in self.rectangles:
            rows = self._sights.corners.get(rectangle)
            if rows is None:
                rows = dict.fromkeys(_corners(terrain, inset_m, rectangle), -1)
            corners += rows
            known += rows.values()
        places = np.array(corners, dtype=np.float64).reshape(-1, 2)
        outside = ~covered(places, self.edges)
        self.places: Final[Floats] = places[outside]
        self.corners: Final = tuple((x, y) for x, y in self.places.tolist())
        self._known: Final[Indices] = np.array(known, dtype=np.intp)[outside]
        seen = self._open(self.places, self._sights.crossed, self._known)
        self.neighbours: Final = tuple(np.flatnonzero(row) for row in seen)
        self._ends: Final[Indices] = np.arange(len(self.corners) + 1)

    def seeing(self, place: Point) -> list[int]:
        """Return the indices of the corners from which a leg leads to a place."""
        return [index for index, (x, y) in enumerate(self.corners) if self.sees(x, y, *place)]

    def ends(self, x: float, y: float) -> Indices:
        """Return where the first leg of a path from a place may end: 0 stands for the goal, the corners follow."""
        return self._ends

    def looks(self, last: Point) -> list[tuple[Point, Indices, Floats]]:
        """Return evenly spread places, each with the ends that a leg leads to, and the lengths of these legs.

        Ends are numbered as in `ends`. A place inside a rectangle has none: how it is left is not looked at here.
        """
        ats, crossed = self._sights.looks
        if not len(ats):
            return []
        outside = ~covered(ats, self.edges)
        seen = self._open(ats, crossed) & outside[:, None]
        home = outside & (_crossings(ats, np.array([last]), self.rectangles)[:, 0] == 0)
        looks = []
        for at, row, straight in zip(ats, seen, home.tolist(), strict=True):
            ends = np.flatnonzero(row)
            away = np.hypot(*(self.places[ends] - at).T)
            ends = ends + 1
            if straight:
                ends, away = np.append(ends, 0), np.append(away, math.dist(at, last))
            looks.append(((float(at[0]), float(at[1])), ends, away))
        return looks

    def sees(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Return whether the straight leg from a to b keeps out of the rectangles, or only leads out of them.

        A robot in the corner of a grown box may still be far enough from the box: there, its clearance counts.
        """
        left, right = (ax, bx) if ax < bx else (bx, ax)
        low, high = (ay, by) if ay < by else (by, ay)
        here_m = math.inf
        for index, (low_x, low_y, high_x, high_y) in enumerate(self.rectangles):
            if high_x <= left or low_x >= right or high_y <= low or low_y >= high:
                if left != right and low != high:
                    continue
                if not (low_x < left < high_x and low < high) and not (low_y < low < high_y and left < right):
                    continue
            if low_x < ax < high_x and low_y < ay < high_y:
                if index < len(self._terrain.boxes) and (here_m := self._terrain.clearance_m(ax, ay)) >= 0.0:
                    continue
                # From inside a box or a peer's room the leg may only lead outwards: never deeper than where it begins.
                depth = min(ax - low_x, high_x - ax, ay - low_y, high_y - ay)
                if crosses(ax, ay, bx, by, low_x + depth, low_y + depth, high_x - depth, high_y - depth):
                    return False
            elif crosses(ax, ay, bx, by, low_x, low_y, high_x, high_y):
                return False
        if here_m == math.inf:
            return True
        return self._terrain.segment_clearance_m(ax, ay, bx, by) >= min(self._clearance_m, here_m) - _ROUNDING_M

    def _open(self, a: Floats, crossed: _Counts, rows: Indices | None = None) -> NDArray[np.bool_]:
        """Return from which places, one a row, a leg to which corner crosses no rectangle.

        Args:
            a: the places.
            crossed: how many of the shared rectangles their legs to the shared corners cross.
            rows: the rows of `crossed` that belong to the places, -1 for none; None if they are the same.
        """
        places, known = self.places, self._known >= 0
        old = np.ones(len(a), dtype=np.bool_) if rows is None else rows >= 0
        crossed = crossed if rows is None else crossed[rows[old]]
        counts = np.zeros((len(a), len(places)), dtype=np.int16)
        shared = crossed[:, self._known[known]]
        shared = shared - _crossings(a[old], places[known], self._left_out)
        counts[np.ix_(old, known)] = shared + _crossings(a[old], places[known], self._added)
        if not known.all():
            counts[:, ~known] = _crossings(a, places[~known], self.rectangles)
        if not old.all():
            counts[~old] = _crossings(a[~old], places, self.rectangles)
        return np.asarray(counts == 0, dtype=np.bool_)


class _Sights:
    """How many of some rectangles the legs between their corners cross.

    Attributes:
        corners: by rectangle, its corners as far as they are far enough from the fence, and their rows in `crossed`.
        crossed: how many rectangles the leg from one corner (row) to another (column) crosses.
    """

    def __init__(self, terrain: Terrain, inset_m: float, rectangles: Sequence[Rectangle]) -> None:
        self._terrain: Final = terrain
        self._rectangles: Final = rectangles
        self.corners: Final[dict[Rectangle, dict[Point, int]]] = {}
        places: list[Point] = []
        for rectangle in rectangles:
            found = _corners(terrain, inset_m, rectangle)
            self.corners[rectangle] = {corner: index for index, corner in enumerate(found, start=len(places))}
            places += found
        self._places: Final[Floats] = np.array(places, dtype=np.float64).reshape(-1, 2)
        self.crossed: Final = _crossings(self._places, self._places, rectangles)

    @cached_property
    def looks(self) -> tuple[Floats, _Counts]:
        """Evenly spread places, one a row, and how many rectangles the legs from them to the corners cross."""
        ats = np.array(self._terrain.looks(), dtype=np.float64).reshape(-1, 2)
        return ats, _crossings(ats, self._places, self._rectangles)


@lru_cache(maxsize=8)
def _sights_of(terrain: Terrain, inset_m: float, rectangles: tuple[Rectangle, ...]) -> _Sights:
    return _Sights(terrain, inset_m, rectangles)


def _corners(terrain: Terrain, inset_m: float, rectangle: Rectangle) -> list[Point]:
    return [(x, y) for x, y in around(*rectangle) if terrain.fence_m(x, y) >= inset_m]


def _crossings(a: Floats, b: Floats, rectangles: Iterable[Rectangle]) -> _Counts:
    """Return how many rectangles the leg from each of some places (rows) to each of others (columns) crosses."""
    rectangles = tuple(rectangles)
    parts = [_crossed(a[row : row + _AT_ONCE], b, rectangles) for row in range(0, len(a), _AT_ONCE)]
    return np.concatenate(parts) if parts else np.zeros((0, len(b)), dtype=np.int16)


def _crossed(a: Floats, b: Floats, rectangles: Sequence[Rectangle]) -> _Counts:
    counts = np.zeros((len(a), len(b)), dtype=np.int16)
    low = [np.minimum.outer(a[:, axis], b[:, axis]) for axis in (0, 1)]
    high = [np.maximum.outer(a[:, axis], b[:, axis]) for axis in (0, 1)]
    for rectangle in rectangles:
        low_x, low_y, high_x, high_y = rectangle
        beside = (low[0] >= high_x) | (high[0] <= low_x) | (low[1] >= high_y) | (high[1] <= low_y)
        rows, columns = np.nonzero(~beside)
        counts[rows, columns] += crossing(a[rows], b[columns], np.array([rectangle]))[:, 0]
    return counts
