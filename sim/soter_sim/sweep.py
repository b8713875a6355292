"""Exact distances and times of impact of bodies that move along straight chords.

Boxes are (low_x, low_y, high_x, high_y) in metres. A chord runs from (x, y) by (dx, dy) while its parameter goes
from 0 to 1.
"""

from __future__ import annotations

from math import hypot, inf, sqrt

BoxEdges = tuple[float, float, float, float]


def point_to_box(x: float, y: float, box: BoxEdges) -> float:
    """Return the signed distance from a point to a box: negative inside, by the depth."""
    low_x, low_y, high_x, high_y = box
    west, east, south, north = low_x - x, x - high_x, low_y - y, y - high_y
    # Conditional expressions: this is called so often that calls of max() would cost noticeable time.
    dx = west if west > east else east  # noqa: FURB136
    dy = south if south > north else north  # noqa: FURB136
    if dx > 0.0:
        return sqrt(dx * dx + dy * dy) if dy > 0.0 else dx
    return dx if dx > dy else dy  # noqa: FURB136


def point_to_chord(px: float, py: float, x: float, y: float, dx: float, dy: float) -> float:
    """Return the distance from a point to a chord."""
    length_sq = dx * dx + dy * dy
    if length_sq == 0.0:
        return hypot(px - x, py - y)
    at = ((px - x) * dx + (py - y) * dy) / length_sq
    at = 0.0 if at < 0.0 else min(at, 1.0)
    return hypot(px - x - at * dx, py - y - at * dy)


def chord_to_box(x: float, y: float, dx: float, dy: float, box: BoxEdges) -> float:
    """Return the least signed distance from a chord's points to a box.

    Exact outside; for a chord that enters the box, the depth is that of its deeper end.
    """
    ends = min(point_to_box(x, y, box), point_to_box(x + dx, y + dy, box))
    if ends <= 0.0 or (dx == 0.0 and dy == 0.0):
        return ends
    # Of a segment and a rectangle that do not meet, the nearest pair of points has an end of the segment or a corner.
    if 0.0 <= enter_rectangle(x, y, dx, dy, box) <= 1.0:
        return 0.0
    low_x, low_y, high_x, high_y = box
    return min(
        ends,
        point_to_chord(low_x, low_y, x, y, dx, dy),
        point_to_chord(low_x, high_y, x, y, dx, dy),
        point_to_chord(high_x, low_y, x, y, dx, dy),
        point_to_chord(high_x, high_y, x, y, dx, dy),
    )


def cross_rectangle(x: float, y: float, dx: float, dy: float, box: BoxEdges) -> tuple[float, float]:
    """Return the parameters between which a chord's line is in a closed rectangle; the first is larger if never."""
    low_x, low_y, high_x, high_y = box
    first, last = -inf, inf
    for at, step, low, high in ((x, dx, low_x, high_x), (y, dy, low_y, high_y)):
        if step == 0.0:
            if not low <= at <= high:
                return inf, -inf
            continue
        one, other = (low - at) / step, (high - at) / step
        if one > other:
            one, other = other, one
        first, last = max(first, one), min(last, other)
    return first, last


def enter_rectangle(x: float, y: float, dx: float, dy: float, box: BoxEdges) -> float:
    """Return the parameter at which a chord that starts outside enters a rectangle; infinite if never."""
    first, last = cross_rectangle(x, y, dx, dy, box)
    return first if 0.0 <= first <= last else inf


def enter_disc(rx: float, ry: float, dx: float, dy: float, radius: float) -> float:
    """Return when a point at (rx, ry) that moves by (dx, dy) gets to `radius` from the origin; infinite if never.

    A point that is already there or nearer does so at 0 if it moves towards the origin, and never if not.
    """
    closing = rx * dx + ry * dy
    if closing >= 0.0:
        return inf
    gap = rx * rx + ry * ry - radius * radius
    if gap <= 1e-12:
        return 0.0
    speed_sq = dx * dx + dy * dy
    root = closing * closing - speed_sq * gap
    if root < 0.0:
        return inf
    # The smaller root, written without a difference of nearly equal numbers.
    return gap / (sqrt(root) - closing)


def inside_disc(rx: float, ry: float, dx: float, dy: float, radius: float) -> tuple[float, float] | None:
    """Return the parameters in [0, 1] between which a moving point is nearer to the origin than `radius`, or None."""
    speed_sq = dx * dx + dy * dy
    gap = rx * rx + ry * ry - radius * radius
    if speed_sq == 0.0:
        return (0.0, 1.0) if gap < 0.0 else None
    closing = rx * dx + ry * dy
    root = closing * closing - speed_sq * gap
    if root <= 0.0:
        return None
    first, last = (-closing - sqrt(root)) / speed_sq, (-closing + sqrt(root)) / speed_sq
    if first >= 1.0 or last <= 0.0:
        return None
    return max(first, 0.0), min(last, 1.0)


def nearest_to_origin(rx: float, ry: float, dx: float, dy: float) -> float:
    """Return the least distance from the origin of a point that moves along a chord."""
    return point_to_chord(0.0, 0.0, rx, ry, dx, dy)


def meet_box(x: float, y: float, dx: float, dy: float, box: BoxEdges, radius: float) -> float:
    """Return when a disc that moves along a chord meets a box; infinite if it does not.

    A disc that already touches or overlaps the box meets it at 0 if it moves towards it, and not at all if not.
    """
    low_x, low_y, high_x, high_y = box
    if point_to_box(x, y, box) <= radius + 1e-12:
        return 0.0 if _moves_towards(x, y, dx, dy, box) else inf
    # The box grown by the radius is the union of two rectangles and four discs: take the first one entered.
    met = min(
        enter_rectangle(x, y, dx, dy, (low_x - radius, low_y, high_x + radius, high_y)),
        enter_rectangle(x, y, dx, dy, (low_x, low_y - radius, high_x, high_y + radius)),
    )
    for cx in (low_x, high_x):
        for cy in (low_y, high_y):
            met = min(met, enter_disc(x - cx, y - cy, dx, dy, radius))
    return met


def _moves_towards(x: float, y: float, dx: float, dy: float, box: BoxEdges) -> bool:
    low_x, low_y, high_x, high_y = box
    east, west, north, south = x - high_x, low_x - x, y - high_y, low_y - y
    out_x, out_y = max(east, west), max(north, south)
    away_x = dx if east > west else -dx
    away_y = dy if north > south else -dy
    if out_x > 0.0 and out_y > 0.0:
        return out_x * away_x + out_y * away_y < 0.0
    return (away_x if out_x > out_y else away_y) < 0.0
