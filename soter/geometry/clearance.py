"""Distances to the occupied cells of a map, found quickly however many cells it has. Metres, ENU.

The distance to the occupied cells is exact up to `EXACT_CELLS` cells: the candidates for the nearest are computed for
each cell when it is first needed, and cached. Farther away a lower bound is returned:

    f = E + max(0, I - e - E) / sqrt(2)

E being that limit, I the distances at the corners of the cell (scipy's Euclidean distance transform; a corner's
nearest occupied place is a corner, so they are exact), interpolated in both directions, and e half of a cell's
diagonal. I is at most d + e, because distances change by a metre a metre and the mean distance to the corners is at
most e; so f <= d. The gradient of I has two parts that are at most 1, so f is 1-Lipschitz.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from soter.geometry.cells import window
from soter.geometry.convex import Piece, Pieces
from soter.geometry.edges import Floats
from soter.geometry.grid import GridMap
from soter.geometry.workspace import Point

EXACT_CELLS: Final = 40.0
_floor, _sqrt = math.floor, math.sqrt
_HALF: Final = math.sqrt(0.5)
_DIAGONAL: Final = math.sqrt(2.0)
_BLOCK: Final = 16
"""Side in cells of the blocks for which candidates are computed first, before those of each cell."""

_CELLS: Final = np.arange(_BLOCK * _BLOCK + 1)
_LOOK: Final = 4
"""Least side in cells of the squares in which pieces are looked up."""

_MOST: Final = 200_000
"""Most cells that are cached; after that the cache is cleared."""

_MOST_BLOCKS: Final = 1000
_PARTS: Final = (64, 8, 1)
"""Lengths in cells of the parts of lines that are tested; parts that may come too near are divided further."""

_INFINITE: Final = 2**60
_HAIR: Final = 1e-9
_LITTLE: Final = 0.1

Four = tuple[float, float, float, float]
Near = tuple[tuple[Four, ...], tuple[Four, ...], Four | None]
"""What may be nearest to the places of a cell: rectangles, how far away they are, and the distances at the corners.

A cell is beside a rectangle or in line with it, along both axes: the first two numbers of how far are a sign and an
offset, or zeros, for the way along the first axis, and so on. The distances are there if they may exceed the exact
range.
"""


class _Block(NamedTuple):
    """The boxes around a block of cells.

    Attributes:
        boxes: those that may be nearest to a place of a cell, for one cell after the other, row by row; of none for
            occupied cells.
        starts: where the boxes of each cell begin, and behind the last one's.
        exact: whether all distances in the block are in the exact range.
    """

    boxes: list[Four]
    starts: list[int]
    exact: bool


class Field(Pieces):
    """The occupied cells of a map.

    Attributes:
        grid: the map.
        occupied: which cells are occupied, by row and column.
        corners: distances from the corners of the cells, in cells, by row and column, rounded down.
    """

    def __init__(self, grid: GridMap) -> None:
        super().__init__((), grid.cell_m)
        self.grid: Final = grid
        self.occupied: Final = grid.occupied()
        taken = np.zeros((grid.rows + 1, grid.columns + 1), dtype=np.bool_)
        for down, left in ((0, 0), (0, 1), (1, 0), (1, 1)):
            taken[down : grid.rows + down, left : grid.columns + left] |= self.occupied
        if taken.any():
            away = ndimage.distance_transform_edt(~taken)
            away *= 1.0 - 1e-6
            self.corners: NDArray[np.float32] = away.astype(np.float32)
        else:
            # Without an occupied cell, any distance is a lower bound.
            self.corners = np.full(taken.shape, grid.rows + grid.columns, dtype=np.float32)
        self._x_m, self._y_m = grid.x_m, grid.y_m
        self._columns, self._rows = grid.columns, grid.rows
        self._cos: Final = math.cos(grid.yaw_rad) / grid.cell_m
        self._sin: Final = math.sin(grid.yaw_rad) / grid.cell_m
        self._known: dict[tuple[int, int], Near] = {}
        self._blocks: dict[tuple[int, int], _Block] = {}
        self._looked: dict[tuple[int, int, int], tuple[Piece, ...]] = {}

    def place(self, x_m: float, y_m: float) -> Point:
        """Return a point's place in the map, in cells from the map's corner."""
        dx, dy = x_m - self._x_m, y_m - self._y_m
        return dx * self._cos + dy * self._sin, dy * self._cos - dx * self._sin

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point, or a lower bound if it is far; see above.

        Inside a cell, it is minus the depth in the cell.
        """
        dx, dy = x_m - self._x_m, y_m - self._y_m
        return self._cell_m * self._away(dx * self._cos + dy * self._sin, dy * self._cos - dx * self._sin)

    def keeps(self, x_m: float, y_m: float, needed_m: float) -> bool:
        return self._cell_m * self._surely(*self.place(x_m, y_m)) >= needed_m or self.distance_m(x_m, y_m) >= needed_m

    def segment_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf) -> float:
        """Return the least distance from the points of a straight line, exact where `distance_m` is.

        See `Pieces.segment_m` for the arguments.
        """
        ends, enough = (*self.place(ax_m, ay_m), *self.place(bx_m, by_m)), enough_m / self._cell_m
        found = self._along(*ends, enough, 0.0)
        # At `enough` or beyond, it is enough, whatever rounding says.
        return enough_m if found >= enough else self._cell_m * found

    def line_keeps(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float) -> bool:
        ends, needed = (*self.place(ax_m, ay_m), *self.place(bx_m, by_m)), needed_m / self._cell_m
        if needed > EXACT_CELLS:
            # At this distance the corners give a tighter bound than `distance_m`.
            return bool(self.lines_keep(np.array(((ax_m, ay_m),)), np.array(((bx_m, by_m),)), needed_m)[0])
        return needed <= 0.0 or self._along(*ends, needed, needed) >= needed

    def lines_keep(self, a: Floats, b: Floats, needed_m: float) -> NDArray[np.bool_]:
        """Return which of many straight lines keep their distance; see `Pieces.lines_keep` for the arguments."""
        a, b = np.broadcast_arrays(a, b)
        keep = np.ones(len(a), dtype=np.bool_)
        if needed_m <= 0.0 or not len(a):
            return keep
        needed = needed_m / self._cell_m
        start, end = (np.stack(self._places(each[:, 0], each[:, 1]), axis=1) for each in (a, b))
        # Most lines that come too near do so at one of these places, a cell apart.
        counts = np.ceil(np.hypot(*(end - start).T)).astype(np.intp) + 1
        line, first, wide = np.arange(len(a)), np.zeros(len(a), dtype=np.intp), int(counts.max())
        for size in _PARTS:
            # Test parts of lines at their middles: if a middle is far enough away, so is the whole part.
            parts = -(-np.minimum(wide, counts[line] - first) // size)
            nth = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
            line, first, wide = np.repeat(line, parts), np.repeat(first, parts) + nth * size, size
            step = np.minimum(first + size // 2, counts[line] - 1)
            share = (step / np.maximum(counts[line] - 1, 1))[:, None]
            at = start[line] + share * (end - start)[line]
            low, high = self._between(at[:, 0], at[:, 1])
            keep[line[high < needed]] = False
            # A place between two of them is at most half a cell from one.
            near = (low < needed + 0.5 + (size // 2 + 2 if size > 1 else 0)) & keep[line]
            line, first = line[near], first[near]
        for index in np.unique(line).tolist():
            (au, av), (bu, bv) = start[index].tolist(), end[index].tolist()
            keep[index] = self._along(au, av, bu, bv, needed, needed) >= needed
        return keep

    def within(self, x_m: float, y_m: float, reach_m: float) -> tuple[Piece, ...]:
        u, v = self.place(x_m, y_m)
        size = max(0, math.ceil(math.log2(max(reach_m / self._cell_m, _LOOK) / _LOOK)))
        side = _LOOK * 2**size
        column, row = math.floor(u / side), math.floor(v / side)
        found = self._looked.get((column, row, size))
        if found is None:
            if len(self._looked) >= _MOST:
                self._looked.clear()
            part = window(
                self.occupied, (column - 1) * side, (row - 1) * side, (column + 2) * side, (row + 2) * side
            )  # fmt: skip
            found = tuple(Piece(self.grid.ring(*each)) for each in part.tolist())
            self._looked[column, row, size] = found
        return found

    def at_least(self, x_m: Floats, y_m: Floats, needed_m: float) -> NDArray[np.bool_]:
        """Return which of many points in the map are surely this far away; it may miss some that only just are."""
        return self._between(*self._places(x_m, y_m))[0] >= needed_m / self._cell_m

    def nearest_free(self, x_m: float, y_m: float, clearance_m: float) -> Point | None:
        """Return the cell corner inside the map that is nearest to a point with at least this clearance, if any."""
        u, v = self.place(x_m, y_m)
        reach = 16
        while True:
            column, row = round(min(max(u, 0), self.grid.columns)), round(min(max(v, 0), self.grid.rows))
            low_column, low_row = max(column - reach, 1), max(row - reach, 1)
            high_column, high_row = min(column + reach + 1, self.grid.columns), min(row + reach + 1, self.grid.rows)
            part = self.corners[low_row:high_row, low_column:high_column]
            rows, columns = np.nonzero(part * self._cell_m >= clearance_m + _HAIR)
            everything = reach > max(self.grid.columns, self.grid.rows)
            if len(rows):
                away = np.hypot(columns + low_column - u, rows + low_row - v)
                index = int(np.argmin(away))
                # Corners outside the part that was searched are farther away than its edge.
                if everything or away[index] <= reach:
                    return self.grid.corner(int(columns[index]) + low_column, int(rows[index]) + low_row)
            if everything:
                return None
            reach *= 2

    def _places(self, x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
        dx, dy = x_m - self.grid.x_m, y_m - self.grid.y_m
        return dx * self._cos + dy * self._sin, dy * self._cos - dx * self._sin

    def _away(self, u: float, v: float) -> float:
        """Return the distance from a place of the map to the nearest occupied cell, in cells."""
        column, row = _floor(u), _floor(v)
        try:
            _, ways, far = self._known[column, row]
        except KeyError:
            if not (0 <= column < self._columns and 0 <= row < self._rows):
                return self._away_outside(u, v)
            _, ways, far = self._near(column, row)
        square = math.inf
        for sign_u, offset_u, sign_v, offset_v in ways:
            du, dv = sign_u * u + offset_u, sign_v * v + offset_v
            one = du * du + dv * dv
            if one < square:
                square = one
        if far is not None:
            s, t = u - column, v - row
            between = (far[0] * (1.0 - s) + far[1] * s) * (1.0 - t) + (far[2] * (1.0 - s) + far[3] * s) * t
            return min(_sqrt(square), EXACT_CELLS) + max(0.0, between - _HALF - EXACT_CELLS) * _HALF
        return _sqrt(square) if ways else -min(u - column, column + 1 - u, v - row, row + 1 - v)

    def _away_outside(self, u: float, v: float) -> float:
        """Return the distance from a place outside the map; nothing there is occupied."""
        # The place is at the upper edge of the last cells, or it is outside. The nearest one inside is in a cell.
        inside_u = min(max(u, 0.0), math.nextafter(self._columns, 0.0))
        inside_v = min(max(v, 0.0), math.nextafter(self._rows, 0.0))
        beyond = math.hypot(u - inside_u, v - inside_v)
        return math.hypot(max(self._away(inside_u, inside_v), 0.0), beyond)

    def _surely(self, u: float, v: float) -> float:
        """Return a lower bound of `_away`, from the cell corner that is nearest to the place."""
        columns, rows = self.grid.columns, self.grid.rows
        u = 0.0 if u < 0.0 else min(u, columns)
        v = 0.0 if v < 0.0 else min(v, rows)
        column, row = round(u), round(v)
        low = self.corners.item(row, column) - math.hypot(u - column, v - row)
        # Far away `_away` is itself a bound from the cell's corners, which are at most a cell's diagonal apart.
        beyond = low - EXACT_CELLS
        return low if beyond <= 0.0 else EXACT_CELLS + max(0.0, beyond - _DIAGONAL - _HALF - _LITTLE) * _HALF

    def _between(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Return lower and upper bounds of the distances of many places, from the corners of their cells."""
        in_u, in_v = np.clip(u, 0.0, self.grid.columns), np.clip(v, 0.0, self.grid.rows)
        column = np.minimum(in_u.astype(np.intp), self.grid.columns - 1)
        row = np.minimum(in_v.astype(np.intp), self.grid.rows - 1)
        low, high = np.full(u.shape, -math.inf), np.full(u.shape, math.inf)
        for up, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            there = self.corners[row + up, column + right]
            np.maximum(low, there - np.hypot(in_u - column - right, in_v - row - up), out=low)
            np.minimum(high, there * (1.0 + 1e-5) + np.hypot(u - column - right, v - row - up), out=high)
        return low, high

    def _along(self, au: float, av: float, bu: float, bv: float, enough: float, little: float) -> float:
        """Return the least distance along a line, in cells; `enough` if it is more, 0 if it is less than `little`."""
        here = self._surely(au, av)
        if here < enough:
            here = self._away(au, av)
        least, length, at = min(here, enough), math.hypot(bu - au, bv - av), 0.0
        if least < little or least <= 0.0:
            return min(least, 0.0)
        if length == 0.0:
            return least
        du, dv = (bu - au) / length, (bv - av) / length
        columns, rows = self.grid.columns, self.grid.rows
        while True:
            # The distance changes by at most a metre per metre: up to there nothing is nearer than the least so far.
            at += here - least
            if at >= length:
                return least
            u, v = au + at * du, av + at * dv
            if here != least:
                here = self._surely(u, v)
                if here > least + 1.0:
                    continue
                here = self._away(u, v)
            # On the edge of a cell, the next cell counts.
            column, row = math.floor(u + math.copysign(_HAIR, du)), math.floor(v + math.copysign(_HAIR, dv))
            if 0 <= column < columns and 0 <= row < rows:
                to_u = (column + (du > 0.0) - u) / du if du else math.inf
                to_v = (row + (dv > 0.0) - v) / dv if dv else math.inf
                end = min(at + min(to_u, to_v), length)
                near, _, far = self._near(column, row)
            else:
                end, near, far = min(at + max(1.0, 0.25 * here), length), (), (0.0, 0.0, 0.0, 0.0)
            then = self._away(au + end * du, av + end * dv)
            if far is not None:
                # No place between these two is nearer than this.
                least = min(least, max((here + then - (end - at)) / 2.0, 0.0))
            else:
                # The nearest place is one of the two ends, or next to a corner of a box.
                least = min(least, then)
                for low_u, low_v, high_u, high_v in near:
                    for cu, cv in ((low_u, low_v), (low_u, high_v), (high_u, low_v), (high_u, high_v)):
                        along = (cu - au) * du + (cv - av) * dv
                        if at < along < end:
                            least = min(least, abs((cu - au) * dv - (cv - av) * du))
            if least < little or least <= 0.0:
                return 0.0
            at, here = end, then

    def _near(self, column: int, row: int) -> Near:
        """Return what may be nearest to a place in a cell; cached."""
        found = self._known.get((column, row))
        if found is None:
            if len(self._known) >= _MOST:
                self._known.clear()
            found = self._known[column, row] = self._candidates(column, row)
        return found

    def _candidates(self, column: int, row: int) -> Near:
        place = column // _BLOCK, row // _BLOCK
        far: Four | None = None
        block = self._blocks.get(place)
        if block is None or not block.exact:
            corner = self.corners.item
            a, b = corner(row, column), corner(row, column + 1)
            c, d = corner(row + 1, column), corner(row + 1, column + 1)
            least = max(a, b, c, d) - _DIAGONAL
            if least >= EXACT_CELLS:
                return (), (), (a, b, c, d)
            if least + 2.0 * _DIAGONAL > EXACT_CELLS:
                far = a, b, c, d
            block = block or self._block(*place)
        cell = row % _BLOCK * _BLOCK + column % _BLOCK
        near = tuple(block.boxes[block.starts[cell] : block.starts[cell + 1]])
        ways = tuple([_way(column, low_u, high_u) + _way(row, low_v, high_v) for low_u, low_v, high_u, high_v in near])
        return near, ways, far

    def _block(self, column: int, row: int) -> _Block:
        """Return the boxes around a block of cells; cached."""
        if len(self._blocks) >= _MOST_BLOCKS:
            self._blocks.clear()
        low_column, low_row = column * _BLOCK, row * _BLOCK
        part = self.corners[low_row : low_row + _BLOCK + 1, low_column : low_column + _BLOCK + 1]
        farthest = float(part.max())
        reach = math.ceil(min(farthest * (1.0 + 1e-5), EXACT_CELLS + _DIAGONAL) + _DIAGONAL) + 1
        boxes = window(
            self.occupied,
            low_column - reach, low_row - reach, low_column + _BLOCK + reach, low_row + _BLOCK + reach,
        )  # fmt: skip
        apart_u, most_u = _apart(low_column, boxes[:, 0], boxes[:, 2])
        apart_v, most_v = _apart(low_row, boxes[:, 1], boxes[:, 3])
        # Anywhere in a cell, the nearest box is at most as far as the least of the boxes' upper bounds.
        most = (most_v[:, None] + most_u).min(axis=2, initial=_INFINITE)
        nearest = apart_v[:, None] + apart_u <= most[..., None]
        taken = self.occupied[low_row : low_row + _BLOCK, low_column : low_column + _BLOCK]
        nearest[: taken.shape[0], : taken.shape[1]][taken] = False
        cells, which = nearest.reshape(_BLOCK * _BLOCK, -1).nonzero()
        starts = np.searchsorted(cells, _CELLS).tolist()
        listed: list[Four] = [*map(tuple, boxes.tolist())]
        exact = farthest + _DIAGONAL <= EXACT_CELLS
        found = self._blocks[column, row] = _Block([listed[at] for at in which.tolist()], starts, exact)
        return found


def _way(cell: int, low: float, high: float) -> tuple[float, float]:
    """Return the way from places of a cell to a rectangle, along one axis, as a sign and an offset."""
    return (-1.0, low) if cell < low else (1.0, -high) if cell >= high else (0.0, 0.0)


def _apart(low: int, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the squares of the least and largest distances of boxes from the cells of a block along one axis."""
    cells = low + np.arange(_BLOCK)[:, None]
    least = np.maximum(np.maximum(starts - cells - 1, cells - ends), 0)
    most = np.maximum(np.maximum(starts - cells, cells + 1 - ends), 0)
    return least * least, most * most


@lru_cache(maxsize=2)
def field_of(grid: GridMap) -> Field:
    """Return the distances of a map; cached, since they take seconds to compute."""
    return Field(grid)
