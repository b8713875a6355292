"""Distances to sets of convex polygons, found quickly however many there are. Metres, ENU.

A polygon of any shape is a set of convex pieces. The signed distance to a piece is convex and 1-Lipschitz, so the least
of several is 1-Lipschitz, and the assurance argument about boxes holds for pieces, too. The distance is exact outside
all pieces; inside it is the depth in the deepest piece, which is no more than the depth in their union.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from soter.geometry.edges import Edge, Edges, Floats, Indices
from soter.geometry.nearest import Nearest, Part, part_of
from soter.geometry.workspace import Point, Ring

_FEW: Final = 3
_SEVERAL: Final = 16
_MANY: Final = 32
"""Number of edges above which they are tested as arrays, and not filtered one by one."""

_PART: Final = 8.0
_LONG: Final = 64.0
"""Length in cells of the parts of lines that are tested; with many pieces, longer lines are tested as arrays."""

_LINES: Final = 64
"""How many of many lines are tested together: neighbouring lines are near the same pieces."""

_WIDER: Final = 4
"""Ratio of the widths of cells of successive levels; a cell's candidates are chosen from those of the wider one."""

_TOP: Final = 8
"""The level of the widest cells, 33 km for the smallest ones; they choose from all pieces."""


class Piece:
    """A convex polygon, counter-clockwise, within its bounds (low x, low y, high x, high y) and within a disc."""

    __slots__ = ("bounds", "edges", "middle", "radius_m", "ring")

    def __init__(self, ring: Ring) -> None:
        xs, ys = [x for x, _ in ring], [y for _, y in ring]
        self.ring: Final = ring
        self.bounds: Final = (min(xs), min(ys), max(xs), max(ys))
        self.middle: Final = ((min(xs) + max(xs)) / 2.0, (min(ys) + max(ys)) / 2.0)
        # Slightly larger, so that rounding cannot leave a corner out.
        self.radius_m: Final = max(math.dist(self.middle, each) for each in ring) * (1.0 + 1e-12) + 1e-9
        edges = []
        for (ax, ay), (bx, by) in zip(ring, (*ring[1:], ring[0]), strict=True):
            length = math.hypot(bx - ax, by - ay)
            edges.append((ax, ay, (bx - ax) / length, (by - ay) / length, length))
        self.edges: Final[tuple[Edge, ...]] = tuple(edges)

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point: negative inside, by the depth."""
        most, beyond = -math.inf, True
        for ax, ay, ux, uy, length in self.edges:
            dx, dy = x_m - ax, y_m - ay
            # The outward normal of a counter-clockwise edge points to its right.
            off = uy * dx - ux * dy
            if off > most:
                most = off
                along = ux * dx + uy * dy
                beyond = along < 0.0 or along > length
        if most <= 0.0 or not beyond:
            return most
        return min(math.hypot(x_m - ax, y_m - ay) for ax, ay in self._near(x_m, y_m))

    def wall(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Return the signed distance from a point, and the unit vector in which it falls fastest."""
        most, nearest = -math.inf, (0.0, 0.0)
        beyond = True
        for ax, ay, ux, uy, length in self.edges:
            dx, dy = x_m - ax, y_m - ay
            off = uy * dx - ux * dy
            if off > most:
                most, nearest = off, (-uy, ux)
                along = ux * dx + uy * dy
                beyond = along < 0.0 or along > length
        if most <= 0.0 or not beyond:
            return most, *nearest
        px, py = min(self._near(x_m, y_m), key=lambda at: math.hypot(x_m - at[0], y_m - at[1]))
        away = math.hypot(x_m - px, y_m - py)
        return (away, (px - x_m) / away, (py - y_m) / away) if away > 0.0 else (most, *nearest)

    def segment_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float) -> float:
        """Return the least distance from the points of a straight line; 0 if it meets the inside."""
        dx, dy = bx_m - ax_m, by_m - ay_m
        enter, leave = 0.0, 1.0
        for ax, ay, ux, uy, _ in self.edges:
            off, towards = uy * (ax_m - ax) - ux * (ay_m - ay), uy * dx - ux * dy
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
        # They do not meet: the least distance is from an end of the line to the polygon, or from a corner to the line.
        least = max(min(self.distance_m(ax_m, ay_m), self.distance_m(bx_m, by_m)), 0.0)
        square = dx * dx + dy * dy
        if square > 0.0:
            for ax, ay in self.ring:
                along = ((ax - ax_m) * dx + (ay - ay_m) * dy) / square
                if 0.0 < along < 1.0:
                    least = min(least, math.hypot(ax - ax_m - along * dx, ay - ay_m - along * dy))
        return least

    def _near(self, x_m: float, y_m: float) -> Iterable[Point]:
        """Yield the nearest point of every edge that the given point is outside of."""
        for ax, ay, ux, uy, length in self.edges:
            dx, dy = x_m - ax, y_m - ay
            if uy * dx - ux * dy >= 0.0:
                along = min(max(ux * dx + uy * dy, 0.0), length)
                yield ax + ux * along, ay + uy * along


Near = tuple[tuple[Edge, ...], tuple[Piece, ...]]
"""Candidates for the nearest: edges of pieces that a cell lies outside of, and other pieces."""


class _Chosen(NamedTuple):
    """Candidates for the nearest to a point of a cell: the pieces' indices, and their edges."""

    pieces: Indices
    near: Near


def _ever_nearest(edges: tuple[Edge, ...], x_m: float, y_m: float, half_m: float) -> tuple[Edge, ...]:
    """Return the edges that may be nearest to a point of a square, of pieces that the square lies outside of.

    The nearest point of a piece is on an edge straight across, or a corner; each edge stands for its first corner. The
    distance d from an edge is convex, with the unit vector g away from it as gradient: at v from the middle it is at
    least d + g.v. From the edge nearest to the middle it is at most the distance from that edge's nearest point,
    d + g.v + v^2 / 2d.

    Args:
        edges: the edges that start at corners which may be nearest to a point of the square, and others.
        x_m: the middle of the square, east.
        y_m: the middle of the square, north.
        half_m: half of its side.
    """
    seen = []
    for edge in edges if len(edges) <= _MANY else ():
        ax, ay, ux, uy, length = edge
        dx, dy = x_m - ax, y_m - ay
        along, off, wide = ux * dx + uy * dy, uy * dx - ux * dy, half_m * (abs(ux) + abs(uy)) + 1e-9
        if along - wide > length or (along > wide and off < -wide):
            continue
        along -= min(max(along, 0.0), length)
        away = math.hypot(along, off)
        seen.append((away, (along * ux + off * uy) / away, (along * uy - off * ux) / away, edge))
    if not seen:
        return edges
    least, gx, gy, _ = min(seen)
    reach_m = least + half_m * half_m / least + 1e-9
    return tuple(edge for away, hx, hy, edge in seen if away - half_m * (abs(hx - gx) + abs(hy - gy)) <= reach_m)


class Pieces(Nearest):
    """A fixed set of convex polygons.

    Near pieces are looked up in cells, each of which is computed on first use and cached; so the cost of a query
    depends on how many pieces are near, not on how many there are.

    Args:
        rings: the polygons.
        cell_m: side of the smallest cells.
    """

    def __init__(self, rings: Sequence[Ring], cell_m: float = 0.5) -> None:
        self.all: Final = tuple(map(Piece, rings))
        super().__init__(cell_m / _WIDER)
        self._cell_m: Final = cell_m
        bounds = np.array([each.bounds for each in self.all], dtype=np.float64).reshape(-1, 4)
        self._bounds: Final = tuple(np.ascontiguousarray(each) for each in bounds.T)
        self._middle: Final = np.array([each.middle for each in self.all], dtype=np.float64).reshape(-1, 2)
        self._radius_m: Final = np.array([each.radius_m for each in self.all])
        self._edges: Final = Edges([each.edges for each in self.all])
        self._top: Final = _TOP if len(self.all) > _FEW else 0
        self._whole: Final = _Chosen(np.arange(len(self.all)), ((), self.all))
        self._cells: dict[tuple[int, int, int], _Chosen] = {}
        self._within: dict[tuple[int, int, int], tuple[Piece, ...]] = {}

    def keeps(self, x_m: float, y_m: float, needed_m: float) -> bool:
        """Return whether a point keeps its distance from all pieces; cheaper than `distance_m` if few are near."""
        return all(
            math.dist((x_m, y_m), piece.middle) - piece.radius_m >= needed_m or piece.distance_m(x_m, y_m) >= needed_m
            for piece in self.within(x_m, y_m, max(needed_m, _PART * self._cell_m))
        )

    def within(self, x_m: float, y_m: float, reach_m: float) -> tuple[Piece, ...]:
        """Return all pieces within `reach_m` of a point, and maybe others."""
        if len(self.all) <= _FEW:
            return self.all
        size = max(0, math.ceil(math.log2(max(reach_m, self._cell_m) / self._cell_m)))
        side = self._cell_m * 2.0**size
        column, row = math.floor(x_m / side), math.floor(y_m / side)
        found = self._within.get((column, row, size))
        if found is None:
            # `reach_m` is at most a cell's side.
            low_x, low_y, wide = (column - 1) * side, (row - 1) * side, 3.0 * side
            chosen = self._in_box(low_x, low_y, low_x + wide, low_y + wide)
            found = self._within[column, row, size] = tuple(self.all[index] for index in chosen.tolist())
        return found

    def walls(self, x_m: float, y_m: float, reach_m: float) -> list[tuple[float, float, float]]:
        """Return, for every piece within `reach_m`, the signed distance and the direction in which it falls fastest."""
        found = []
        for piece in self.within(x_m, y_m, reach_m):
            if math.dist((x_m, y_m), piece.middle) <= reach_m + piece.radius_m:
                wall = piece.wall(x_m, y_m)
                if wall[0] <= reach_m:
                    found.append(wall)
        return found

    def segment_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf) -> float:
        """Return the least distance from the points of a straight line to any piece; at most 0 if they meet.

        A result above `enough_m` is returned as `enough_m`.
        """
        return self._along_m(ax_m, ay_m, bx_m, by_m, enough_m, 0.0)

    def _along_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float, little_m: float) -> float:
        """Return what `segment_m` returns; any value below `little_m` if that is below it."""
        dx, dy, least = bx_m - ax_m, by_m - ay_m, enough_m
        length, part_m = math.hypot(dx, dy), _PART * self._cell_m
        if length <= part_m or least == math.inf:
            # The distance changes by at most a metre per metre.
            here_m = self.distance_m(ax_m, ay_m)
            least = min(here_m, least)
            if least <= 0.0 or here_m - length >= least:
                return least
        few = len(self.all) <= _SEVERAL
        if length > _LONG * self._cell_m and not few:
            _, away = self._near_lines(np.array(((ax_m, ay_m),)), np.array(((bx_m, by_m),)), least)
            return min(least, float(away.min(initial=math.inf)))
        parts, per_square = 1 if few else math.ceil(length / part_m), 1.0 / max(length * length, 1e-300)
        for part in range(parts):
            share = (part + 0.5) / parts
            reach_m = least + 0.5 * length / parts
            for piece in self.all if few else self.within(ax_m + share * dx, ay_m + share * dy, reach_m):
                # Test the pieces' discs first, which rules out most.
                x_m, y_m = piece.middle
                x_m, y_m = x_m - ax_m, y_m - ay_m
                along = min(max((x_m * dx + y_m * dy) * per_square, 0.0), 1.0)
                x_m, y_m, off_m = x_m - along * dx, y_m - along * dy, least + piece.radius_m
                # Written so that NaN is not ruled out.
                if not x_m * x_m + y_m * y_m >= off_m * off_m:
                    least = min(least, piece.segment_m(ax_m, ay_m, bx_m, by_m))
                    if least <= 0.0 or least < little_m:
                        return max(least, 0.0)
        return least

    def line_keeps(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float) -> bool:
        """Return whether a straight line keeps its distance from all pieces; all lines keep 0 or less."""
        return needed_m <= 0.0 or self._along_m(ax_m, ay_m, bx_m, by_m, needed_m, needed_m) >= needed_m

    def lines_keep(self, a: Floats, b: Floats, needed_m: float) -> NDArray[np.bool_]:
        """Return which of many straight lines keep their distance from all pieces.

        Args:
            a: where they begin, one place a row; or one place for all.
            b: where they end.
            needed_m: the distance; all lines keep 0 or less.
        """
        a, b = np.broadcast_arrays(a, b)
        keep = np.ones(len(a), dtype=np.bool_)
        if needed_m <= 0.0:
            return keep
        for start in range(0, len(a), _LINES):
            part = slice(start, start + _LINES)
            line, away = self._near_lines(a[part], b[part], needed_m)
            keep[line[away < needed_m] + start] = False
        return keep

    def _near_lines(self, a: Floats, b: Floats, reach_m: float) -> tuple[Indices, Floats]:
        """Return the lines' indices and the distances of the pairs of lines and pieces that may be within `reach_m`."""
        low, high = np.minimum(a, b).min(axis=0) - reach_m, np.maximum(a, b).max(axis=0) + reach_m
        near = self._in_box(*low.tolist(), *high.tolist())
        # Test the pieces' discs first, which rules out most pairs.
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        from_x, from_y = self._middle[near, 0] - a[:, :1], self._middle[near, 1] - a[:, 1:]
        along = (from_x.T * dx + from_y.T * dy) / np.maximum(dx * dx + dy * dy, 1e-300)
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        from_x, from_y = from_x.T - along * dx, from_y.T - along * dy
        reach = self._radius_m[near, None] + reach_m
        piece, line = np.nonzero(from_x * from_x + from_y * from_y <= reach * reach)
        if not line.size:
            return line, np.zeros(0)
        return line, self._edges.lines_m(near[piece], a[line], b[line])

    def _in_box(self, low_x_m: float, low_y_m: float, high_x_m: float, high_y_m: float) -> Indices:
        """Return the indices of the pieces whose bounding boxes meet a box, and of those that only just do not."""
        low_x, low_y, high_x, high_y = self._bounds
        hair_m = 1e-9 * (1.0 + max(abs(low_x_m), abs(low_y_m), abs(high_x_m), abs(high_y_m)))
        across = (low_x <= high_x_m + hair_m) & (high_x >= low_x_m - hair_m)
        return np.flatnonzero(across & (low_y <= high_y_m + hair_m) & (high_y >= low_y_m - hair_m))

    def part(self, column: int, row: int) -> Part:
        x_m, y_m, half_m = (column + 0.5) * self.part_m, (row + 0.5) * self.part_m, self.part_m / 2.0
        cell = self._chosen(column // _WIDER, row // _WIDER, 0)
        edges, pieces = cell.near
        if pieces or len(edges) > _MANY:
            edges, pieces = self._choose(cell, x_m, y_m, half_m).near
        elif len(edges) > 1:
            edges = _ever_nearest(edges, x_m, y_m, half_m)
        return (None, None, edges, pieces) if pieces else part_of(edges, x_m, y_m, half_m)

    def _chosen(self, column: int, row: int, level: int) -> _Chosen:
        """Return the candidates of a cell of a level; those of a larger cell if they are few already."""
        found = self._cells.get((column, row, level))
        if found is None:
            above = self._chosen(column // _WIDER, row // _WIDER, level + 1) if level < self._top else self._whole
            edges, pieces = above.near
            found = above
            if pieces or len(edges) > _FEW:
                side_m = self._cell_m * float(_WIDER) ** level
                found = self._choose(above, (column + 0.5) * side_m, (row + 0.5) * side_m, side_m / 2.0)
            self._cells[column, row, level] = found
        return found

    def _choose(self, above: _Chosen, x_m: float, y_m: float, half_m: float) -> _Chosen:
        """Return the candidates of a square, chosen from those of the cell around it."""
        near, (edges, pieces) = above
        if pieces or len(edges) > _MANY:
            away, seen = self._edges.look(near, x_m, y_m)
            # Anywhere in the square, the nearest is at most this far.
            reach_m = (max(float(away.min()), 0.0) + half_m * math.sqrt(8.0)) * (1.0 + 1e-9)
            beside = away > half_m * math.sqrt(2.0) * (1.0 + 1e-9)
            edges = seen.facing(beside, reach_m, half_m)
            pieces = tuple(self.all[index] for index in near[~beside].tolist())
            near = near[away <= reach_m]
        return _Chosen(near, (_ever_nearest(edges, x_m, y_m, half_m), pieces))
