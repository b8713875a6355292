"""Maps of square cells, occupied or free, anywhere and at any angle. Metres, ENU.

A map is a set of boxes: what the assurance argument says of convex pieces holds of its cells.
"""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.convex import Point, Ring

Bits = NDArray[np.bool_]
Rectangles = NDArray[np.int64]
"""Rows of low column, low row, high column, high row; the high ones are not part of it."""

MAX_CELLS: Final = 36_000_000
_DRAWN: Final = 4000


@dataclass(frozen=True, slots=True)
class GridMap:
    """Which cells of a map are occupied, as plain values that go from process to process.

    Attributes:
        columns: how many cells wide.
        rows: how many cells high.
        cell_m: side of a cell.
        x_m: the map's corner from which columns and rows count, east.
        y_m: the same, north.
        yaw_rad: in which direction columns count, counter-clockwise from east.
        packed: the cells, row by row: bits, compressed by zlib, in base64.
        height_m: how high what is occupied is.
    """

    columns: int
    rows: int
    cell_m: float
    x_m: float
    y_m: float
    yaw_rad: float
    packed: str = field(repr=False)
    height_m: float = 1.0

    def __post_init__(self) -> None:
        pose = (self.x_m, self.y_m, self.yaw_rad)
        if not (0.0 < self.cell_m < math.inf and all(map(math.isfinite, pose)) and min(self.columns, self.rows) > 0):
            raise ValueError(f"no map has cells of {self.cell_m:g} m, {self.columns} x {self.rows} of them, at {pose}")

    def occupied(self) -> Bits:
        """Return which cells are occupied, by row and column.

        Raises:
            ValueError: it is not a map of so many cells.
        """
        return _unpacked(self.packed, self.rows, self.columns)

    def corner(self, column: float, row: float) -> Point:
        """Return where a place of the map is, counted in cells from its corner."""
        along, across = column * self.cell_m, row * self.cell_m
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.x_m + along * cos - across * sin, self.y_m + along * sin + across * cos

    def ring(self, low_column: float, low_row: float, high_column: float, high_row: float) -> Ring:
        """Return the corners of a rectangle of cells."""
        return (
            self.corner(low_column, low_row),
            self.corner(high_column, low_row),
            self.corner(high_column, high_row),
            self.corner(low_column, high_row),
        )

    def rings(self) -> list[Ring]:
        """Return rectangles that together are what is occupied."""
        return [self.ring(*each) for each in _fewest(self.occupied()).tolist()]

    def outlines(self) -> list[Ring]:
        """Return rectangles for the eye: those of larger cells where there are too many to draw."""
        occupied, side = self.occupied(), 1
        while len(found := _fewest(occupied)) > _DRAWN:
            side *= 2
            high, wide = -(-occupied.shape[0] // 2), -(-occupied.shape[1] // 2)
            even = np.zeros((2 * high, 2 * wide), dtype=np.bool_)
            even[: occupied.shape[0], : occupied.shape[1]] = occupied
            occupied = np.asarray(even.reshape(high, 2, wide, 2).any(axis=(1, 3)), dtype=np.bool_)
        most = np.array([self.columns, self.rows, self.columns, self.rows])
        return [self.ring(*each) for each in np.minimum(found * side, most).tolist()]


def pack(occupied: Bits) -> str:
    """Return cells as `GridMap.packed` has them."""
    return base64.b64encode(zlib.compress(np.packbits(occupied).tobytes(), 6)).decode("ascii")


@lru_cache(maxsize=2)
def _unpacked(packed: str, rows: int, columns: int) -> Bits:
    if not 0 < rows * columns <= MAX_CELLS:
        raise ValueError(f"a map of {columns} x {rows} cells, allowed: up to {MAX_CELLS} cells")
    count = -(-rows * columns // 8)
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(packed, validate=True), count + 1)
    except (binascii.Error, zlib.error) as failure:
        raise ValueError(f"a map's cells cannot be unpacked: {failure}") from failure
    if len(data) != count:
        raise ValueError(f"a map of {columns} x {rows} cells has {len(data)} bytes of cells, not {count}")
    bits = np.unpackbits(np.frombuffer(data, dtype=np.uint8), count=rows * columns)
    found = bits.reshape(rows, columns).view(np.bool_)
    found.setflags(write=False)
    return found


def merged(occupied: Bits) -> Rectangles:
    """Return rectangles that together are the occupied cells and do not overlap: equal runs of rows, put together."""
    if not occupied.any():
        return np.zeros((0, 4), dtype=np.int64)
    padded = np.zeros((occupied.shape[0], occupied.shape[1] + 2), dtype=np.bool_)
    padded[:, 1:-1] = occupied
    # Where a row changes from free to occupied and back, in turns.
    rows, edges = np.nonzero(padded[:, 1:] != padded[:, :-1])
    rows, starts, ends = rows[::2], edges[::2], edges[1::2]
    order = np.lexsort((rows, ends, starts))
    rows, starts, ends = rows[order], starts[order], ends[order]
    begins = np.ones(len(rows), dtype=np.bool_)
    begins[1:] = (np.diff(starts) != 0) | (np.diff(ends) != 0) | (np.diff(rows) != 1)
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(rows)) - 1
    return np.stack([starts[first], rows[first], ends[first], rows[last] + 1], axis=1)


def _fewest(occupied: Bits) -> Rectangles:
    """Return the rectangles that rows or columns make, whichever are fewer."""
    by_rows, by_columns = merged(occupied), merged(occupied.T)
    return by_rows if len(by_rows) <= len(by_columns) else by_columns[:, [1, 0, 3, 2]]


def window(occupied: Bits, low_column: int, low_row: int, high_column: int, high_row: int) -> Rectangles:
    """Return rectangles for the occupied cells of a part of a map; of what reaches beyond it, the part inside."""
    low_column, low_row = max(low_column, 0), max(low_row, 0)
    found = merged(occupied[low_row : max(high_row, low_row), low_column : max(high_column, low_column)])
    found += np.array([low_column, low_row, low_column, low_row])
    return found
