"""The static workspace for safe controllers: clearances, straight segments, cells to retreat to.

Everything here is exact plane geometry over the known boxes and the fence; nothing is learned, sampled or timed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.workspace import Workspace, crosses

_CELL_M: Final = 0.1
"""Least side of the cells among which refuges are chosen."""

_CELLS: Final = 1_000_000
"""Most of these cells: a large workspace has larger ones instead."""

_NEAR_CELL_M: Final = 0.5
"""Side of the cells for which the boxes that may be the nearest are kept."""

_LOOKS: Final = 400
"""About how many evenly spread places sample a whole workspace."""

Point = tuple[float, float]
Edges = tuple[float, float, float, float]


def length_m(way: Sequence[Point]) -> float:
    """Return the length of the straight legs from place to place."""
    return sum(math.dist(one, other) for one, other in pairwise(way))


class Terrain:
    """Distances to fence and boxes.

    Args:
        workspace: fence and boxes.
        body_radius_m: radius of the disc that holds the robot's body.

    Attributes:
        bounds: the least axis-aligned rectangle that holds the fence: low x, low y, high x, high y.
        convex: whether the inside of the fence is convex, so that straight inwards leads away from all of the fence.
        cell_x: the middles of the cells among which refuges are chosen, east.
        cell_y: the same, north.
    """

    convex = True

    def __init__(self, workspace: Workspace, body_radius_m: float) -> None:
        self.workspace = workspace
        self.width_m: Final = workspace.width_m
        self.depth_m: Final = workspace.depth_m
        self.bounds = workspace.bounds
        self.body_radius_m = body_radius_m
        self.boxes: Final = workspace.boxes
        self._edges: Final = tuple((b.low_x_m, b.low_y_m, b.high_x_m, b.high_y_m) for b in workspace.boxes)
        self._near: dict[tuple[float, float], tuple[Edges, ...]] = {}
        self._lay_cells()
        self.cell_fence: Final[NDArray[np.float64]] = np.minimum(
            np.minimum(self.cell_x, self.width_m - self.cell_x), np.minimum(self.cell_y, self.depth_m - self.cell_y)
        )
        clearance = np.full(self.cell_x.shape, math.inf)
        for low_x, low_y, high_x, high_y in self._edges:
            dx = np.maximum(np.maximum(low_x - self.cell_x, self.cell_x - high_x), 0.0)
            dy = np.maximum(np.maximum(low_y - self.cell_y, self.cell_y - high_y), 0.0)
            np.minimum(clearance, np.hypot(dx, dy), out=clearance)
        self.cell_clearance: Final[NDArray[np.float64]] = clearance - body_radius_m

    def _lay_cells(self) -> None:
        """Cover the bounds with cells."""
        low_x, low_y, high_x, high_y = self.bounds
        wide_m, deep_m = high_x - low_x, high_y - low_y
        cell_m = max(_CELL_M, math.sqrt(wide_m * deep_m / _CELLS))
        self._columns, self._rows = max(1, round(wide_m / cell_m)), max(1, round(deep_m / cell_m))
        xs = low_x + (np.arange(self._columns) + 0.5) * (wide_m / self._columns)
        ys = low_y + (np.arange(self._rows) + 0.5) * (deep_m / self._rows)
        self.cell_x: NDArray[np.float64] = np.repeat(xs[:, None], self._rows, axis=1)
        self.cell_y: NDArray[np.float64] = np.repeat(ys[None, :], self._columns, axis=0)

    @property
    def look_m(self) -> float:
        """Spacing of the places that `looks` returns."""
        low_x, low_y, high_x, high_y = self.bounds
        return max(0.5, math.sqrt((high_x - low_x) * (high_y - low_y) / _LOOKS))

    def looks(self) -> list[Point]:
        """Return evenly spread places where a body fits."""
        low_x, low_y, high_x, high_y = self.bounds
        step_m = self.look_m
        columns, rows = math.ceil((high_x - low_x) / step_m), math.ceil((high_y - low_y) / step_m)
        spread = product(range(columns + 1), range(rows + 1))
        places = [(min(low_x + column * step_m, high_x), min(low_y + row * step_m, high_y)) for column, row in spread]
        return [at for at in places if self.clearance_m(*at) > 0.0 and (self.convex or self.fence_m(*at) >= 0.0)]

    def fence_m(self, x_m: float, y_m: float) -> float:
        """Return the distance of a point to the fence; negative outside."""
        return min(x_m, self.width_m - x_m, y_m, self.depth_m - y_m)

    def fence_along_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf) -> float:
        """Return how near a straight line comes to the fence between its ends; infinity if it is nearest at an end.

        A result above `enough_m` may be returned as `enough_m`.
        """
        # The distance to the sides of a rectangle is concave along a line: least at one of its ends.
        return math.inf

    def leg_fence_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float, slope: float) -> float:
        """Return by how much a leg's distance from the fence exceeds `needed_m`; 0 if it leads away from nearer parts.

        See `leg_clearance_m` for the arguments.
        """
        end = self.fence_m(bx_m, by_m)
        if self.fence_m(ax_m, ay_m) >= needed_m:
            # The distance is concave along a line: least at one of its ends.
            return end - needed_m
        width_m, depth_m = self.width_m, self.depth_m
        rise = slope * math.hypot(bx_m - ax_m, by_m - ay_m)
        worst = math.inf
        sides = ((ax_m, bx_m), (width_m - ax_m, width_m - bx_m), (ay_m, by_m), (depth_m - ay_m, depth_m - by_m))
        for start_m, end_m in sides:
            leads_away = start_m < needed_m and end_m - start_m >= rise > 0.0
            worst = min(worst, 0.0 if leads_away else min(start_m, end_m) - needed_m)
        return worst

    def beside(self, x_m: float, y_m: float, inset_m: float, clearance_m: float | None) -> Point:
        """Return the nearest place that is `inset_m` from the fence and `clearance_m` from the nearest box.

        Args:
            x_m: the place, east.
            y_m: the place, north.
            inset_m: distance from the fence; minus infinity for any.
            clearance_m: body clearance from the nearest box; None for any.
        """
        if self.fence_m(x_m, y_m) < inset_m:
            x_m, y_m = self.inside(x_m, y_m, inset_m)
        if clearance_m is not None and (near_m := self.clearance_m(x_m, y_m)) < clearance_m:
            _, ux, uy = min(self.walls(x_m, y_m))
            away_m = clearance_m - near_m
            x_m, y_m = self.inside(x_m - away_m * ux, y_m - away_m * uy, max(inset_m, 0.0))
        return x_m, y_m

    def inside(self, x_m: float, y_m: float, inset_m: float) -> Point:
        """Return the nearest point that is `inset_m` inside the fence."""
        return min(max(x_m, inset_m), self.width_m - inset_m), min(max(y_m, inset_m), self.depth_m - inset_m)

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """Return the distance of a body at a point to the nearest box; negative where they overlap."""
        near = self._near.get((x_m // _NEAR_CELL_M, y_m // _NEAR_CELL_M))
        if near is None:
            near = self._nearest_boxes(x_m, y_m)
        least = math.inf
        for low_x, low_y, high_x, high_y in near:
            # Inside a box, the distance to the nearer edge counts, which is the way out.
            dx = low_x - x_m if x_m + x_m < low_x + high_x else x_m - high_x
            dy = low_y - y_m if y_m + y_m < low_y + high_y else y_m - high_y
            if dx > 0.0 and dy > 0.0:
                distance = math.sqrt(dx * dx + dy * dy)
            elif dx > dy:
                distance = dx
            else:
                distance = dy
            if distance < least:
                least = distance
        return least - self.body_radius_m

    def walls(self, x_m: float, y_m: float, reach_m: float = math.inf) -> list[tuple[float, float, float]]:
        """Return a body's clearance from every box, and the direction in which it falls fastest.

        The distance to a box is convex, inside it as well.

        Args:
            x_m: the body's centre, east.
            y_m: the body's centre, north.
            reach_m: boxes that are farther away may be left out.
        """
        found = []
        for low_x, low_y, high_x, high_y in self._edges:
            west, south = x_m + x_m < low_x + high_x, y_m + y_m < low_y + high_y
            dx = low_x - x_m if west else x_m - high_x
            dy = low_y - y_m if south else y_m - high_y
            ux, uy = 1.0 if west else -1.0, 1.0 if south else -1.0
            if dx > 0.0 and dy > 0.0:
                distance = math.hypot(dx, dy)
                found.append((distance - self.body_radius_m, ux * dx / distance, uy * dy / distance))
            elif dx >= dy:
                found.append((dx - self.body_radius_m, ux, 0.0))
            else:
                found.append((dy - self.body_radius_m, 0.0, uy))
        return found

    def leg_clearance_m(
        self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float, slope: float
    ) -> float:
        """Return the least clearance of a body that drives from a to b, except from boxes that the leg leads away from.

        The distance to a box is convex along a line: if it rises at the beginning, it rises all the way. A box nearer
        than `needed_m` at the beginning counts as `needed_m` if every direction that the robot may really take leads
        away from it, and as less if not.

        Args:
            ax_m: where the leg begins, east.
            ay_m: the same, north.
            bx_m: where it ends, east.
            by_m: the same, north.
            needed_m: clearance that a leg needs if it does not lead away.
            slope: least rise of the distance per metre of the leg: the sine of the angle by which the robot's motion
                may differ from the leg's direction.
        """
        radius, least = self.body_radius_m, math.inf
        dx, dy = bx_m - ax_m, by_m - ay_m
        length = math.hypot(dx, dy)
        for (distance_m, ux, uy), edges in zip(self.walls(ax_m, ay_m), self._edges, strict=True):
            if distance_m - length >= least:
                continue
            if distance_m < needed_m:
                # Walls point towards the box.
                away = -(ux * dx + uy * dy) >= slope * length and length > 0.0
                found = needed_m if away else min(distance_m, segment_to_box(ax_m, ay_m, bx_m, by_m, edges) - radius)
            else:
                found = segment_to_box(ax_m, ay_m, bx_m, by_m, edges) - radius
            least = min(least, found)
        return least

    def segment_clearance_m(
        self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf
    ) -> float:
        """Return the least distance to any box of a body that moves straight from a to b; at most 0 on contact.

        A result above `enough_m` may be returned as `enough_m`.
        """
        # The result is at most the distance at the beginning: skip boxes farther than that from all of the leg.
        least = max(self.clearance_m(ax_m, ay_m) + self.body_radius_m, 0.0)
        left, right = (ax_m, bx_m) if ax_m < bx_m else (bx_m, ax_m)
        low, high = (ay_m, by_m) if ay_m < by_m else (by_m, ay_m)
        for edges in self._edges:
            low_x, low_y, high_x, high_y = edges
            if low_x - right >= least or left - high_x >= least or low_y - high >= least or low - high_y >= least:
                continue
            distance = segment_to_box(ax_m, ay_m, bx_m, by_m, edges)
            if distance < least:
                least = distance
        return least - self.body_radius_m

    def _nearest_boxes(self, x_m: float, y_m: float) -> tuple[Edges, ...]:
        """Return the boxes that may be the nearest to some point of the same cell; cached by cell.

        A box whose least distance to the cell exceeds another box's largest one is left out.

        Raises:
            ValueError: the place is not finite; no distance to it would be less than any other.
        """
        if not math.isfinite(x_m + y_m):
            raise ValueError(f"({x_m}, {y_m}) is no place, allowed: finite")
        column, row = x_m // _NEAR_CELL_M, y_m // _NEAR_CELL_M
        low_x, low_y = column * _NEAR_CELL_M, row * _NEAR_CELL_M
        cell = (low_x, low_y, low_x + _NEAR_CELL_M, low_y + _NEAR_CELL_M)
        looks = [(_apart(cell, edges), _farthest(cell, edges), edges) for edges in self._edges]
        bound = min((farthest for _, farthest, _ in looks), default=math.inf)
        found = tuple(edges for apart, _, edges in looks if apart <= bound)
        self._near[column, row] = found
        return found

    def roomy_cells(self, fence_m: float, clearance_m: float) -> NDArray[np.bool_]:
        """Return which cells are `fence_m` from the fence, and a body in them `clearance_m` from boxes."""
        return (self.cell_fence >= fence_m) & (self.cell_clearance >= clearance_m)

    def window(self, x_m: float, y_m: float, reach_m: float) -> tuple[slice, slice]:
        """Return the index ranges of the cells within a square of half-width `reach_m` around a point."""
        low_x, low_y, high_x, high_y = self.bounds
        per_x, per_y = self._columns / (high_x - low_x), self._rows / (high_y - low_y)
        # Clamp first: far outside, the window is at the edge, and an index could not even be computed.
        x_m = min(max(x_m, low_x - reach_m), high_x + reach_m) - low_x
        y_m = min(max(y_m, low_y - reach_m), high_y + reach_m) - low_y
        left = min(max(int((x_m - reach_m) * per_x), 0), self._columns - 1)
        right = min(max(int((x_m + reach_m) * per_x) + 1, left + 1), self._columns)
        low = min(max(int((y_m - reach_m) * per_y), 0), self._rows - 1)
        high = min(max(int((y_m + reach_m) * per_y) + 1, low + 1), self._rows)
        return slice(left, right), slice(low, high)


def segment_to_box(ax: float, ay: float, bx: float, by: float, edges: Edges) -> float:
    """Return the least distance from a straight leg to a box; 0 if they meet."""
    low_x, low_y, high_x, high_y = edges
    if crosses(ax, ay, bx, by, low_x, low_y, high_x, high_y):
        return 0.0
    # They do not meet: the least distance is from an end of the segment to the box, or from a corner to the segment.
    least = min(_point_to_box(ax, ay, edges), _point_to_box(bx, by, edges))
    dx, dy = bx - ax, by - ay
    length_sq = dx * dx + dy * dy
    if length_sq == 0.0:
        return least
    for cx, cy in ((low_x, low_y), (low_x, high_y), (high_x, low_y), (high_x, high_y)):
        along = ((cx - ax) * dx + (cy - ay) * dy) / length_sq
        if 0.0 < along < 1.0:
            away = abs((cx - ax) * dy - (cy - ay) * dx) / math.sqrt(length_sq)
            if away < least:
                least = away
    return least


def _apart(one: Edges, other: Edges) -> float:
    """Return the least signed distance between two rectangles; at most 0 if they meet."""
    return max(other[0] - one[2], one[0] - other[2], other[1] - one[3], one[1] - other[3])


def _farthest(cell: Edges, box: Edges) -> float:
    """Return the largest distance of any point of a cell to a box, which is convex and so largest at a corner."""
    return max(_point_to_box(x, y, box) for x in (cell[0], cell[2]) for y in (cell[1], cell[3]))


def _point_to_box(x: float, y: float, edges: tuple[float, float, float, float]) -> float:
    low_x, low_y, high_x, high_y = edges
    dx = max(low_x - x, x - high_x, 0.0)
    dy = max(low_y - y, y - high_y, 0.0)
    return math.hypot(dx, dy)


def crossing(a: NDArray[np.float64], b: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which segments (rows) meet the inside of which rectangles (columns), as `crosses` does.

    Args:
        a: where they begin, one place a row; or one place for all.
        b: where they end, or one place for all.
        edges: low x, low y, high x, high y, one rectangle a row.
    """
    enter = np.zeros((np.broadcast(a[..., 0], b[..., 0]).size, len(edges)))
    leave = np.ones_like(enter)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for axis in (0, 1):
            start = a[..., axis, None]
            delta = b[..., axis, None] - start
            first, second = (edges[:, axis] - start) / delta, (edges[:, axis + 2] - start) / delta
            inside = (edges[:, axis] < start) & (start < edges[:, axis + 2])
            # A leg that does not move across the slab is inside it all the way or not at all.
            low = np.where(delta == 0.0, np.where(inside, -np.inf, np.inf), np.minimum(first, second))
            high = np.where(delta == 0.0, np.where(inside, np.inf, -np.inf), np.maximum(first, second))
            enter, leave = np.maximum(enter, low), np.minimum(leave, high)
    meets: NDArray[np.bool_] = enter < leave
    return meets
