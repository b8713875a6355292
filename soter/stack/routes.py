"""Shortest ways to one place past the boxes: a visibility graph over the corners of the grown boxes.

Lozano-Perez and Wesley, "An algorithm for planning collision-free paths among polyhedral obstacles", CACM 1979.
Axis-aligned boxes grown to rectangles keep it exact and small; its straight legs can be certified one by one.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import product
from typing import Final

from soter.stack.terrain import Point, Terrain, crosses, grown

Rectangle = tuple[float, float, float, float]

_CORNER_M: Final = 1e-6
"""Corners stand off the rectangles by this much, so that a way round a corner does not count as through it."""


class Routes:
    """Ways from anywhere to one place.

    Args:
        terrain: fence and boxes.
        place: where all ways end.
        clearance_m: body clearance that ways keep from boxes, as far as the ends of the way allow.
        inset_m: distance that the corners of ways keep from the fence.
        extra: more rectangles to keep out of, already grown: robots that stand in the way.
    """

    def __init__(
        self, terrain: Terrain, place: Point, clearance_m: float, inset_m: float, extra: Sequence[Rectangle] = ()
    ) -> None:
        self.place: Final = place
        self._terrain: Final = terrain
        grow_m = terrain.body_radius_m + clearance_m
        self._rectangles: Final = tuple(grown(box, grow_m) for box in terrain.boxes) + tuple(extra)
        corners = [place]
        for low_x, low_y, high_x, high_y in self._rectangles:
            around = product((low_x - _CORNER_M, high_x + _CORNER_M), (low_y - _CORNER_M, high_y + _CORNER_M))
            corners += [(x, y) for x, y in around if terrain.fence_m(x, y) >= inset_m and not self._covered(x, y)]
        self._corners: Final = tuple(corners)
        self._to_go_m: Final = self._distances()

    def legs(self, x_m: float, y_m: float) -> list[Point]:
        """Return the corners of the shortest way from a point, the place last; empty if there is none."""
        first = self._first(x_m, y_m)
        if first is None:
            return []
        way = [self._corners[first]]
        while first != 0:
            first = self._next[first]
            way.append(self._corners[first])
        return way

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the length of the shortest way from a point; infinite if there is none."""
        best = math.inf
        for (cx, cy), to_go_m in zip(self._corners, self._to_go_m, strict=True):
            length = math.hypot(cx - x_m, cy - y_m) + to_go_m
            if length < best and self._sees(x_m, y_m, cx, cy):
                best = length
        return best

    def longest_m(self) -> float:
        """Return the length of the longest of all shortest ways, to within a cell of half a metre, rounded up."""
        step_m, longest = 0.5, 0.0
        terrain = self._terrain
        for column in range(round(terrain.width_m / step_m) + 1):
            for row in range(round(terrain.depth_m / step_m) + 1):
                x, y = column * step_m, row * step_m
                length = self.distance_m(x, y)
                if terrain.clearance_m(x, y) > 0.0 and length < math.inf:
                    longest = max(longest, length)
        return longest + step_m

    def _first(self, x_m: float, y_m: float) -> int | None:
        best, chosen = math.inf, None
        for index, ((cx, cy), to_go_m) in enumerate(zip(self._corners, self._to_go_m, strict=True)):
            length = math.hypot(cx - x_m, cy - y_m) + to_go_m
            if length < best and self._sees(x_m, y_m, cx, cy):
                best, chosen = length, index
        return chosen

    def _covered(self, x: float, y: float) -> bool:
        return any(r[0] < x < r[2] and r[1] < y < r[3] for r in self._rectangles)

    def _sees(self, ax: float, ay: float, bx: float, by: float) -> bool:
        for low_x, low_y, high_x, high_y in self._rectangles:
            if low_x < ax < high_x and low_y < ay < high_y:
                # From inside a grown box the way may only lead outwards: never deeper than where it begins.
                depth = min(ax - low_x, high_x - ax, ay - low_y, high_y - ay)
                if crosses(ax, ay, bx, by, low_x + depth, low_y + depth, high_x - depth, high_y - depth):
                    return False
            elif crosses(ax, ay, bx, by, low_x, low_y, high_x, high_y):
                return False
        return True

    def _distances(self) -> list[float]:
        corners = self._corners
        to_go = [math.inf] * len(corners)
        self._next: list[int] = [0] * len(corners)
        to_go[0] = 0.0
        queue = [(0.0, 0)]
        done = set()
        while queue:
            length, here = heapq.heappop(queue)
            if here in done:
                continue
            done.add(here)
            hx, hy = corners[here]
            for index, (cx, cy) in enumerate(corners):
                if index in done:
                    continue
                through = length + math.hypot(cx - hx, cy - hy)
                if through < to_go[index] - 1e-12 and self._sees(cx, cy, hx, hy):
                    to_go[index] = through
                    self._next[index] = here
                    heapq.heappush(queue, (through, index))
        return to_go
