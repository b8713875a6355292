"""Distances to sets of convex polygons, found quickly however many there are. Metres, ENU.

A polygon of any shape is a set of convex pieces. The signed distance to one of them is convex and 1-Lipschitz, so the
least of several is 1-Lipschitz, and what the assurance argument says of boxes holds of pieces, too. It is exact outside
of all pieces; inside it is the depth in the deepest piece, which is no more than the depth in all of them together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
Ring = tuple[Point, ...]
"""Corners in order, counter-clockwise, the first not repeated."""

_FEW: Final = 3


class Piece:
    """A convex polygon.

    Args:
        ring: its corners, counter-clockwise.

    Attributes:
        ring: see above.
        bounds: low x, low y, high x, high y.
        middle: centre of a disc that holds it.
        radius_m: radius of that disc.
    """

    __slots__ = ("_edges", "bounds", "middle", "radius_m", "ring")

    def __init__(self, ring: Ring) -> None:
        xs, ys = [x for x, _ in ring], [y for _, y in ring]
        self.ring: Final = ring
        self.bounds: Final = (min(xs), min(ys), max(xs), max(ys))
        self.middle: Final = ((min(xs) + max(xs)) / 2.0, (min(ys) + max(ys)) / 2.0)
        # A hair more, so that rounding cannot leave a corner out.
        self.radius_m: Final = max(math.dist(self.middle, each) for each in ring) * (1.0 + 1e-12) + 1e-9
        edges = []
        for (ax, ay), (bx, by) in zip(ring, (*ring[1:], ring[0]), strict=True):
            length = math.hypot(bx - ax, by - ay)
            along_x, along_y = (bx - ax) / length, (by - ay) / length
            # The outward normal of a counter-clockwise edge points to its right.
            edges.append((ax, ay, along_y, -along_x, length))
        self._edges: Final = tuple(edges)

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point: negative inside, by the depth."""
        most, beyond = -math.inf, True
        for ax, ay, nx, ny, length in self._edges:
            dx, dy = x_m - ax, y_m - ay
            off = nx * dx + ny * dy
            if off > most:
                most = off
                along = ny * -dx + nx * dy
                beyond = along < 0.0 or along > length
        if most <= 0.0 or not beyond:
            return most
        return min(math.hypot(x_m - ax, y_m - ay) for ax, ay in self._near(x_m, y_m))

    def wall(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Return the signed distance from a point, and the unit vector in which it falls fastest."""
        most, nearest = -math.inf, (0.0, 0.0)
        beyond = True
        for ax, ay, nx, ny, length in self._edges:
            dx, dy = x_m - ax, y_m - ay
            off = nx * dx + ny * dy
            if off > most:
                most, nearest = off, (-nx, -ny)
                along = ny * -dx + nx * dy
                beyond = along < 0.0 or along > length
        if most <= 0.0 or not beyond:
            return most, *nearest
        px, py = min(self._near(x_m, y_m), key=lambda at: math.hypot(x_m - at[0], y_m - at[1]))
        away = math.hypot(x_m - px, y_m - py)
        return (away, (px - x_m) / away, (py - y_m) / away) if away > 0.0 else (most, *nearest)

    def segment_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float) -> float:
        """Return the least distance from the points of a straight line; 0 where it meets the inside."""
        dx, dy = bx_m - ax_m, by_m - ay_m
        enter, leave = 0.0, 1.0
        for ax, ay, nx, ny, _ in self._edges:
            off, towards = nx * (ax_m - ax) + ny * (ay_m - ay), nx * dx + ny * dy
            if towards == 0.0:
                if off >= 0.0:
                    enter = math.inf
                    break
            elif towards < 0.0:
                enter = max(enter, -off / towards)
            else:
                leave = min(leave, -off / towards)
            if enter >= leave:
                break
        if enter < leave:
            return 0.0
        # Apart: the least distance is from an end of the line to the polygon, or from a corner to the line.
        least = max(min(self.distance_m(ax_m, ay_m), self.distance_m(bx_m, by_m)), 0.0)
        square = dx * dx + dy * dy
        if square > 0.0:
            for ax, ay in self.ring:
                along = ((ax - ax_m) * dx + (ay - ay_m) * dy) / square
                if 0.0 < along < 1.0:
                    least = min(least, math.hypot(ax - ax_m - along * dx, ay - ay_m - along * dy))
        return least

    def _near(self, x_m: float, y_m: float) -> Iterable[Point]:
        """Yield, for every edge that the point is outside of, the point of that edge that is nearest to it."""
        for ax, ay, nx, ny, length in self._edges:
            dx, dy = x_m - ax, y_m - ay
            if nx * dx + ny * dy >= 0.0:
                along = min(max(ny * -dx + nx * dy, 0.0), length)
                yield ax - ny * along, ay + nx * along


class Pieces:
    """A fixed set of convex polygons.

    What is near is looked up in cells, each of which is worked out when it is first asked for and then kept; so what
    a question costs depends on how many pieces are near, not on how many there are.

    Args:
        rings: the polygons.
        cell_m: side of the cells.
    """

    def __init__(self, rings: Sequence[Ring], cell_m: float = 1.0) -> None:
        self.all: Final = tuple(map(Piece, rings))
        self._cell_m: Final = cell_m
        self._half_m: Final = cell_m * math.sqrt(0.5)
        bounds = np.array([each.bounds for each in self.all], dtype=np.float64).reshape(-1, 4)
        self._low, self._high = bounds[:, :2], bounds[:, 2:]
        self._nearest: dict[tuple[int, int], tuple[tuple[float, float, float, Piece], ...]] = {}
        self._within: dict[tuple[int, int, int], tuple[Piece, ...]] = {}

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point to the nearest piece; infinite without any."""
        cell = (math.floor(x_m / self._cell_m), math.floor(y_m / self._cell_m))
        near = self._nearest.get(cell)
        if near is None:
            near = self._nearest[cell] = self._nearest_in(cell)
        least = math.inf
        for middle_x, middle_y, radius, piece in near:
            dx, dy, reach = x_m - middle_x, y_m - middle_y, least + radius
            if reach > 0.0 and dx * dx + dy * dy < reach * reach:
                distance = piece.distance_m(x_m, y_m)
                if distance < least:
                    least = distance
        return least

    def within(self, x_m: float, y_m: float, reach_m: float) -> tuple[Piece, ...]:
        """Return all pieces that are no farther from a point, and maybe others."""
        if len(self.all) <= _FEW:
            return self.all
        size = max(0, math.ceil(math.log2(max(reach_m, self._cell_m) / self._cell_m)))
        side = self._cell_m * 2.0**size
        column, row = math.floor(x_m / side), math.floor(y_m / side)
        found = self._within.get((column, row, size))
        if found is None:
            away = self._boxes_m((column + 0.5) * side, (row + 0.5) * side)
            chosen = np.flatnonzero(away <= side * (1.0 + math.sqrt(0.5)) * (1.0 + 1e-9))
            found = self._within[column, row, size] = tuple(self.all[index] for index in chosen.tolist())
        return found

    def walls(self, x_m: float, y_m: float, reach_m: float) -> list[tuple[float, float, float]]:
        """Return, of every piece no farther than `reach_m`, the signed distance and where it falls fastest."""
        found = []
        for piece in self.within(x_m, y_m, reach_m):
            if math.dist((x_m, y_m), piece.middle) <= reach_m + piece.radius_m:
                wall = piece.wall(x_m, y_m)
                if wall[0] <= reach_m:
                    found.append(wall)
        return found

    def segment_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf) -> float:
        """Return the least distance from the points of a straight line to any piece; at most 0 where they meet.

        Args:
            ax_m: one end, east.
            ay_m: the same, north.
            bx_m: the other end, east.
            by_m: the same, north.
            enough_m: of what is farther than this, this is returned.
        """
        here_m = self.distance_m(ax_m, ay_m)
        least, length, at_m = min(here_m, enough_m), math.hypot(bx_m - ax_m, by_m - ay_m), 0.0
        if least <= 0.0 or least == math.inf:
            return least
        ux, uy = ((bx_m - ax_m) / length, (by_m - ay_m) / length) if length > 0.0 else (0.0, 0.0)
        while True:
            # The distance changes by a metre a metre at most: until there nothing is nearer than what was found.
            at_m += here_m - least
            if at_m >= length:
                return least
            # What counts is nearer than `least`; longer pieces of the line where that is much.
            part_m = min(max(self._cell_m, 0.5 * least), length - at_m)
            fx, fy, tx, ty = self._part(ax_m, ay_m, bx_m, by_m, ux, uy, at_m, part_m, length)
            for piece in self.within((fx + tx) / 2.0, (fy + ty) / 2.0, least + 0.5 * part_m):
                away_m = math.hypot((fx + tx) / 2.0 - piece.middle[0], (fy + ty) / 2.0 - piece.middle[1])
                if away_m < least + 0.5 * part_m + piece.radius_m:
                    least = min(least, piece.segment_m(fx, fy, tx, ty))
                    if least <= 0.0:
                        return 0.0
            at_m += part_m
            if at_m >= length:
                return least
            here_m = max(self.distance_m(tx, ty), least)

    @staticmethod
    def _part(
        ax: float, ay: float, bx: float, by: float, ux: float, uy: float, at_m: float, part_m: float, length: float
    ) -> tuple[float, float, float, float]:
        end = (bx, by) if at_m + part_m >= length else (ax + ux * (at_m + part_m), ay + uy * (at_m + part_m))
        return ax + ux * at_m, ay + uy * at_m, *end

    def _boxes_m(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        at = np.array((x_m, y_m))
        apart = np.maximum(np.maximum(self._low - at, at - self._high), 0.0)
        away: NDArray[np.float64] = np.hypot(apart[:, 0], apart[:, 1])
        return away

    def _nearest_in(self, cell: tuple[int, int]) -> tuple[tuple[float, float, float, Piece], ...]:
        """Return the pieces of which one is the nearest to any point of a cell, the likeliest first."""
        if not self.all:
            return ()
        x_m, y_m = (cell[0] + 0.5) * self._cell_m, (cell[1] + 0.5) * self._cell_m
        away = self._boxes_m(x_m, y_m)
        order = np.argsort(away, kind="stable")
        least = math.inf
        for index in order.tolist():
            if away[index] > least:
                break
            least = min(least, max(self.all[index].distance_m(x_m, y_m), 0.0))
        # Anywhere in the cell the nearest is no farther than this, and no other nearer than its box.
        reach = (least + 2.0 * self._half_m) * (1.0 + 1e-9)
        chosen = [self.all[index] for index in order.tolist() if away[index] <= reach]
        exact = [each for each in chosen if each.distance_m(x_m, y_m) <= reach]
        return tuple((*each.middle, each.radius_m, each) for each in exact)
