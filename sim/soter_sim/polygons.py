"""Finds the polygons around a place, quickly however many there are."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, sin

import numpy as np

from soter_sim.boxes import CELL_M, FEW, NEAR_M, cell_m
from soter_sim.shapes import Polygon, chord_to_polygon, meet_polygon, point_to_polygon


class Polygons:
    """A fixed set of polygons, as `Boxes` is of boxes.

    Args:
        polygons: the polygons.
        yaw_rad: the direction of most of their edges, along which the cells for look-ups lie.

    Attributes:
        all: the polygons' corners.
    """

    __slots__ = ("_bounds", "_cells", "_cos", "_sin", "all")

    point_to = staticmethod(point_to_polygon)
    chord_to = staticmethod(chord_to_polygon)
    meet = staticmethod(meet_polygon)

    def __init__(self, polygons: Sequence[Polygon], yaw_rad: float = 0.0) -> None:
        self.all: tuple[Polygon, ...] = tuple(polygons)
        self._cos, self._sin = cos(yaw_rad), sin(yaw_rad)
        turned = [[self._turned(*corner) for corner in each] for each in self.all]
        self._bounds = np.array(
            [(*np.min(each, axis=0), *np.max(each, axis=0)) for each in turned], dtype=np.float64
        ).reshape(-1, 4)
        self._cells: dict[tuple[float, int, int], tuple[Polygon, ...]] = {}

    def near(self, x: float, y: float, reach_m: float = NEAR_M) -> tuple[Polygon, ...]:
        """Return all polygons nearer to a place than `reach_m`, and maybe others; `all` itself if they are few."""
        if len(self.all) <= FEW or reach_m == inf:
            return self.all
        x, y = self._turned(x, y)
        side_m = cell_m(reach_m)
        cell = side_m, int(x // side_m), int(y // side_m)
        found = self._cells.get(cell)
        if found is None:
            middle = (np.array(cell[1:]) + 0.5) * side_m
            apart = np.maximum(np.maximum(self._bounds[:, :2] - middle, middle - self._bounds[:, 2:]), 0.0)
            chosen = np.flatnonzero(np.hypot(apart[:, 0], apart[:, 1]) <= (NEAR_M / CELL_M + 1.0) * side_m)
            found = self._cells[cell] = tuple(self.all[index] for index in chosen.tolist())
        return found

    def _turned(self, x: float, y: float) -> tuple[float, float]:
        return x * self._cos + y * self._sin, y * self._cos - x * self._sin
