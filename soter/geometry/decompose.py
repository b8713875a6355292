"""Decomposes polygons into convex pieces, when a workspace is read and never while a mission runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import shapely  # type: ignore[import-untyped]
from shapely import MultiPolygon, Polygon
from shapely import Point as Point_

from soter.geometry.workspace import Point, Ring

_SLIVER_M2: Final = 1e-10
_ANYWHERE_M: Final = 50_000.0
_ROUND: Final = 1.01


def anticlockwise(ring: Ring) -> Ring:
    """Return the same corners counter-clockwise."""
    return ring if shapely.LinearRing(ring).is_ccw else ring[::-1]


def pieces_of(ring: Ring) -> tuple[Ring, ...]:
    """Return convex polygons that cover the inside of a ring exactly."""
    return _convex(Polygon(ring))


def pieces_around(ring: Ring) -> tuple[Ring, ...]:
    """Return convex polygons that cover a ring's bounding box, minus the ring's inside, exactly."""
    return _convex(shapely.box(*Polygon(ring).bounds).difference(Polygon(ring)))


def simpler_around(ring: Ring, unders_m: Iterable[float]) -> tuple[tuple[Ring, ...], ...]:
    """Return what `pieces_around` does, for simpler and simpler shapes inside a ring.

    Args:
        ring: the ring.
        unders_m: how far inside the ring each shape may be at most, larger and larger.

    Returns:
        One decomposition a shape, each of which contains the one before; it ends where a shape would have almost as
        many corners as the one before.
    """
    found, outer, gone_m = [], Polygon(ring), 0.0
    for under_m in unders_m:
        by_m, gone_m = under_m - gone_m, under_m
        inner = outer.buffer(-0.5 * by_m).simplify(0.45 * by_m)
        simpler = 4 * shapely.get_num_coordinates(inner) <= 3 * shapely.get_num_coordinates(outer)
        if inner.is_empty or not simpler or not outer.contains_properly(inner):
            break
        found.append(_convex(shapely.box(*Polygon(ring).bounds).difference(inner)))
        outer = inner
    return tuple(found)


def inset(ring: Ring, by_m: float) -> list[Ring]:
    """Return the outlines of the part of a ring's inside that is at least `by_m` away from the ring."""
    inner = Polygon(ring).buffer(-by_m)
    parts = inner.geoms if isinstance(inner, MultiPolygon) else [inner]
    return [tuple(part.exterior.coords[:-1]) for part in parts if not part.is_empty]


def free_near(fence: Ring | None, rings: Iterable[Ring], at: Point, away_m: float) -> Point | None:
    """Return the nearest place inside a fence at least this far from all rings, or slightly more; None if none."""
    inside = Point_(at).buffer(_ANYWHERE_M) if fence is None else Polygon(fence)
    # A buffer is a polygon, not round: slightly enlarged it contains the round one.
    kept = shapely.union_all([Polygon(ring).buffer(_ROUND * away_m) for ring in rings])
    free = inside.difference(kept)
    if free.is_empty:
        return None
    found = shapely.shortest_line(free, Point_(at)).coords[0]
    return float(found[0]), float(found[1])


def _convex(shape: shapely.Geometry) -> tuple[Ring, ...]:
    if isinstance(shape, MultiPolygon):
        return tuple(piece for part in shape.geoms for piece in _convex(part))
    if not isinstance(shape, Polygon) or shape.is_empty:
        return ()
    triangles = [
        anticlockwise(tuple(each.exterior.coords[:3]))
        for each in shapely.constrained_delaunay_triangles(shape).geoms
        if each.area > _SLIVER_M2
    ]
    return _merged(triangles)


def _merged(triangles: list[Ring]) -> tuple[Ring, ...]:
    """Return the polygons that are left after merging neighbours as long as the result is convex.

    Hertel and Mehlhorn, "Fast triangulation of simple polygons", FCT 1983: at most four times the least number.
    """
    rings: dict[int, list[Point]] = {index: list(ring) for index, ring in enumerate(triangles)}
    owner: dict[tuple[Point, Point], int] = {}
    for index, ring in rings.items():
        for edge in zip(ring, [*ring[1:], ring[0]], strict=True):
            owner[edge] = index
    for one, other in list(owner):
        first, second = owner.get((one, other)), owner.get((other, one))
        if first is None or second is None or first == second:
            continue
        # Each of the two rings, from the end of the shared edge to its beginning.
        left, right = _from(rings[first], other), _from(rings[second], one)
        joined = left + right[1:-1]
        if _is_convex(joined):
            rings[first] = joined
            del rings[second], owner[one, other], owner[other, one]
            for edge in zip(joined, [*joined[1:], joined[0]], strict=True):
                owner[edge] = first
    return tuple(tuple(ring) for ring in rings.values())


def _from(ring: list[Point], start: Point) -> list[Point]:
    at = ring.index(start)
    return ring[at:] + ring[:at]


def _is_convex(ring: list[Point]) -> bool:
    around = [*ring, ring[0], ring[1]]
    return all(
        (bx - ax) * (cy - by) - (by - ay) * (cx - bx) >= 0.0
        for (ax, ay), (bx, by), (cx, cy) in zip(around, around[1:], around[2:], strict=False)
    )
