"""Proofs over all states of a rectangle by looking at finitely many: an adaptive cover of square cells.

Whoever judges a cell says something about every point of it, from its centre and its half-diagonal: a quantity that
changes by at most 1 metre a metre (a distance, a clearance) differs by at most the half-diagonal anywhere in the cell.
A cell that cannot be judged is cut into four and judged again, down to the smallest size; what is left then is listed.
So the union of what is proved, what does not belong to the claim, and what is listed, is the whole rectangle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple


class Cell(NamedTuple):
    """A square of states.

    Attributes:
        x_m: centre, east.
        y_m: centre, north.
        half_m: half of the side.
    """

    x_m: float
    y_m: float
    half_m: float

    @property
    def radius_m(self) -> float:
        """Half of the diagonal: no point of the cell is farther from its centre."""
        return self.half_m * math.sqrt(2.0) * (1.0 + 1e-12)


class Status(Enum):
    """What is known about a cell: all of it is outside the claim, proved, or neither could be shown."""

    OUTSIDE = "outside"
    PROVED = "proved"
    UNKNOWN = "unknown"


class Judged(NamedTuple):
    """What a judge says about every state of a cell.

    Attributes:
        status: see there.
        cost: a bound that holds for all of the cell, such as a time; 0 where it is not proved.
        why: why it could not be shown.
    """

    status: Status
    cost: float = 0.0
    why: str = ""


OUTSIDE: Final = Judged(Status.OUTSIDE)


@dataclass(frozen=True, slots=True)
class Cover:
    """The outcome.

    Attributes:
        proved: cells of which every state is proved.
        unknown: cells of the smallest size that could not be proved, and why.
        cost: the largest bound of any proved cell.
        proved_m2: their area.
        unknown_m2: the area of those that could not be proved.
        least_side_m: side of the smallest cells.
    """

    proved: tuple[Cell, ...]
    unknown: tuple[tuple[Cell, str], ...]
    cost: float
    proved_m2: float
    unknown_m2: float
    least_side_m: float

    @property
    def complete(self) -> bool:
        """Whether the claim is proved, and is about something at all."""
        return bool(self.proved) and not self.unknown

    @property
    def share(self) -> float:
        """The part of the area of the claim that is proved."""
        whole = self.proved_m2 + self.unknown_m2
        return self.proved_m2 / whole if whole else 0.0


def cover(
    width_m: float, depth_m: float, judge: Callable[[Cell], Judged], side_m: float = 0.2, least_side_m: float = 0.0125
) -> Cover:
    """Judge every state of the rectangle from the origin to (width_m, depth_m).

    Args:
        width_m: of the rectangle; cells may reach a little beyond it.
        depth_m: the same.
        judge: see the module.
        side_m: of the cells to begin with.
        least_side_m: cells are not cut smaller than this.
    """
    if not 0.0 < least_side_m <= side_m:
        raise ValueError(f"least_side_m is {least_side_m}, allowed: above 0, at most side_m, which is {side_m}")
    proved: list[Cell] = []
    unknown: list[tuple[Cell, str]] = []
    cost, half_m, smallest_m = 0.0, side_m / 2.0, side_m
    columns, rows = math.ceil(width_m / side_m - 1e-9), math.ceil(depth_m / side_m - 1e-9)
    waiting = [
        Cell((2 * column + 1) * half_m, (2 * row + 1) * half_m, half_m)
        for column in reversed(range(columns))
        for row in reversed(range(rows))
    ]
    while waiting:
        cell = waiting.pop()
        judged = judge(cell)
        smallest_m = min(smallest_m, 2.0 * cell.half_m)
        if judged.status is Status.PROVED:
            proved.append(cell)
            cost = max(cost, judged.cost)
        elif judged.status is Status.UNKNOWN:
            if cell.half_m < least_side_m:
                unknown.append((cell, judged.why))
                continue
            half = cell.half_m / 2.0
            waiting += [Cell(cell.x_m + dx, cell.y_m + dy, half) for dx in (half, -half) for dy in (half, -half)]
    return Cover(
        tuple(proved), tuple(unknown), cost, _area(proved), _area([cell for cell, _ in unknown]), smallest_m
    )  # fmt: skip


def _area(cells: list[Cell]) -> float:
    return sum(4.0 * cell.half_m * cell.half_m for cell in cells)
