"""The boxes around a place, found quickly however many there are."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from soter.geometry.workspace import Box
from soter_sim.sweep import BoxEdges, point_to_box

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
