"""Maps of square cells, occupied or free, anywhere and at any angle. Metres, ENU.

A map is a set of boxes: what the assurance argument says of convex pieces holds of its cells.
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
    """Which cells of a map are occupied, as plain values that go from process to process.

    Attributes:
        columns: how many cells wide.
        rows: how many cells high.
        cell_m: side of a cell.
        x_m: the map's corner from which columns and rows count, east.
        y_m: the same, north.
        yaw_rad: in which direction columns count, counter-clockwise from east.
        packed: the cells, row by row: bits, compressed by zlib, in base64.
        height_m: how high what is occupied is.
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
            ValueError: it is not a map of so many cells.
        """
        from soter.geometry.cells import unpacked

        return unpacked(self.packed, self.rows, self.columns)

    def corner(self, column: float, row: float) -> Point:
        """Return where a place of the map is, counted in cells from its corner."""
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
        """Return rectangles that together are what is occupied."""
        from soter.geometry.cells import fewest

        return [self.ring(*each) for each in fewest(self.occupied()).tolist()]

    def outlines(self) -> list[Ring]:
        """Return rectangles for the eye: those of larger cells where there are too many to draw."""
        # Imported here, as in the other methods: who has no map does without the library for arrays.
        from soter.geometry.cells import drawn

        most = (self.columns, self.rows, self.columns, self.rows)
        return [self.ring(*each) for each in drawn(self.occupied(), most)]
