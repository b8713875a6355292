"""Finds the boxes around a place, quickly however many there are."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import Any, Final

from soter.geometry.site import Site
from soter.geometry.workspace import Box, Workspace
from soter_sim.sweep import BoxEdges, chord_to_box, meet_box, point_to_box

NEAR_M: Final = 2.0
"""`Boxes.near` leaves out no box that is nearer than this, whatever is asked for."""

FEW: Final = 8
"""Up to this many boxes, all count as near."""

CELL_M: Final = 1.0
"""Side of the cells in which near boxes are looked up; those for a larger reach are larger."""


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
        self._cells: dict[tuple[float, int, int], tuple[BoxEdges, ...]] = {}

    def near(self, x: float, y: float, reach_m: float = NEAR_M) -> tuple[BoxEdges, ...]:
        """Return all boxes nearer to a place than `reach_m`, and maybe others; `all` itself if they are few."""
        if len(self.all) <= FEW or reach_m == inf:
            return self.all
        side_m = cell_m(reach_m)
        cell = side_m, int(x // side_m), int(y // side_m)
        found = self._cells.get(cell)
        if found is None:
            middle_x, middle_y = (cell[1] + 0.5) * side_m, (cell[2] + 0.5) * side_m
            # Every point of the cell is less than a cell's width from its middle.
            most_m = (NEAR_M / CELL_M + 1.0) * side_m
            found = tuple(box for box in self.all if point_to_box(middle_x, middle_y, box) <= most_m)
            self._cells[cell] = found
        return found


def cell_m(reach_m: float) -> float:
    """Return the side of the cells that are kept for a reach: `CELL_M`, doubled as often as it takes."""
    side_m = CELL_M
    while side_m * (NEAR_M / CELL_M) < reach_m:
        side_m *= 2.0
    return side_m


def obstacles_of(workspace: Workspace) -> Any:
    """Return the obstacles of a workspace, as `Boxes` or as `Polygons`, which are used in the same way."""
    if isinstance(workspace, Site):
        # Imported here: a room with boxes, which most robots' programs simulate, needs no library for arrays.
        from soter_sim.polygons import Polygons

        if (grid := workspace.plan.map) is not None:
            return Polygons(grid.rings(), grid.yaw_rad)
        return Polygons([area.ring for area in workspace.plan.areas])
    return Boxes(workspace.boxes)
