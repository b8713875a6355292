"""Maps of square cells, occupied or free, anywhere and at any angle. Metres, ENU.

A map is a set of boxes: the assurance argument about convex pieces holds for its cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.geometry.workspace import Point, Ring

if TYPE_CHECKING:
    from soter.geometry.cells import Bits


@dataclass(frozen=True, slots=True)
class GridMap:
    """The occupied cells of a map, as plain values that can be sent between processes.

    Attributes:
        columns: width in cells.
        rows: height in cells.
        cell_m: side of a cell.
        x_m: the corner from which columns and rows count, east.
        y_m: the corner from which columns and rows count, north.
        yaw_rad: direction in which columns count, counter-clockwise from east.
        packed: the cells, row by row: bits, compressed by zlib, in base64.
        height_m: height of occupied cells.
    """

    columns: int
    rows: int
    cell_m: float
    x_m: float
    y_m: float
    yaw_rad: float
    packed: str = field(repr=False)
    height_m: float = 1.0

    def __post_init__(self) -> None:
        pose = (self.x_m, self.y_m, self.yaw_rad)
        if not (0.0 < self.cell_m < math.inf and all(map(math.isfinite, pose)) and min(self.columns, self.rows) > 0):
            raise ValueError(f"no map has cells of {self.cell_m:g} m, {self.columns} x {self.rows} of them, at {pose}")

    def occupied(self) -> Bits:
        """Return which cells are occupied, by row and column.

        Raises:
            ValueError: the packed cells are not a map of this size.
        """
        from soter.geometry.cells import unpacked

        return unpacked(self.packed, self.rows, self.columns)

    def corner(self, column: float, row: float) -> Point:
        """Return the position of a place in the map that is given in cells from the map's corner."""
        along, across = column * self.cell_m, row * self.cell_m
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.x_m + along * cos - across * sin, self.y_m + along * sin + across * cos

    def ring(self, low_column: float, low_row: float, high_column: float, high_row: float) -> Ring:
        """Return the corners of a rectangle of cells."""
        return (
            self.corner(low_column, low_row),
            self.corner(high_column, low_row),
            self.corner(high_column, high_row),
            self.corner(low_column, high_row),
        )

    def rings(self) -> list[Ring]:
        """Return rectangles that cover the occupied cells exactly."""
        from soter.geometry.cells import fewest

        return [self.ring(*each) for each in fewest(self.occupied()).tolist()]

    def outlines(self) -> list[Ring]:
        """Return rectangles to draw; of larger cells if there are too many."""
        # Imported here, as in the other methods: only maps need the library for arrays.
        from soter.geometry.cells import drawn

        most = (self.columns, self.rows, self.columns, self.rows)
        return [self.ring(*each) for each in drawn(self.occupied(), most)]
