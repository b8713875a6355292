"""The workspace that the planners' tests share, and how to judge a path in it without the code under test."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from soter.geometry.workspace import Box, Workspace
from soter.stack.planners.base import Point

RADIUS_M = 0.105
GROWN_M = RADIUS_M + 0.15

CASE = Workspace(5.0, 5.0, (Box(2.0, 0.0, 3.0, 1.0), Box(2.0, 3.0, 3.0, 4.0), Box(1.0, 2.0, 1.9, 3.0)), robots=())


def depth_m(x: float, y: float) -> float:
    """How far a point is inside a grown box or outside the fence; negative where it is free."""
    boxes = [
        -Box(b.low_x_m - GROWN_M, b.low_y_m - GROWN_M, b.high_x_m + GROWN_M, b.high_y_m + GROWN_M).distance_m(x, y)
        for b in CASE.boxes
    ]
    return max(*boxes, Box(0.0, 0.0, CASE.width_m, CASE.depth_m).distance_m(x, y))


def along(path: Sequence[Point]) -> Iterator[Point]:
    """Points at most 5 mm apart on the way."""
    for (ax, ay), (bx, by) in pairwise(path):
        number = math.ceil(math.dist((ax, ay), (bx, by)) / 0.005) + 1
        for k in range(number + 1):
            yield ax + (bx - ax) * k / number, ay + (by - ay) * k / number


def length_m(path: Sequence[Point]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(path))
