"""The terrain of a site with polygons: answers the same questions as that of a rectangle, from convex pieces."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.convex import Pieces
from soter.geometry.site import Site, refuse
from soter.geometry.workspace import Workspace
from soter.stack.terrain import Point, Terrain


@lru_cache(maxsize=8)
def terrain_of(workspace: Workspace, body_radius_m: float) -> Terrain:
    """Return the terrain of a workspace of any shape, for bodies of a radius in metres."""
    return SiteTerrain(workspace, body_radius_m) if isinstance(workspace, Site) else Terrain(workspace, body_radius_m)


class SiteTerrain(Terrain):
    """Distances to the fence and the areas of a site.

    The outside of the fence is treated like an area: as convex pieces, the distance to each of which is convex along a
    line. Unlike that to a rectangle's sides, the distance to a polygonal fence is not concave, so lines are tested all
    along.
    """

    convex = False

    def __init__(self, site: Site, body_radius_m: float) -> None:
        self.site: Final = site
        # Looked up here: those of a large map take seconds to make, for which no tick can wait.
        self._keep_outs: Final = site.keep_outs
        self._outside: Final = site.outside
        self._from_fence: Final = site.from_fence
        self.workspace = site
        self.body_radius_m = body_radius_m
        self.bounds = site.bounds
        self._lay_cells()

    def fence_m(self, x_m: float, y_m: float) -> float:
        return self._from_fence.distance_m(x_m, y_m)

    def fence_along_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf) -> float:
        return self.site.fence_along_m(ax_m, ay_m, bx_m, by_m, enough_m)

    def leg_fence_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float, slope: float) -> float:
        length = math.hypot(bx_m - ax_m, by_m - ay_m)
        least = self.fence_m(ax_m, ay_m) - length
        if least >= needed_m:
            return least - needed_m
        return _leg_m(self._outside, (ax_m, ay_m), (bx_m, by_m), needed_m, slope) - needed_m

    def inside(self, x_m: float, y_m: float, inset_m: float) -> Point:
        return self.site.freed(x_m, y_m, inset_m, -math.inf) if inset_m > -math.inf else (x_m, y_m)

    def beside(self, x_m: float, y_m: float, inset_m: float, clearance_m: float | None) -> Point:
        away_m = -math.inf if clearance_m is None else clearance_m + self.body_radius_m
        return self.site.freed(x_m, y_m, inset_m, away_m)

    def clearance_m(self, x_m: float, y_m: float) -> float:
        return self._keep_outs.distance_m(x_m, y_m) - self.body_radius_m

    def walls(self, x_m: float, y_m: float, reach_m: float = math.inf) -> list[tuple[float, float, float]]:
        reach_m = min(reach_m, _ALL_M) + self.body_radius_m
        return [(away_m - self.body_radius_m, ux, uy) for away_m, ux, uy in self._keep_outs.walls(x_m, y_m, reach_m)]

    def leg_clearance_m(
        self, ax_m: float, ay_m: float, bx_m: float, by_m: float, needed_m: float, slope: float
    ) -> float:
        needed_m, radius_m = needed_m + self.body_radius_m, self.body_radius_m
        return _leg_m(self._keep_outs, (ax_m, ay_m), (bx_m, by_m), needed_m, slope) - radius_m

    def segment_clearance_m(
        self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf
    ) -> float:
        reach_m = enough_m + self.body_radius_m
        found_m = self._keep_outs.segment_m(ax_m, ay_m, bx_m, by_m, reach_m)
        # At `reach_m` or beyond, the clearance is enough, whatever rounding says.
        return enough_m if found_m >= reach_m else max(found_m, 0.0) - self.body_radius_m

    def lines_keep(
        self, a: NDArray[np.float64], b: NDArray[np.float64], clearance_m: float, inset_m: float
    ) -> NDArray[np.bool_]:
        """Return which of many straight lines keep a body at these distances from obstacles and fence.

        Args:
            a: where they begin, one place a row; or one place for all.
            b: where they end.
            clearance_m: distance of the body from obstacles.
            inset_m: distance from the fence; below 0 for none.
        """
        keep = self._keep_outs.lines_keep(a, b, clearance_m + self.body_radius_m)
        return keep & self._outside.lines_keep(a, b, inset_m) if inset_m >= 0.0 else keep

    @lru_cache(maxsize=16)  # noqa: B019 - terrains are few, and kept as long
    def roomy_cells(self, fence_m: float, clearance_m: float) -> NDArray[np.bool_]:
        fits = np.ones(self.cell_x.shape, dtype=np.bool_)
        if fence_m > -math.inf:
            self._strike(fits, self._outside, fence_m)
        if (field := self.site.field) is not None:
            return fits & field.at_least(self.cell_x, self.cell_y, clearance_m + self.body_radius_m)
        self._strike(fits, self._keep_outs, clearance_m + self.body_radius_m)
        return fits

    def _strike(self, fits: NDArray[np.bool_], pieces: Pieces, needed_m: float) -> None:
        """Remove the cells that are too near to a piece."""
        for piece in pieces.all:
            low_x, low_y, high_x, high_y = piece.bounds
            columns, rows = self.window(low_x, low_y, max(needed_m, 0.0))
            last_columns, last_rows = self.window(high_x, high_y, max(needed_m, 0.0))
            part = slice(columns.start, last_columns.stop), slice(rows.start, last_rows.stop)
            fits[part] &= _away(piece.ring, self.cell_x[part], self.cell_y[part]) >= needed_m


def _of_rectangles(name: str) -> property:
    return property(lambda _: refuse(name))


# Code that only knows rectangles must not take a site for its bounding box.
for _name in ("width_m", "depth_m", "boxes", "cell_fence", "cell_clearance"):
    setattr(SiteTerrain, _name, _of_rectangles(_name))


_ALL_M: Final = 1e6


def _leg_m(pieces: Pieces, a: Point, b: Point, needed_m: float, slope: float) -> float:
    """Return the least distance along a leg to any piece, except pieces that it leads away from.

    A piece nearer than `needed_m` at the beginning counts as `needed_m` if every direction that the robot may really
    take leads away from it, and as less if not: the distance to a convex set rises all along a line if it does so at
    the beginning.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.hypot(dx, dy)
    least = math.inf
    for piece in pieces.within(*a, needed_m + length):
        if math.dist(a, piece.middle) - piece.radius_m - length >= min(least, needed_m):
            continue
        distance_m, ux, uy = piece.wall(*a)
        if distance_m < needed_m:
            away = -(ux * dx + uy * dy) >= slope * length and length > 0.0
            found = needed_m if away else min(distance_m, piece.segment_m(*a, *b))
        else:
            found = piece.segment_m(*a, *b)
        least = min(least, found)
    return least


def _away(ring: tuple[Point, ...], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signed distances of many points to a convex polygon."""
    off = np.full(x.shape, -math.inf)
    away = np.full(x.shape, math.inf)
    for (ax, ay), (bx, by) in zip(ring, (*ring[1:], ring[0]), strict=True):
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length, (by - ay) / length
        np.maximum(off, uy * (x - ax) - ux * (y - ay), out=off)
        along = np.clip(ux * (x - ax) + uy * (y - ay), 0.0, length)
        np.minimum(away, np.hypot(x - ax - ux * along, y - ay - uy * along), out=away)
    return np.where(off > 0.0, away, off)
