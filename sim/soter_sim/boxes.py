"""The boxes or polygons around a place, found quickly however many there are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import cos, sin
from typing import Any, Final

import numpy as np

from soter.geometry.site import Site
from soter.geometry.workspace import Box, Workspace
from soter_sim.shapes import Polygon, chord_to_polygon, meet_polygon, point_to_polygon
from soter_sim.sweep import BoxEdges, chord_to_box, meet_box, point_to_box

NEAR_M: Final = 2.0
"""`Boxes.near` leaves out no box that is nearer than this."""

_FEW: Final = 8
_CELL_M: Final = 1.0


class Boxes:
    """A fixed set of boxes.

    Args:
        boxes: the boxes.

    Attributes:
        all: the boxes' edges.
    """

    __slots__ = ("_cells", "all")

    point_to = staticmethod(point_to_box)
    chord_to = staticmethod(chord_to_box)
    meet = staticmethod(meet_box)

    def __init__(self, boxes: Iterable[Box]) -> None:
        self.all: tuple[BoxEdges, ...] = tuple((box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m) for box in boxes)
        self._cells: dict[tuple[int, int], tuple[BoxEdges, ...]] = {}

    def near(self, x: float, y: float) -> tuple[BoxEdges, ...]:
        """Return all boxes nearer to a place than `NEAR_M`, and maybe others; `all` itself if they are few."""
        if len(self.all) <= _FEW:
            return self.all
        cell = (int(x // _CELL_M), int(y // _CELL_M))
        found = self._cells.get(cell)
        if found is None:
            middle_x, middle_y = (cell[0] + 0.5) * _CELL_M, (cell[1] + 0.5) * _CELL_M
            # From the middle to anywhere in the cell it is less than another cell's width.
            found = tuple(box for box in self.all if point_to_box(middle_x, middle_y, box) <= NEAR_M + _CELL_M)
            self._cells[cell] = found
        return found


class Polygons:
    """What `Boxes` is, for polygons.

    Args:
        polygons: the polygons.
        yaw_rad: the direction that most of their edges have; what is near is looked up along it.

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
        self._cells: dict[tuple[int, int], tuple[Polygon, ...]] = {}

    def near(self, x: float, y: float) -> tuple[Polygon, ...]:
        """Return all polygons nearer to a place than `NEAR_M`, and maybe others; `all` itself if they are few."""
        if len(self.all) <= _FEW:
            return self.all
        x, y = self._turned(x, y)
        cell = (int(x // _CELL_M), int(y // _CELL_M))
        found = self._cells.get(cell)
        if found is None:
            middle = (np.array(cell) + 0.5) * _CELL_M
            apart = np.maximum(np.maximum(self._bounds[:, :2] - middle, middle - self._bounds[:, 2:]), 0.0)
            chosen = np.flatnonzero(np.hypot(apart[:, 0], apart[:, 1]) <= NEAR_M + _CELL_M)
            found = self._cells[cell] = tuple(self.all[index] for index in chosen.tolist())
        return found

    def _turned(self, x: float, y: float) -> tuple[float, float]:
        return x * self._cos + y * self._sin, y * self._cos - x * self._sin


def obstacles_of(workspace: Workspace) -> Any:
    """Return what robots keep clear of, as `Boxes` or as `Polygons`; which of them nobody needs to know."""
    if isinstance(workspace, Site):
        if (grid := workspace.plan.map) is not None:
            return Polygons(grid.rings(), grid.yaw_rad)
        return Polygons([area.ring for area in workspace.plan.areas])
    return Boxes(workspace.boxes)
