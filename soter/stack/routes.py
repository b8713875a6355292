"""Shortest paths to one place: Dijkstra's algorithm over a roadmap."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property, lru_cache
from typing import Final

import numpy as np

from soter.geometry.edges import Floats
from soter.stack.roadmap import Roadmap
from soter.stack.site_routes import Rectangle, SiteRoadmap
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Point, Terrain

_FEW: Final = 24
"""Up to this many corners, one after the other is quicker than NumPy."""


@lru_cache(maxsize=8)
def roadmap_of(
    terrain: Terrain,
    clearance_m: float,
    inset_m: float,
    extra: tuple[Rectangle, ...] = (),
    shared: tuple[Rectangle, ...] = (),
) -> Roadmap | SiteRoadmap:
    """Return a roadmap; cached, so that paths to several places share it."""
    if isinstance(terrain, SiteTerrain):
        return SiteRoadmap(terrain, clearance_m, inset_m, extra)
    return Roadmap(terrain, clearance_m, inset_m, extra, shared)


@lru_cache(maxsize=256)
def routes_to(
    terrain: Terrain,
    place: Point,
    clearance_m: float,
    inset_m: float,
    extra: tuple[Rectangle, ...] = (),
    shared: tuple[Rectangle, ...] = (),
) -> Routes:
    """Return the routes to a place, cached: modules are declared before robots are opened, and once more after."""
    return Routes(terrain, place, clearance_m, inset_m, extra, shared)


class Routes:
    """Shortest paths from anywhere to one place.

    Args:
        terrain: fence and boxes.
        place: where all paths end.
        clearance_m: body clearance of paths from boxes, as far as the ends of the path allow.
        inset_m: distance of the corners of paths from the fence.
        extra: more rectangles to keep out of, already grown: robots that stand in the way.
        shared: see `Roadmap`.

    Attributes:
        roadmap: the corners and which of them see each other.
        corners: the place, then the corners of the roadmap.
        next: for each of these, the index of the next one on the shortest path.
        to_go_m: for each of these, the length of the rest of the path; infinite if there is none.
    """

    def __init__(
        self,
        terrain: Terrain,
        place: Point,
        clearance_m: float,
        inset_m: float,
        extra: Sequence[Rectangle] = (),
        shared: tuple[Rectangle, ...] = (),
    ) -> None:
        self.place: Final = place
        self._terrain: Final = terrain
        self.roadmap: Final = roadmap_of(terrain, clearance_m, inset_m, tuple(extra), shared)
        # Index 0 is the place, the corners follow.
        self.corners: Final = (place, *self.roadmap.corners)
        self.next: Final = [0] * len(self.corners)
        to_go_m = self._distances()
        self._x: Final[Floats] = np.array([x for x, _ in self.corners])
        self._y: Final[Floats] = np.array([y for _, y in self.corners])
        self.to_go_m: Final[Floats] = np.array(to_go_m)
        few = isinstance(self.roadmap, Roadmap) and len(self.corners) <= _FEW
        self._few: Final = [(x, y, to_go) for (x, y), to_go in zip(self.corners, to_go_m, strict=True)] if few else None

    def legs(self, x_m: float, y_m: float) -> list[Point]:
        """Return the corners of the shortest path from a point, the place last; empty if there is none."""
        here, _ = self.first(x_m, y_m)
        if here is None:
            return []
        way = [self.corners[here]]
        while here != 0:
            here = self.next[here]
            way.append(self.corners[here])
        return way

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the length of the shortest path from a point; infinite if there is none."""
        return self.first(x_m, y_m)[1]

    @cached_property
    def longest_m(self) -> float:
        """Return the length of the longest shortest path, sampled on a grid, plus the grid's spacing."""
        lengths = [length for length in self._looks() if length < math.inf]
        return max(lengths, default=0.0) + self._terrain.look_m

    @cached_property
    def most_legs(self) -> int:
        """Return the largest number of legs of any of the paths."""
        most = 1
        for start in range(1, len(self.next)):
            legs, here = 2, start
            while self.next[here] != 0 and legs <= len(self.next):
                here, legs = self.next[here], legs + 1
            most = max(most, legs)
        return most

    def _looks(self) -> Iterator[float]:
        """Yield the lengths of the shortest paths from evenly spread places."""
        for place, ends, away in self.roadmap.looks(self.place):
            length = float((away + self.to_go_m[ends]).min(initial=math.inf))
            yield length if length < math.inf else self.distance_m(*place)

    def first(self, x_m: float, y_m: float) -> tuple[int | None, float]:
        """Return the first corner of the shortest path, and the path's length."""
        # Nothing is shorter than the straight line.
        if self.roadmap.sees(x_m, y_m, *self.place):
            return 0, math.dist((x_m, y_m), self.place)
        for length, end in self._lengths(x_m, y_m):
            if length == math.inf:
                break
            if end != 0 and self.roadmap.sees(x_m, y_m, *self.corners[end]):
                return end, length
        return None, math.inf

    def _lengths(self, x_m: float, y_m: float) -> Iterable[tuple[float, int]]:
        """Return the lengths of paths from a point over each corner near it, whether seen or not; the least first."""
        if self._few is not None:
            return sorted([(math.hypot(x - x_m, y - y_m) + to_go, end) for end, (x, y, to_go) in enumerate(self._few)])
        ends = self.roadmap.ends(x_m, y_m)
        with np.errstate(over="ignore"):
            lengths = np.hypot(self._x[ends] - x_m, self._y[ends] - y_m) + self.to_go_m[ends]
        # A stable sort, so that ties end alike on every host.
        order = lengths.argsort(kind="stable")
        return zip(lengths[order].tolist(), ends[order].tolist(), strict=True)

    def _distances(self) -> list[float]:
        """Return the corners' distances to the place, by Dijkstra's algorithm over the visibility graph."""
        corners, roadmap = self.corners, self.roadmap
        sees_place = [index + 1 for index in roadmap.seeing(self.place)]
        to_go = [math.inf] * len(corners)
        to_go[0] = 0.0
        queue = [(0.0, 0)]
        done: set[int] = set()
        while queue:
            length, here = heapq.heappop(queue)
            if here in done:
                continue
            done.add(here)
            neighbours = sees_place if here == 0 else [index + 1 for index in roadmap.neighbours[here - 1].tolist()]
            for index in neighbours:
                through = length + math.dist(corners[here], corners[index])
                if index not in done and through < to_go[index] - 1e-12:
                    to_go[index] = through
                    self.next[index] = here
                    heapq.heappush(queue, (through, index))
        return to_go
