"""The roadmap of a site: corners around which paths may lead, and which of them see each other.

A site of few corners has a complete visibility graph (Lozano-Perez and Wesley, CACM 1979). With many, that would be
too large: a corner is then connected to the nearest ones that it sees, and to its neighbours in the Delaunay
triangulation, and a lattice of free places is added (a probabilistic roadmap without chance; Kavraki and others, IEEE
T-RA 1996). Paths are then a little longer than necessary. If an existing path is not found, a station counts as out of
reach, which is refused before a run. Maps have no corners; see `soter.stack.map_routes`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.edges import Floats, Indices
from soter.geometry.workspace import Point, Ring, crosses
from soter.stack.map_routes import map_roads
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Terrain, crossing

Rectangle = tuple[float, float, float, float]

_OFF_M: Final = 1e-6
"""Corners stand off by this much, so that a path round a corner does not count as too near."""

_ROUNDING_M: Final = 1e-9
_TURN_RAD: Final = math.radians(95.0)
"""The most of a bend that one corner rounds: a circle takes four corners."""

_ALL_PAIRS: Final = 250
_NEAREST: Final = 20
_LATTICE: Final = 24
_TRIED: Final = 80


class SiteRoadmap:
    """The roadmap of a site with polygons, as `soter.stack.routes.Roadmap` is for rectangles.

    Args:
        terrain: the site's terrain.
        clearance_m: body clearance of paths from obstacles, as far as the ends of the path allow.
        inset_m: distance of paths from the fence, as far as their ends allow.
        extra: rectangles to keep out of, already grown: robots that stand in the way.
    """

    def __init__(self, terrain: Terrain, clearance_m: float, inset_m: float, extra: Sequence[Rectangle] = ()) -> None:
        if not isinstance(terrain, SiteTerrain):
            raise TypeError(f"a site's roadmap is of a site's terrain, not of a {type(terrain).__name__}")
        self._terrain: Final = terrain
        self._clearance_m: Final = clearance_m
        self._inset_m: Final = inset_m
        self._extra: Final[Floats] = np.array(extra, dtype=np.float64).reshape(-1, 4)
        self._base: Final = _base(terrain, clearance_m, inset_m)
        places, pairs = self._base
        clear = ~covered(places, self._extra)
        pairs = pairs[clear[pairs].all(axis=1)]
        pairs = pairs[~crossing(places[pairs[:, 0]], places[pairs[:, 1]], self._extra).any(axis=1)]
        added = np.array([corner for box in self._extra for corner in around(*box)]).reshape(-1, 2)
        added = added[~covered(added, self._extra) & _stands(terrain, clearance_m, inset_m, added)]
        self.places: Final[Floats] = np.concatenate([places, added])
        self.corners: Final[tuple[Point, ...]] = tuple((x, y) for x, y in self.places.tolist())
        more = [
            (one, other)
            for one in range(len(places), len(self.corners))
            for other in self.seeing(self.corners[one])
            if other < len(places) or other > one
        ]
        every = np.concatenate([pairs, np.array(more, dtype=np.intp).reshape(-1, 2)])
        both = np.concatenate([every, every[:, ::-1]])
        both = both[np.argsort(both[:, 0], kind="stable")]
        self.neighbours: Final = tuple(
            np.split(both[:, 1], np.searchsorted(both[:, 0], np.arange(1, len(self.corners)))) if self.corners else ()
        )
        # About four cells for each corner.
        low_x, low_y, high_x, high_y = terrain.bounds
        self._cell_m: Final = max(high_x - low_x, high_y - low_y) / (2.0 * math.sqrt(max(len(self.corners), 1)))
        self._ends: dict[tuple[int, int], Indices] = {}
        self._every_end: Final[Indices] = np.arange(len(self.corners) + 1)

    def seeing(self, place: Point) -> list[int]:
        """Return the indices of the corners from which a leg leads to a place; of many, only the nearest are tried."""
        away = np.hypot(*(self.places - np.array(place)).T)
        order = np.argsort(away, kind="stable")
        many = len(order) > _ALL_PAIRS
        order = order[: 10 * _NEAREST] if many else order
        within = covered(self.places[order], self._extra)
        # Corners keep the distances of paths: of a leg that begins at one, only the end counts.
        seen = self._open(self.places[order], np.array(place), self._clearance_m, self._terrain.fence_m(*place))
        seen &= ~crossing(self.places[order], np.array(place), self._extra).any(axis=1)
        seen[within] = [self.sees(*self.corners[int(index)], *place) for index in order[within]]
        found: list[int] = order[seen].tolist()
        return found[: 2 * _NEAREST] if many else found

    def ends(self, x: float, y: float) -> Indices:
        """See `soter.stack.routes.Roadmap.ends`; of many corners only the nearest are looked at."""
        if len(self.places) <= _TRIED:
            return self._every_end
        cell = math.floor(x / self._cell_m), math.floor(y / self._cell_m)
        found = self._ends.get(cell)
        if found is None:
            dx, dy = ((self.places - (np.array(cell) + 0.5) * self._cell_m) ** 2).T
            found = self._ends[cell] = np.append(np.argpartition(dx + dy, _TRIED - 1)[:_TRIED] + 1, 0)
        return found

    def looks(self, last: Point) -> list[tuple[Point, Indices, Floats]]:
        """Return places all over the site, each with the near ends that a leg leads to, and the lengths of these legs.

        Ends are numbered as in `ends`.
        """
        found, places = _looks(self._terrain, self._clearance_m, self._inset_m), self._base[0]
        ats, end = np.array([at for at, *_ in found]).reshape(-1, 2), np.array(last)
        home = self._open(ats, end, self._clearance_m, self._terrain.fence_m(*last))
        home &= ~crossing(ats, end, self._extra).any(axis=1)
        looks = []
        for (at, seen, away), straight in zip(found, home.tolist(), strict=True):
            clear = seen if not len(self._extra) else seen[~crossing(np.array(at), places[seen], self._extra).any(1)]
            far = away if clear is seen else np.hypot(*(places[clear] - at).T)
            if straight:
                looks.append((at, np.append(clear + 1, 0), np.append(far, math.dist(at, last))))
            else:
                looks.append((at, clear + 1, far))
        return looks

    def sees(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Return whether the straight leg from a to b keeps the distances of paths, or those that it begins with.

        From the fence, the distance at either end is enough.
        """
        if len(self._extra) and self._blocked(ax, ay, bx, by):
            return False
        terrain = self._terrain
        wanted_m = min(self._clearance_m, terrain.clearance_m(ax, ay)) - _ROUNDING_M
        if not terrain.site.keep_outs.line_keeps(ax, ay, bx, by, wanted_m + terrain.body_radius_m):
            return False
        if self._inset_m == -math.inf:
            return True
        inset_m = min(self._inset_m, terrain.fence_m(ax, ay), terrain.fence_m(bx, by)) - _ROUNDING_M
        return inset_m < 0.0 or terrain.fence_along_m(ax, ay, bx, by, inset_m) >= inset_m

    def _open(self, a: Floats, b: Floats, clearance_m: float, inset_m: float) -> NDArray[np.bool_]:
        """Return which of many legs keep these distances from obstacles and fence, or those of paths."""
        terrain = self._terrain
        return terrain.lines_keep(a, b, clearance_m - _ROUNDING_M, min(inset_m, self._inset_m) - _ROUNDING_M)

    def _blocked(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Return whether a leg leads into a peer's room; from inside one it may only lead outwards."""
        for low_x, low_y, high_x, high_y in self._extra.tolist():
            if low_x < ax < high_x and low_y < ay < high_y:
                depth = min(ax - low_x, high_x - ax, ay - low_y, high_y - ay)
                if crosses(ax, ay, bx, by, low_x + depth, low_y + depth, high_x - depth, high_y - depth):
                    return True
            elif crosses(ax, ay, bx, by, low_x, low_y, high_x, high_y):
                return True
        return False


def _stands(terrain: SiteTerrain, clearance_m: float, inset_m: float, places: Floats) -> NDArray[np.bool_]:
    low_x, low_y, high_x, high_y = terrain.bounds
    x, y = places.T
    inside: NDArray[np.bool_] = (low_x <= x) & (x <= high_x) & (low_y <= y) & (y <= high_y) | (inset_m < 0.0)
    return inside & terrain.lines_keep(places, places, clearance_m, inset_m or 1e-12)


def covered(places: Floats, rectangles: Floats) -> NDArray[np.bool_]:
    """Return which places are inside a rectangle."""
    inside = (rectangles[:, :2] < places[:, None]) & (places[:, None] < rectangles[:, 2:])
    return np.asarray(np.any(np.all(inside, axis=2), axis=1), dtype=np.bool_)


def around(low_x: float, low_y: float, high_x: float, high_y: float) -> list[Point]:
    """Return the corners of paths around a rectangle."""
    return [*product((low_x - _OFF_M, high_x + _OFF_M), (low_y - _OFF_M, high_y + _OFF_M))]


@lru_cache(maxsize=8)
def _base(terrain: SiteTerrain, clearance_m: float, inset_m: float) -> tuple[Floats, Indices]:
    """Return the corners of a site, and which pairs of them see each other."""
    away_m = clearance_m + terrain.body_radius_m
    if terrain.site.field is not None:
        return map_roads(terrain.site.field, away_m, inset_m)
    plan = terrain.site.plan
    found = [corner for area in plan.areas for corner in _corners(area.ring, max(away_m, 0.0))]
    if plan.fence is not None and inset_m > -math.inf:
        # Seen from inside, a fence bends the other way round.
        found += _corners(plan.fence[::-1], max(inset_m, 0.0))

    places = np.array(found, dtype=np.float64).reshape(-1, 2)
    places = places[_stands(terrain, clearance_m, inset_m, places)]
    few = len(places) <= _ALL_PAIRS
    if not few:
        low_x, low_y, high_x, high_y = terrain.bounds
        step_m = max(high_x - low_x, high_y - low_y) / _LATTICE
        columns, rows = math.ceil((high_x - low_x) / step_m), math.ceil((high_y - low_y) / step_m)
        lattice = [
            (low_x + (column + 0.5) * step_m, low_y + (row + 0.5) * step_m)
            for column in range(columns)
            for row in range(rows)
        ]
        free = np.array(lattice)
        places = np.concatenate([places, free[_stands(terrain, clearance_m, inset_m, free)]])
    pairs = _candidates(places, few=few)
    if not len(pairs):
        return places, pairs
    clear, inset = clearance_m - _ROUNDING_M, inset_m - _ROUNDING_M
    return places, pairs[terrain.lines_keep(places[pairs[:, 0]], places[pairs[:, 1]], clear, inset)]


@lru_cache(maxsize=8)
def _looks(terrain: SiteTerrain, clearance_m: float, inset_m: float) -> list[tuple[Point, Indices, Floats]]:
    """Return what `SiteRoadmap.looks` returns without anything extra in the way."""
    places, _ = _base(terrain, clearance_m, inset_m)
    found = []
    for x, y in terrain.looks():
        away = np.hypot(places[:, 0] - x, places[:, 1] - y)
        near = np.argpartition(away, _TRIED)[:_TRIED] if len(away) > _TRIED else np.arange(len(away))
        clear, inset = min(clearance_m, terrain.clearance_m(x, y)), min(inset_m, terrain.fence_m(x, y))
        seen = near[terrain.lines_keep(np.array((x, y)), places[near], clear - _ROUNDING_M, inset - _ROUNDING_M)]
        found.append(((x, y), seen, away[seen]))
    return found


def _candidates(places: NDArray[np.float64], *, few: bool) -> Indices:
    """Return the pairs of corners to test for sight."""
    if len(places) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    if few:
        return np.stack(np.triu_indices(len(places), 1), axis=1)
    # Imported here: only large sites need these libraries, and only while they are prepared.
    import shapely  # type: ignore[import-untyped]

    points = shapely.points(places)
    pairs: set[tuple[int, int]] = set()
    for index, place in enumerate(places):
        away = np.hypot(*(places - place).T)
        for other in np.argpartition(away, min(_NEAREST, len(places) - 1))[: _NEAREST + 1].tolist():
            if other != index:
                pairs.add((min(index, other), max(index, other)))
    at = {(float(x), float(y)): index for index, (x, y) in enumerate(places)}
    edges = shapely.delaunay_triangles(shapely.MultiPoint(points), only_edges=True)
    for line in edges.geoms:
        one, other = (at[x, y] for x, y in line.coords)
        pairs.add((min(one, other), max(one, other)))
    return np.array(sorted(pairs), dtype=np.intp)


def _corners(ring: Ring, off_m: float) -> list[Point]:
    """Return the corners of paths round the outward bends of a ring, at a distance `off_m` from it."""
    count = len(ring)
    edges = []
    for index in range(count):
        (ax, ay), (bx, by) = ring[index], ring[(index + 1) % count]
        length = math.hypot(bx - ax, by - ay)
        edges.append(((bx - ax) / length, (by - ay) / length))
    # A fence comes clockwise: in both cases the free side of a ring is on its right.
    turns = [
        math.atan2(
            edges[index - 1][0] * edges[index][1] - edges[index - 1][1] * edges[index][0],
            edges[index - 1][0] * edges[index][0] + edges[index - 1][1] * edges[index][1],
        )
        for index in range(count)
    ]
    found: list[Point] = []
    start = next((index for index in range(count) if turns[index] <= 0.0), 0)
    order = [(start + step) % count for step in range(count)]
    group: list[int] = []
    for index in [*order, -1]:
        bent = sum(turns[each] for each in group)
        if group and (index < 0 or turns[index] <= 0.0 or bent + turns[index] > _TURN_RAD):
            found += _bend(ring, edges, group, off_m + _OFF_M)
            group = []
        if index >= 0 and turns[index] > 0.0:
            group.append(index)
    return found


def _bend(ring: Ring, edges: Sequence[Point], group: Sequence[int], off_m: float) -> list[Point]:
    """Return the corners of the path round one bend."""
    (ux, uy), (vx, vy) = edges[group[0] - 1], edges[group[-1]]
    turn = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
    if len(group) == 1:
        x, y = ring[group[0]]
        parts = max(1, math.ceil(turn / _TURN_RAD))
        far_m = off_m / math.cos(turn / (2 * parts))
        start = math.atan2(-ux, uy)
        angles = [start + turn * (each + 0.5) / parts for each in range(parts)]
        return [(x + far_m * math.cos(angle), y + far_m * math.sin(angle)) for angle in angles]
    # Where the lines along the edges before and after the bend meet, both moved outwards.
    (ax, ay), (bx, by) = ring[group[0]], ring[group[-1]]
    ax, ay, bx, by = ax + off_m * uy, ay - off_m * ux, bx + off_m * vy, by - off_m * vx
    cross = ux * vy - uy * vx
    if cross < 1e-9:
        return [(ax, ay), (bx, by)]
    along = ((bx - ax) * vy - (by - ay) * vx) / cross
    return [(ax + along * ux, ay + along * uy)]
