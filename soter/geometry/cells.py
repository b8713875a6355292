"""The cells of a map as arrays of bits: packed, unpacked, and merged into rectangles."""

from __future__ import annotations

import base64
import binascii
import zlib
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.bool_]
Rectangles = NDArray[np.int64]
"""Rows of low column, low row, high column, high row; the high ones are exclusive."""

MAX_CELLS: Final = 36_000_000
_DRAWN: Final = 4000


def pack(occupied: Bits) -> str:
    """Return cells in the encoding of `soter.geometry.grid.GridMap.packed`."""
    return base64.b64encode(zlib.compress(np.packbits(occupied).tobytes(), 6)).decode("ascii")


@lru_cache(maxsize=2)
def unpacked(packed: str, rows: int, columns: int) -> Bits:
    """Return the cells that `pack` has packed.

    Raises:
        ValueError: it is not a map of this size.
    """
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
    """Return disjoint rectangles that cover the occupied cells exactly: equal runs of adjacent rows, merged."""
    if not occupied.any():
        return np.zeros((0, 4), dtype=np.int64)
    padded = np.zeros((occupied.shape[0], occupied.shape[1] + 2), dtype=np.bool_)
    padded[:, 1:-1] = occupied
    # Where a row changes from free to occupied and back, alternately.
    rows, edges = np.nonzero(padded[:, 1:] != padded[:, :-1])
    rows, starts, ends = rows[::2], edges[::2], edges[1::2]
    order = np.lexsort((rows, ends, starts))
    rows, starts, ends = rows[order], starts[order], ends[order]
    begins = np.ones(len(rows), dtype=np.bool_)
    begins[1:] = (np.diff(starts) != 0) | (np.diff(ends) != 0) | (np.diff(rows) != 1)
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(rows)) - 1
    return np.stack([starts[first], rows[first], ends[first], rows[last] + 1], axis=1)


def fewest(occupied: Bits) -> Rectangles:
    """Return the merged rectangles, by rows or by columns, whichever are fewer."""
    by_rows, by_columns = merged(occupied), merged(occupied.T)
    return by_rows if len(by_rows) <= len(by_columns) else by_columns[:, [1, 0, 3, 2]]


def drawn(occupied: Bits, most: tuple[int, int, int, int]) -> list[list[int]]:
    """Return rectangles to draw, none beyond `most`; of larger cells if there are too many."""
    side = 1
    while len(found := fewest(occupied)) > _DRAWN:
        side *= 2
        high, wide = -(-occupied.shape[0] // 2), -(-occupied.shape[1] // 2)
        even = np.zeros((2 * high, 2 * wide), dtype=np.bool_)
        even[: occupied.shape[0], : occupied.shape[1]] = occupied
        occupied = np.asarray(even.reshape(high, 2, wide, 2).any(axis=(1, 3)), dtype=np.bool_)
    return list(np.minimum(found * side, np.array(most)).tolist())


def window(occupied: Bits, low_column: int, low_row: int, high_column: int, high_row: int) -> Rectangles:
    """Return rectangles that cover the occupied cells of a part of a map, clipped to that part."""
    low_column, low_row = max(low_column, 0), max(low_row, 0)
    found = merged(occupied[low_row : max(high_row, low_row), low_column : max(high_column, low_column)])
    found += np.array([low_column, low_row, low_column, low_row])
    return found
