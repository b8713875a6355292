"""Exact distances and times of impact of bodies that move along straight chords, to polygons.

`soter_sim.sweep` does the same for boxes. A polygon is a tuple of corners, in order; it may have any shape. Nothing
here is shared with the geometry that robots use: distances are those to the edges, and a point is inside if a ray from
it crosses them an odd number of times.
"""

from __future__ import annotations

from math import hypot, inf, sqrt
from typing import Final

from soter_sim.sweep import enter_disc, point_to_chord

Polygon = tuple[tuple[float, float], ...]

_TOUCHES_M: Final = 1e-12


def inside(x: float, y: float, polygon: Polygon) -> bool:
    """Return whether a point is in a polygon."""
    odd = False
    ax, ay = polygon[-1]
    for bx, by in polygon:
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            odd = not odd
        ax, ay = bx, by
    return odd


def point_to_polygon(x: float, y: float, polygon: Polygon) -> float:
    """Return the signed distance from a point to a polygon: negative inside, by the depth."""
    least = inf
    ax, ay = polygon[-1]
    for bx, by in polygon:
        dx, dy = bx - ax, by - ay
        ex, ey = x - ax, y - ay
        at = ex * dx + ey * dy
        if at > 0.0:
            square = dx * dx + dy * dy
            at = 1.0 if at >= square else at / square
            ex, ey = ex - at * dx, ey - at * dy
        gap = ex * ex + ey * ey
        if gap < least:
            least = gap
        ax, ay = bx, by
    return -sqrt(least) if inside(x, y, polygon) else sqrt(least)


def chord_to_polygon(x: float, y: float, dx: float, dy: float, polygon: Polygon) -> float:
    """Return the least signed distance from a chord's points to a polygon.

    Exact outside; for a chord that enters the polygon, the depth is that of its deeper end.
    """
    ends = min(point_to_polygon(x, y, polygon), point_to_polygon(x + dx, y + dy, polygon))
    if ends <= 0.0 or (dx == 0.0 and dy == 0.0):
        return ends
    if crossings(x, y, dx, dy, polygon):
        return 0.0
    return min(ends, *(point_to_chord(cx, cy, x, y, dx, dy) for cx, cy in polygon))


def crossings(x: float, y: float, dx: float, dy: float, polygon: Polygon) -> list[float]:
    """Return the parameters, from 0 to 1, at which a chord crosses the edges of a polygon, in order."""
    found = []
    ax, ay = polygon[-1]
    for bx, by in polygon:
        ex, ey = bx - ax, by - ay
        cross = dx * ey - dy * ex
        if cross != 0.0:
            at = ((ax - x) * ey - (ay - y) * ex) / cross
            along = ((ax - x) * dy - (ay - y) * dx) / cross
            if 0.0 <= at <= 1.0 and 0.0 <= along <= 1.0:
                found.append(at)
        ax, ay = bx, by
    return sorted(found)


def meet_polygon(x: float, y: float, dx: float, dy: float, polygon: Polygon, radius: float) -> float:
    """Return when a disc that moves along a chord meets a polygon; infinite if it does not.

    A disc that already touches or overlaps an edge meets it at 0 if it moves towards it, and not at all if not.
    """
    met = inf
    ax, ay = polygon[-1]
    for bx, by in polygon:
        met = min(met, _meet_edge(x, y, dx, dy, ax, ay, bx, by, radius))
        ax, ay = bx, by
    return met


def _meet_edge(
    x: float, y: float, dx: float, dy: float, ax: float, ay: float, bx: float, by: float, radius: float
) -> float:
    ex, ey = bx - ax, by - ay
    length = hypot(ex, ey)
    if length == 0.0:
        return inf
    ux, uy = ex / length, ey / length
    along, off = (x - ax) * ux + (y - ay) * uy, (x - ax) * uy - (y - ay) * ux
    away, closing = abs(off), (dx * uy - dy * ux) * (1.0 if off >= 0.0 else -1.0)
    if 0.0 <= along <= length:
        if away <= radius + _TOUCHES_M:
            return 0.0 if closing < 0.0 else inf
    elif hypot(x - (ax if along < 0.0 else bx), y - (ay if along < 0.0 else by)) <= radius + _TOUCHES_M:
        cx, cy = (ax, ay) if along < 0.0 else (bx, by)
        return 0.0 if (x - cx) * dx + (y - cy) * dy < 0.0 else inf
    met = inf
    if closing < 0.0 and away > radius:
        at = (away - radius) / -closing
        if 0.0 <= along + at * (dx * ux + dy * uy) <= length:
            met = at
    return min(met, enter_disc(x - ax, y - ay, dx, dy, radius), enter_disc(x - bx, y - by, dx, dy, radius))
