"""The edges of many convex polygons in one table: distances from points and lines to dozens of them at once. Metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Edge = tuple[float, float, float, float, float]
"""Start, direction and length of an edge; its piece is on its left."""

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


class EdgesSeen(NamedTuple):
    """The edges of some pieces, seen from a point.

    Attributes:
        table: one edge a row: start, direction, length.
        starts: the first row of each piece.
        piece: the piece of each row, as an index into the pieces looked at.
        away: distance of each edge.
        along: how far along each edge the point is.
        off: how far the point is outside the line of each edge.
        inner: whether another piece is on the other side of each edge.
    """

    table: Floats
    starts: Indices
    piece: Indices
    away: Floats
    along: Floats
    off: Floats
    inner: NDArray[np.bool_]

    def facing(self, beside: NDArray[np.bool_], reach_m: float, half_m: float) -> tuple[Edge, ...]:
        """Return the edges that may be nearest to a point of a square around the viewpoint.

        Args:
            beside: which pieces to consider; the square is outside of each.
            reach_m: edges farther than this from the viewpoint are left out.
            half_m: half of the square's side.
        """
        rows, length = self.table, self.table[:, 4]
        wide = half_m * (np.abs(rows[:, 2]) + np.abs(rows[:, 3])) + 1e-9
        # The nearest point is on an edge straight across, or is a corner if the viewpoint is past the edge that ends
        # there and before the one that starts: each edge stands for its first corner, too. None is on an inner edge,
        # and from each corner an edge starts that is not.
        before = np.arange(-1, len(rows) - 1)
        before[self.starts[:-1]] = self.starts[1:] - 1
        before[self.starts[-1]] = len(rows) - 1
        across = (self.off + wide >= 0.0) & (self.along + wide >= 0.0) & (self.along - wide <= length)
        past = (self.along + wide >= length)[before]
        kept = beside[self.piece] & ~self.inner & (self.away <= reach_m)
        kept &= across | (past & (self.along - wide <= 0.0))
        return tuple(map(tuple, rows[kept].tolist()))


class Edges:
    """The edges of many pieces in one table, those of each counter-clockwise."""

    def __init__(self, pieces: Sequence[Sequence[Edge]]) -> None:
        counts = np.array([len(piece) for piece in pieces], dtype=np.intp)
        self._starts: Final = np.cumsum(counts) - counts
        self._counts: Final = counts
        self._table: Final[Floats] = np.array([edge for piece in pieces for edge in piece]).reshape(-1, 5)
        sides = [(one[:2], two[:2]) for piece in pieces for one, two in zip(piece, (*piece[1:], piece[0]), strict=True)]
        there = set(sides)
        self._inner: Final = np.array([(two, one) in there for one, two in sides], dtype=np.bool_)

    def rows(self, pieces: Indices) -> tuple[Indices, Indices, Indices]:
        """Return the rows of the edges of some pieces, where each piece begins, and the piece of each, as an index."""
        counts = self._counts[pieces]
        starts = np.cumsum(counts) - counts
        piece = np.repeat(np.arange(len(pieces)), counts)
        return np.arange(len(piece)) + (self._starts[pieces] - starts)[piece], starts, piece

    def look(self, pieces: Indices, x_m: float, y_m: float) -> tuple[Floats, EdgesSeen]:
        """Return the signed distances of a point from some pieces, and their edges as seen from it."""
        which, starts, piece = self.rows(pieces)
        rows = self._table[which]
        dx, dy = x_m - rows[:, 0], y_m - rows[:, 1]
        along, off = rows[:, 2] * dx + rows[:, 3] * dy, rows[:, 3] * dx - rows[:, 2] * dy
        aside = along - np.minimum(np.maximum(along, 0.0), rows[:, 4])
        away = np.hypot(aside, off)
        most = np.maximum.reduceat(off, starts)
        signed: Floats = np.where(most <= 0.0, most, np.minimum.reduceat(away, starts))
        return signed, EdgesSeen(rows, starts, piece, away, along, off, self._inner[which])

    def lines_m(self, pieces: Indices, a: Floats, b: Floats) -> Floats:
        """Return the distance of each straight line from the piece with the same index; 0 if they meet."""
        which, starts, pair = self.rows(pieces)
        x, y, ux, uy, length = self._table[which].T
        a, b = a[pair], b[pair]
        ax, ay, bx, by = a[:, 0] - x, a[:, 1] - y, b[:, 0] - x, b[:, 1] - y
        off_a, off_b = uy * ax - ux * ay, uy * bx - ux * by
        # A line meets a convex polygon if it enters through the lines of all edges before it leaves through any.
        with np.errstate(divide="ignore", invalid="ignore"):
            at = off_a / (off_a - off_b)
        parallel = np.where(off_a >= 0.0, math.inf, -math.inf)
        comes = np.where(off_b < off_a, at, np.where(off_b == off_a, parallel, -math.inf))
        goes = np.where(off_b > off_a, at, math.inf)
        meets = np.maximum(np.maximum.reduceat(comes, starts), 0.0) < np.minimum(np.minimum.reduceat(goes, starts), 1.0)
        # If they do not meet, the least distance is from an end of the line to an edge, or from a corner to the line.
        on_a, on_b = ux * ax + uy * ay, ux * bx + uy * by
        from_a = np.hypot(on_a - np.minimum(np.maximum(on_a, 0.0), length), off_a)
        from_b = np.hypot(on_b - np.minimum(np.maximum(on_b, 0.0), length), off_b)
        dx, dy = bx - ax, by - ay
        along = np.minimum(np.maximum(-(ax * dx + ay * dy) / np.maximum(dx * dx + dy * dy, 1e-300), 0.0), 1.0)
        corner = np.hypot(ax + along * dx, ay + along * dy)
        least = np.minimum.reduceat(np.minimum(np.minimum(from_a, from_b), corner), starts)
        found: Floats = np.where(meets, 0.0, least)
        return found
