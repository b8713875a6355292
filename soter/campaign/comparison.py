"""Compares two settings or two campaigns, run by run with the same seed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Final

from soter.campaign.conditions import figure
from soter.campaign.intervals import median
from soter.campaign.store import RunRow

FIGURES: Final = (
    "violations", "min_margin", "ac_share", "disengagements_total", "targets_reached", "longest_stall_s",
    "no_progress_s",
)  # fmt: skip
"""The figures that are compared."""


@dataclass(frozen=True)
class PairedDifference:
    """The difference of a figure between two sides, paired by seed.

    Attributes:
        pairs: how many pairs have the figure.
        left: its mean on the left.
        right: its mean on the right.
        middle: the median of right minus left; None below 6 pairs.
        low: the lower end of the median's exact interval at 95 %; None below 6 pairs.
        high: the upper end; None below 6 pairs.
    """

    figure: str
    pairs: int
    left: float
    right: float
    middle: float | None
    low: float | None
    high: float | None

    @property
    def shown(self) -> bool:
        """Whether the interval excludes 0."""
        return self.low is not None and self.high is not None and not self.low <= 0.0 <= self.high


def select(rows: Iterable[RunRow], wanted: Mapping[str, str]) -> list[RunRow]:
    """Return the runs whose axes (or `part`) have the wanted values."""
    return [
        row for row in rows
        if all((row.part if axis == "part" else row.axes.get(axis)) == name for axis, name in wanted.items())
    ]  # fmt: skip


def pairs(left: Sequence[RunRow], right: Sequence[RunRow], apart: Iterable[str]) -> list[tuple[RunRow, RunRow]]:
    """Return pairs of runs, left and right, with the same seed and the same axes except those in `apart`."""

    def key(row: RunRow) -> tuple[object, ...]:
        axes = {"part": row.part, **row.axes}
        return row.seed, *sorted((axis, name) for axis, name in axes.items() if axis not in apart)

    by_key = {key(row): row for row in right}
    return [(row, by_key[key(row)]) for row in left if key(row) in by_key]


def compare(paired: Sequence[tuple[RunRow, RunRow]]) -> list[PairedDifference]:
    """Return the differences of all figures that some pairs have."""
    found = []
    for name in FIGURES:
        both = [(a, b) for one, other in paired if (a := figure(one, name)) is not None
                and (b := figure(other, name)) is not None]  # fmt: skip
        if both:
            enclosed = median([b - a for a, b in both]) or (None, None, None)
            means = fmean(a for a, _ in both), fmean(b for _, b in both)
            found.append(PairedDifference(name, len(both), *means, *enclosed))
    return found
