"""Distances to the outside of a fence with very many edges, which need not be exact far away from it. Metres, ENU.

Far from such a fence several edges may be nearest to the points of a square in which they are looked up; of a simpler
fence inside it, it is mostly one.
"""

from __future__ import annotations

import math
from typing import Final

from soter.geometry.convex import Pieces
from soter.geometry.nearest import Nearest, Part

_EXACT: Final = 10.0
"""Up to so many times the largest error nothing is changed."""


class FarPieces(Nearest):
    """Distances that are those to simpler pieces where they are large.

    With d and g, the distances to the pieces and to the simpler ones that contain them, and E, the distance up to which
    nothing is changed, the distance is

        f = d if d <= E, else max(E, g)

    Since g <= d, f is no more than d; it is continuous where d = E, so it is 1-Lipschitz, as d and g are.

    Args:
        near: the distances to the pieces.
        simpler: the pieces that contain them, with the same cells.
        under_m: how far the simpler ones extend beyond the others, at most; E is ten times that.
    """

    def __init__(self, near: Nearest, simpler: Pieces, under_m: float) -> None:
        super().__init__(near.part_m)
        self._near: Final = near
        self._simpler: Final = simpler
        self._under_m: Final = under_m
        self._beyond_m: Final = _EXACT * under_m
        self._either: Final[Part] = None, None, (), (_Either(near, simpler, self._beyond_m),)

    def part(self, column: int, row: int) -> Part:
        far_m = self._simpler.distance_m((column + 0.5) * self.part_m, (row + 0.5) * self.part_m)
        wide_m = self.part_m * math.sqrt(0.5) * (1.0 + 1e-9)
        if far_m - wide_m >= self._beyond_m:
            return self._simpler.at(column, row)
        return self._either if far_m + self._under_m + wide_m > self._beyond_m else self._near.at(column, row)


class _Either:
    """All pieces, where some distances are more than E and others are not."""

    def __init__(self, near: Nearest, simpler: Pieces, beyond_m: float) -> None:
        self._near, self._simpler, self._beyond_m = near, simpler, beyond_m

    def distance_m(self, x_m: float, y_m: float) -> float:
        near_m = self._near.distance_m(x_m, y_m)
        return near_m if near_m <= self._beyond_m else max(self._beyond_m, self._simpler.distance_m(x_m, y_m))
