"""The boxes or polygons around a place, found quickly however many there are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot
from typing import Any, Final

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

    Attributes:
        all: the polygons' corners.
    """

    __slots__ = ("_bounds", "_cells", "all")

    point_to = staticmethod(point_to_polygon)
    chord_to = staticmethod(chord_to_polygon)
    meet = staticmethod(meet_polygon)

    def __init__(self, polygons: Sequence[Polygon]) -> None:
        self.all: tuple[Polygon, ...] = tuple(polygons)
        self._bounds = [
            (min(x for x, _ in each), min(y for _, y in each), max(x for x, _ in each), max(y for _, y in each))
            for each in self.all
        ]
        self._cells: dict[tuple[int, int], tuple[Polygon, ...]] = {}

    def near(self, x: float, y: float) -> tuple[Polygon, ...]:
        """Return all polygons nearer to a place than `NEAR_M`, and maybe others; `all` itself if they are few."""
        if len(self.all) <= _FEW:
            return self.all
        cell = (int(x // _CELL_M), int(y // _CELL_M))
        found = self._cells.get(cell)
        if found is None:
            middle_x, middle_y = (cell[0] + 0.5) * _CELL_M, (cell[1] + 0.5) * _CELL_M
            found = self._cells[cell] = tuple(
                polygon
                for polygon, (low_x, low_y, high_x, high_y) in zip(self.all, self._bounds, strict=True)
                if hypot(max(low_x - middle_x, middle_x - high_x, 0.0), max(low_y - middle_y, middle_y - high_y, 0.0))
                <= NEAR_M + _CELL_M
            )
        return found


def obstacles_of(workspace: Workspace) -> Any:
    """Return what robots keep clear of, as `Boxes` or as `Polygons`; which of them nobody needs to know."""
    if isinstance(workspace, Site):
        return Polygons([area.ring for area in workspace.plan.areas])
    return Boxes(workspace.boxes)
