"""Worlds drawn at random: a boundary that is seldom convex, areas of all kinds, stations where there is room."""

from __future__ import annotations

import math
import random

import shapely  # type: ignore[import-untyped]

from soter.geometry.draft import Draft, Outline, Spot, circle


def drawn(seed: int, robots: int = 3) -> Draft:
    """Return a world; whether robots can live in it is for others to say."""
    stream = random.Random(f"world/{seed}")
    east_m, north_m = stream.uniform(-9000.0, 9000.0), stream.uniform(-9000.0, 9000.0)
    size_m = stream.uniform(3.0, 9.0)
    draft = Draft(f"drawn {seed}")
    fence = _star(stream, east_m, north_m, stream.randint(4, 12), 0.45 * size_m, size_m)
    draft.fences.append(Outline("fence", fence))
    inside = shapely.Polygon(fence)
    kept = []
    for number in range(stream.randint(0, 6)):
        x, y = _within(stream, inside)
        kind = stream.choice(("star", "box", "circle"))
        if kind == "star":
            ring = _star(stream, x, y, stream.randint(3, 8), 0.15, 1.2)
        elif kind == "box":
            ring = _box(stream, x, y)
        else:
            ring = list(circle(x, y, stream.uniform(0.1, 0.7), around=True))
        polygon = shapely.Polygon(ring)
        if polygon.is_valid and polygon.area > 0.01:
            kept.append(polygon)
            draft.keep_outs.append(Outline(f"area {number}", ring))
    free = inside.buffer(-0.35).difference(shapely.union_all(kept).buffer(0.45))
    for _ in range(200):
        if len(draft.stations) == robots or free.is_empty:
            break
        x, y = _within(stream, free)
        if all(math.dist((x, y), (each.x_m, each.y_m)) > 1.0 for each in draft.stations):
            draft.stations.append(Spot(f"station {len(draft.stations) + 1}", x, y))
    return draft


def _star(
    stream: random.Random, x: float, y: float, corners: int, least_m: float, most_m: float
) -> list[tuple[float, float]]:
    turn = stream.uniform(0.0, math.tau)
    angles = [turn + math.tau * (each + stream.uniform(-0.4, 0.4)) / corners for each in range(corners)]
    return [
        (x + far_m * math.cos(angle), y + far_m * math.sin(angle))
        for angle in angles
        for far_m in [stream.uniform(least_m, most_m)]
    ]


def _box(stream: random.Random, x: float, y: float) -> list[tuple[float, float]]:
    angle, half, side = stream.uniform(0.0, math.tau), stream.uniform(0.1, 0.8), stream.uniform(0.1, 0.8)
    ux, uy = math.cos(angle), math.sin(angle)
    return [
        (x + a * half * ux - b * side * uy, y + a * half * uy + b * side * ux)
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]


def _within(stream: random.Random, area: shapely.Geometry) -> tuple[float, float]:
    low_x, low_y, high_x, high_y = area.bounds
    while True:
        x, y = stream.uniform(low_x, high_x), stream.uniform(low_y, high_y)
        if area.contains(shapely.Point(x, y)):
            return x, y
