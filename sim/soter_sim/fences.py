"""The outer boundary of a world: a rectangle, a polygon, or none."""

from __future__ import annotations

from itertools import pairwise
from math import inf
from typing import Final, Protocol

from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter_sim.shapes import Polygon, crossings, point_to_polygon
from soter_sim.sweep import cross_rectangle, point_to_chord


class WorldFence(Protocol):
    """Says how far inside the fence robots are."""

    def margin(self, x0: float, y0: float, x1: float, y1: float) -> float:
        """Return the least distance to the fence of a chord's points, negative outside.

        For a convex fence this is the distance of the chord's end, since its beginning was judged before.
        """

    def outside(self, x0: float, y0: float, dx: float, dy: float) -> list[tuple[float, float]]:
        """Return the parts of a chord, from 0 to 1, that lie outside by more than the tolerance."""


def fence_of(workspace: Workspace, tolerance_m: float) -> WorldFence:
    """Return the fence of a workspace.

    Args:
        workspace: a workspace of any shape.
        tolerance_m: a centre outside by no more than this counts as inside.
    """
    if not isinstance(workspace, Site):
        return _Rectangle(workspace.width_m, workspace.depth_m, tolerance_m)
    fence = workspace.plan.fence
    return _Polygon(fence, tolerance_m) if fence is not None else _Nothing()


class _Rectangle:
    def __init__(self, width: float, depth: float, tolerance_m: float) -> None:
        self._width, self._depth = width, depth
        self._grown: Final = (-tolerance_m, -tolerance_m, width + tolerance_m, depth + tolerance_m)

    def margin(self, x0: float, y0: float, x1: float, y1: float) -> float:
        return min(x1, self._width - x1, y1, self._depth - y1)

    def outside(self, x0: float, y0: float, dx: float, dy: float) -> list[tuple[float, float]]:
        first, last = cross_rectangle(x0, y0, dx, dy, self._grown)
        if first > 1.0 or last < 0.0 or first > last:
            return [(0.0, 1.0)]
        return [*([(0.0, first)] if first > 0.0 else []), *([(last, 1.0)] if last < 1.0 else [])]


class _Polygon:
    def __init__(self, polygon: Polygon, tolerance_m: float) -> None:
        self._polygon: Final = polygon
        self._tolerance_m: Final = tolerance_m

    def margin(self, x0: float, y0: float, x1: float, y1: float) -> float:
        dx, dy = x1 - x0, y1 - y0
        margin = -point_to_polygon(x1, y1, self._polygon)
        if margin * margin > dx * dx + dy * dy:
            return margin if margin < 0.0 else min(margin, *self._beside(x0, y0, dx, dy))
        parts = [0.0, *crossings(x0, y0, dx, dy, self._polygon), 1.0]
        middles = [(one + other) / 2.0 for one, other in pairwise(parts)]
        return min(
            margin,
            *(-point_to_polygon(x0 + at * dx, y0 + at * dy, self._polygon) for at in middles),
            *(self._beside(x0, y0, dx, dy) if len(parts) == 2 and margin > 0.0 else ()),
        )

    def _beside(self, x0: float, y0: float, dx: float, dy: float) -> list[float]:
        return [point_to_chord(cx, cy, x0, y0, dx, dy) for cx, cy in self._polygon]

    def outside(self, x0: float, y0: float, dx: float, dy: float) -> list[tuple[float, float]]:
        def margin(at: float) -> float:
            return -point_to_polygon(x0 + at * dx, y0 + at * dy, self._polygon)

        found: list[tuple[float, float]] = []
        for one, other in pairwise([0.0, *crossings(x0, y0, dx, dy, self._polygon), 1.0]):
            if other > one and min(margin(one), margin((one + other) / 2.0), margin(other)) < -self._tolerance_m:
                found.append((one, other))
        return found


class _Nothing:
    def margin(self, x0: float, y0: float, x1: float, y1: float) -> float:
        return inf

    def outside(self, x0: float, y0: float, dx: float, dy: float) -> list[tuple[float, float]]:
        return []
