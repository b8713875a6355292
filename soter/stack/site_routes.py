"""The roadmap of a site: corners around which ways may lead, and which of them see each other.

A site of few corners has a complete visibility graph (Lozano-Perez and Wesley, CACM 1979). With many, that would be
too large: a corner is then connected to the nearest ones that it sees, and to its neighbours in the Delaunay
triangulation, and a lattice of free places is added (a probabilistic roadmap without chance; Kavraki and others, IEEE
T-RA 1996). Ways are a little longer than they need be then; that none is found where there is one makes a station
count as out of reach, which is refused before a run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.convex import Pieces, Point, Ring
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Terrain, crosses

Rectangle = tuple[float, float, float, float]
Indices = NDArray[np.intp]

_OFF_M: Final = 1e-6
"""Corners stand off so far, so that a way round a corner does not count as nearer than it may be."""

_ROUNDING_M: Final = 1e-9
_TURN_RAD: Final = math.radians(95.0)
"""So much of a bend is rounded at one corner: a circle at four of them."""

_ALL_PAIRS: Final = 250
_NEAREST: Final = 20
_LATTICE: Final = 24
_TRIED: Final = 80


class SiteRoadmap:
    """What `soter.stack.routes.Roadmap` is for rectangles.

    Args:
        terrain: of a site.
        clearance_m: body clearance that ways keep from what is kept out, as far as the ends of the way allow.
        inset_m: distance that ways keep from the fence, as far as their ends allow.
        extra: rectangles to keep out of, already grown: robots that stand in the way.
    """

    tried: Final = _TRIED

    def __init__(self, terrain: Terrain, clearance_m: float, inset_m: float, extra: Sequence[Rectangle] = ()) -> None:
        if not isinstance(terrain, SiteTerrain):
            raise TypeError(f"a site's roadmap is of a site's terrain, not of a {type(terrain).__name__}")
        self._terrain: Final = terrain
        self._clearance_m: Final = clearance_m
        self._inset_m: Final = inset_m
        self._extra: Final = tuple(extra)
        base_corners, base_pairs = _base(terrain, clearance_m, inset_m)
        clear = np.array([not self._covered(*corner) for corner in base_corners], dtype=np.bool_)
        added = [corner for box in self._extra for corner in _around(box) if self._stands(*corner)]
        self.corners: Final = (*base_corners, *added)
        self.places: Final = np.array(self.corners, dtype=np.float64).reshape(-1, 2)
        neighbours: list[list[int]] = [[] for _ in self.corners]
        for one, other in base_pairs:
            if clear[one] and clear[other] and not self._blocked(*base_corners[one], *base_corners[other]):
                neighbours[one].append(other)
                neighbours[other].append(one)
        for one in range(len(base_corners), len(self.corners)):
            for other in self.seeing(self.corners[one]):
                if other != one and (other < len(base_corners) or other > one):
                    neighbours[one].append(other)
                    neighbours[other].append(one)
        self.neighbours: Final = tuple(np.array(each, dtype=np.intp) for each in neighbours)

    def seeing(self, place: Point) -> list[int]:
        """Return the indices of the corners that a leg leads to a place from: of many, the nearest ones."""
        if not len(self.places):
            return []
        order = np.argsort(np.hypot(*(self.places - np.array(place)).T), kind="stable")
        found: list[int] = []
        for index in order[: None if len(order) <= _ALL_PAIRS else 10 * _NEAREST].tolist():
            x, y = self.corners[index]
            if self.sees(x, y, *place):
                found.append(index)
                if len(order) > _ALL_PAIRS and len(found) >= 2 * _NEAREST:
                    break
        return found

    def sees(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Return whether the straight leg from a to b keeps what ways keep, or as much as there is where it begins.

        From the fence it keeps no more than there is at either end.
        """
        if self._extra and self._blocked(ax, ay, bx, by):
            return False
        terrain = self._terrain
        wanted_m = min(self._clearance_m, terrain.clearance_m(ax, ay)) - _ROUNDING_M
        if terrain.segment_clearance_m(ax, ay, bx, by, wanted_m) < wanted_m:
            return False
        if self._inset_m == -math.inf:
            return True
        inset_m = min(self._inset_m, terrain.fence_m(ax, ay), terrain.fence_m(bx, by)) - _ROUNDING_M
        return inset_m < 0.0 or terrain.fence_along_m(ax, ay, bx, by, inset_m) >= inset_m

    def _blocked(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Whether a leg leads into a peer's room; from inside one it may only lead outwards."""
        for low_x, low_y, high_x, high_y in self._extra:
            if low_x < ax < high_x and low_y < ay < high_y:
                depth = min(ax - low_x, high_x - ax, ay - low_y, high_y - ay)
                if crosses(ax, ay, bx, by, low_x + depth, low_y + depth, high_x - depth, high_y - depth):
                    return True
            elif crosses(ax, ay, bx, by, low_x, low_y, high_x, high_y):
                return True
        return False

    def _covered(self, x: float, y: float) -> bool:
        return any(box[0] < x < box[2] and box[1] < y < box[3] for box in self._extra)

    def _stands(self, x: float, y: float) -> bool:
        terrain = self._terrain
        clear = terrain.clearance_m(x, y) >= self._clearance_m and terrain.fence_m(x, y) >= self._inset_m
        return clear and not self._covered(x, y)


def _around(box: Rectangle) -> list[Point]:
    low_x, low_y, high_x, high_y = box
    return [*product((low_x - _OFF_M, high_x + _OFF_M), (low_y - _OFF_M, high_y + _OFF_M))]


@lru_cache(maxsize=8)
def _base(
    terrain: SiteTerrain, clearance_m: float, inset_m: float
) -> tuple[tuple[Point, ...], tuple[tuple[int, int], ...]]:
    """Return the corners of a site, and which pairs of them see each other."""
    away_m = clearance_m + terrain.body_radius_m
    plan = terrain.site.plan
    found = [corner for area in plan.areas for corner in _corners(area.ring, max(away_m, 0.0))]
    if plan.fence is not None and inset_m > -math.inf:
        # From inside, a fence bends the other way round.
        found += _corners(plan.fence[::-1], max(inset_m, 0.0))

    def stands(x: float, y: float) -> bool:
        return terrain.clearance_m(x, y) >= clearance_m and terrain.fence_m(x, y) >= inset_m

    corners = [corner for corner in found if stands(*corner)]
    few = len(corners) <= _ALL_PAIRS
    if not few:
        low_x, low_y, high_x, high_y = terrain.bounds
        step_m = max(high_x - low_x, high_y - low_y) / _LATTICE
        columns, rows = math.ceil((high_x - low_x) / step_m), math.ceil((high_y - low_y) / step_m)
        lattice = [
            (low_x + (column + 0.5) * step_m, low_y + (row + 0.5) * step_m)
            for column in range(columns)
            for row in range(rows)
        ]
        corners += [place for place in lattice if stands(*place)]
    pairs = _candidates(np.array(corners, dtype=np.float64).reshape(-1, 2), few=few)
    if not len(pairs):
        return tuple(corners), ()
    open_ = ~_near_pieces(terrain.site.keep_outs, corners, pairs, away_m - _ROUNDING_M)
    if inset_m > -math.inf:
        open_ &= ~_near_pieces(terrain.site.outside, corners, pairs, inset_m - _ROUNDING_M)
    return tuple(corners), tuple((int(one), int(other)) for one, other in pairs[open_])


def _candidates(places: NDArray[np.float64], *, few: bool) -> Indices:
    """Return the pairs of corners that are looked at."""
    if len(places) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    if few:
        return np.stack(np.triu_indices(len(places), 1), axis=1)
    # Imported here: only large sites need them, and only while they are prepared.
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


def _near_pieces(pieces: Pieces, corners: Sequence[Point], pairs: Indices, needed_m: float) -> NDArray[np.bool_]:
    """Return which of the lines between pairs of corners come nearer to a piece than `needed_m`."""
    import shapely

    near = np.zeros(len(pairs), dtype=np.bool_)
    if not pieces.all:
        return near
    places = np.array(corners, dtype=np.float64)
    lines = shapely.linestrings(places[pairs])
    tree = shapely.STRtree([shapely.Polygon(piece.ring) for piece in pieces.all])
    near[np.unique(tree.query(lines, predicate="dwithin", distance=max(needed_m, 0.0))[0])] = True
    return near


def _corners(ring: Ring, off_m: float) -> list[Point]:
    """Return where ways lead round the bends of a ring that stand out, so far off it."""
    count = len(ring)
    edges = []
    for index in range(count):
        (ax, ay), (bx, by) = ring[index], ring[(index + 1) % count]
        length = math.hypot(bx - ax, by - ay)
        edges.append(((bx - ax) / length, (by - ay) / length))
    # A fence comes clockwise: what is outside of a ring is on its right in both cases.
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
    """Return the corners of the way round one bend."""
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
