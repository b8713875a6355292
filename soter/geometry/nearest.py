"""Distances that are looked up by where a point is. Metres, ENU."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Final, Protocol

from soter.geometry.edges import Edge
from soter.geometry.workspace import Point

_floor, _hypot, _sqrt = math.floor, math.hypot, math.sqrt
_MOST: Final = 200_000
"""Most parts of the ground that are cached; after that the cache is cleared."""

_LOOKS: Final = 24
"""As many looks along a line cost less than to test it against all edges that it may come near."""

Line = tuple[float, float, float]
"""A direction, and what the distance from the line, on its right, is too large by without it."""


class Distant(Protocol):
    """Something that a point has a signed distance from, such as a piece."""

    def distance_m(self, x_m: float, y_m: float) -> float: ...


Part = tuple[Line | None, Point | None, tuple[Edge, ...], tuple[Distant, ...]]
"""What may be nearest to a point of a part of the ground.

First the line, if that is one edge straight across; the corner, if that is one; edges and things otherwise.
"""


def part_of(edges: tuple[Edge, ...], x_m: float, y_m: float, half_m: float) -> Part:
    """Return the part for a square that only these edges may be nearest to."""
    if len(edges) == 1:
        ax, ay, ux, uy, length = edges[0]
        along, wide = ux * (x_m - ax) + uy * (y_m - ay), half_m * (abs(ux) + abs(uy)) + 1e-9
        if wide < along < length - wide:
            return (ux, uy, uy * ax - ux * ay), None, (), ()
        if along < -wide:
            return None, (ax, ay), (), ()
    return None, None, edges, ()


class Nearest(ABC):
    """Signed distances to the nearest of many things.

    The ground is divided into squares; what may be nearest to the points of one is computed on first use and cached.

    Args:
        part_m: side of the squares.
    """

    def __init__(self, part_m: float) -> None:
        self.part_m: Final = part_m
        self._parts_per_m: Final = 1.0 / part_m
        self._parts: dict[tuple[int, int], Part] = {}

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point; infinite from nothing."""
        per_m = self._parts_per_m
        try:
            line, corner, edges, pieces = self._parts[_floor(x_m * per_m), _floor(y_m * per_m)]
        except KeyError:
            line, corner, edges, pieces = self.at(_floor(x_m * per_m), _floor(y_m * per_m))
        if line is not None:
            ux, uy, off = line
            return uy * x_m - ux * y_m - off
        if corner is not None:
            return _hypot(x_m - corner[0], y_m - corner[1])
        least = math.inf
        for ax, ay, ux, uy, length in edges:
            dx, dy = x_m - ax, y_m - ay
            along = ux * dx + uy * dy
            if along <= 0.0:
                square = dx * dx + dy * dy
            elif along < length:
                off = ux * dy - uy * dx
                square = off * off
            else:
                dx, dy = dx - ux * length, dy - uy * length
                square = dx * dx + dy * dy
            if square < least:
                least = square
        least = _sqrt(least)
        for piece in pieces:
            distance = piece.distance_m(x_m, y_m)
            if distance < least:
                least = distance
        return least

    def surely_keeps(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float) -> bool:
        """Return whether all of a straight line is so far away; False if that would take many looks to know.

        The distance changes by at most a metre per metre, so the line is clear as far around a place as that has to
        spare (sphere tracing: Hart, "Sphere tracing", The Visual Computer 12, 1996).
        """
        dx_m, dy_m = bx_m - ax_m, by_m - ay_m
        length_m = at_m = math.hypot(dx_m, dy_m)
        for _ in range(_LOOKS):
            share = at_m / length_m if length_m else 0.0
            spare_m = self.distance_m(ax_m + share * dx_m, ay_m + share * dy_m) - needed_m
            # Written so that NaN is not clear.
            if not spare_m > 0.0:
                return False
            if at_m <= spare_m:
                return True
            at_m -= spare_m
        return False

    @abstractmethod
    def part(self, column: int, row: int) -> Part:
        """Return what may be nearest to the points of a square; it is computed anew."""

    def at(self, column: int, row: int) -> Part:
        """Return the part of a square; cached."""
        found = self._parts.get((column, row))
        if found is None:
            if len(self._parts) >= _MOST:
                self._parts.clear()
            found = self._parts[column, row] = self.part(column, row)
        return found
