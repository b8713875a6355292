"""The boxes around a place, found quickly however many there are."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from soter.geometry.site import Site
from soter.geometry.workspace import Box, Workspace
from soter_sim.sweep import BoxEdges, chord_to_box, meet_box, point_to_box

NEAR_M: Final = 2.0
"""`Boxes.near` leaves out no box that is nearer than this."""

FEW: Final = 8
"""All of so many are near."""

CELL_M: Final = 1.0
"""Side of the cells in which what is near is looked up."""


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
        if len(self.all) <= FEW:
            return self.all
        cell = (int(x // CELL_M), int(y // CELL_M))
        found = self._cells.get(cell)
        if found is None:
            middle_x, middle_y = (cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M
            # From the middle to anywhere in the cell it is less than another cell's width.
            found = tuple(box for box in self.all if point_to_box(middle_x, middle_y, box) <= NEAR_M + CELL_M)
            self._cells[cell] = found
        return found


def obstacles_of(workspace: Workspace) -> Any:
    """Return what robots keep clear of, as `Boxes` or as `Polygons`; which of them nobody needs to know."""
    if isinstance(workspace, Site):
        # Imported here: a room of boxes needs no library for arrays, and most robots' programs have one.
        from soter_sim.polygons import Polygons

        if (grid := workspace.plan.map) is not None:
            return Polygons(grid.rings(), grid.yaw_rad)
        return Polygons([area.ring for area in workspace.plan.areas])
    return Boxes(workspace.boxes)
