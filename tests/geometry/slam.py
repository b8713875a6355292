"""Maps such as a robot makes of a building: a lidar in many places, off by some centimetres, and spots of noise.

python -m tests.geometry.slam examples/worlds/flat.png     draws the map that SOTER ships
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Wall = tuple[float, float, float, float]
"""West, south, east and north side in metres."""

CELL_M = 0.05
FREE, UNKNOWN, OCCUPIED = 254, 205, 0
_RAYS = 360
_RANGE_M = 5.0
_STEP_M = 0.025
_APART_M = 0.6

FLAT: tuple[Wall, ...] = (
    (0.4, 0.4, 12.4, 0.6), (0.4, 10.2, 12.4, 10.4), (0.4, 0.4, 0.6, 10.4), (12.2, 0.4, 12.4, 10.4),
    (0.4, 4.4, 2.2, 4.55), (3.6, 4.4, 7.8, 4.55), (9.2, 4.4, 12.4, 4.55),
    (0.4, 6.4, 4.4, 6.55), (5.8, 6.4, 12.4, 6.55), (6.4, 0.4, 6.55, 4.4), (7.4, 6.4, 7.55, 7.6), (7.4, 9.0, 7.55, 10.4),
    (1.4, 1.8, 2.6, 2.6), (9.0, 1.6, 9.8, 2.4), (2.8, 8.4, 3.4, 9.0), (9.6, 8.0, 10.2, 8.8),
)  # fmt: skip
"""Two rooms on each side of a hallway, and furniture."""


def drawn_map(walls: Sequence[Wall], size_m: tuple[float, float], seed: int) -> NDArray[np.uint8]:
    """Return what a robot would know of a building, as the picture of a map: its first row is in the north."""
    stream = np.random.default_rng(seed)
    columns, rows = (round(side / CELL_M) for side in size_m)
    middles = (np.arange(columns) + 0.5) * CELL_M, (np.arange(rows) + 0.5) * CELL_M
    x, y = np.meshgrid(*middles)
    solid = np.zeros((rows, columns), dtype=np.bool_)
    for west, south, east, north in walls:
        solid |= (x >= west) & (x <= east) & (y >= south) & (y <= north)
    odds = np.zeros((rows, columns))
    steps = np.arange(_STEP_M, _RANGE_M, _STEP_M)
    for at_x in np.arange(_APART_M, size_m[0], _APART_M):
        for at_y in np.arange(_APART_M, size_m[1], _APART_M):
            in_house = min(west for west, *_ in walls) < at_x < max(east for _, _, east, _ in walls)
            in_house &= min(south for _, south, *_ in walls) < at_y < max(north for *_, north in walls)
            if not in_house or solid[int(at_y / CELL_M), int(at_x / CELL_M)]:
                continue
            angles = np.arange(_RAYS) * math.tau / _RAYS
            ray_x, ray_y = at_x + np.outer(np.cos(angles), steps), at_y + np.outer(np.sin(angles), steps)
            hit = _looked_up(solid, ray_x, ray_y, outside=True)
            first = np.where(hit.any(axis=1), hit.argmax(axis=1), len(steps) - 1)
            # Where the robot believes to be, and what it measures.
            off_x, off_y = stream.normal(0.0, 0.01, 2)
            turned = angles + stream.normal(0.0, 0.004)
            seen_m = steps[first] + stream.normal(0.0, 0.012, _RAYS)
            shown_x, shown_y = (
                at_x + off_x + np.outer(np.cos(turned), steps),
                at_y + off_y + np.outer(np.sin(turned), steps),
            )
            before = steps[None, :] < seen_m[:, None] - CELL_M
            _add(odds, shown_x[before], shown_y[before], -0.3)
            ends = hit.any(axis=1)
            _add(
                odds,
                at_x + off_x + np.cos(turned[ends]) * seen_m[ends],
                at_y + off_y + np.sin(turned[ends]) * seen_m[ends],
                1.2,
            )
    picture = np.full((rows, columns), UNKNOWN, dtype=np.uint8)
    picture[odds < -0.6] = FREE
    picture[odds > 0.6] = OCCUPIED
    picture[stream.random((rows, columns)) < 2e-4] = OCCUPIED
    return picture[::-1]


def _looked_up(
    cells: NDArray[np.bool_], x: NDArray[np.float64], y: NDArray[np.float64], *, outside: bool
) -> NDArray[np.bool_]:
    column, row = (x / CELL_M).astype(int), (y / CELL_M).astype(int)
    inside = (x >= 0.0) & (y >= 0.0) & (column < cells.shape[1]) & (row < cells.shape[0])
    found = np.full(x.shape, outside)
    found[inside] = cells[row[inside], column[inside]]
    return found


def _add(odds: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], value: float) -> None:
    """Add to each cell once that one of the places is in."""
    column, row = (x / CELL_M).astype(int), (y / CELL_M).astype(int)
    inside = (x >= 0.0) & (y >= 0.0) & (column < odds.shape[1]) & (row < odds.shape[0])
    cells = np.unique(row[inside] * odds.shape[1] + column[inside])
    odds.ravel()[cells] += value


if __name__ == "__main__":
    Image.fromarray(drawn_map(FLAT, (12.8, 10.8), 1)).save(Path(sys.argv[1]), optimize=True)
