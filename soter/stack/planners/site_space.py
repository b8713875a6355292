"""Where the centre of a robot may be in a site with polygons, for planners."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter.stack.planners.base import Point
from soter.stack.planners.space import TOUCH_M, FreeSpace, circles_meet, distance_to_line_m

_RING: Final = tuple((math.cos(k * math.pi / 8), math.sin(k * math.pi / 8)) for k in range(16))
_FIRST_M: Final = 0.02
_GROWTH: Final = 1.25


def space_of(workspace: Workspace, inflation_m: float) -> FreeSpace:
    """Return where a centre may be that keeps `inflation_m` from what is kept out of a workspace of any shape."""
    return SiteSpace(workspace, inflation_m) if isinstance(workspace, Site) else FreeSpace(workspace, inflation_m)


class SiteSpace(FreeSpace):
    """The inside of a site's fence without its areas, inflated, and without discs around other robots.

    Args:
        site: fence and areas.
        inflation_m: distance that is kept from areas.
    """

    def __init__(self, site: Site, inflation_m: float) -> None:
        self._site: Final = site
        self._inflation_m: Final = inflation_m
        self.bounds = site.bounds
        self.checks = 0
        self._discs = ()

    def is_open(self, ax: float, ay: float, bx: float, by: float) -> bool:
        self.checks += 1
        if not self._keeps(ax, ay, bx, by):
            return False
        dx, dy = bx - ax, by - ay
        return all(distance_to_line_m(cx, cy, ax, ay, dx, dy) >= r - TOUCH_M for cx, cy, r in self._discs)

    def nearest_free(self, x: float, y: float) -> Point | None:
        """Return a free point near one that is not, or None; the nearest to within a quarter of how far it is.

        Points that a straight line leads to without getting any nearer to what holds the first come before others.
        """
        low_x, low_y, high_x, high_y = self.bounds
        far_m = 2.0 * (math.hypot(high_x - low_x, high_y - low_y) + math.dist((x, y), (low_x, low_y)))
        fallback: Point | None = None
        reach_m = _FIRST_M
        while reach_m < far_m:
            ring = [(x + reach_m * ux, y + reach_m * uy) for ux, uy in _RING]
            pushed = [self._site.freed(*at, 0.0, self._inflation_m) for at in ring]
            beside = [at for at in self._around(x, y) if math.dist(at, (x, y)) <= reach_m]
            for point in sorted([*ring, *pushed, *beside], key=lambda at: (math.dist(at, (x, y)), at)):
                if math.dist(point, (x, y)) <= reach_m * _GROWTH and self.is_free(*point):
                    if self._leads_there(x, y, *point):
                        return point
                    fallback = fallback or point
            if fallback is not None and reach_m > 4.0 * math.dist(fallback, (x, y)):
                return fallback
            reach_m *= _GROWTH
        return fallback

    def _is_free(self, x: float, y: float) -> bool:
        site = self._site
        if site.fence_m(x, y) < -TOUCH_M or site.keep_outs.distance_m(x, y) < self._inflation_m - TOUCH_M:
            return False
        return not self._discs or not self.in_disc(x, y)

    def _keeps(self, ax: float, ay: float, bx: float, by: float) -> bool:
        site, wanted_m = self._site, self._inflation_m - TOUCH_M
        if site.keep_outs.segment_m(ax, ay, bx, by, self._inflation_m) < wanted_m:
            return False
        return (
            min(site.fence_m(ax, ay), site.fence_m(bx, by)) <= TOUCH_M or site.fence_along_m(ax, ay, bx, by) > -TOUCH_M
        )

    def _leads_there(self, x: float, y: float, to_x: float, to_y: float) -> bool:
        """Whether the line to a free point crosses no area but on its way out of where it begins."""
        here_m = self._site.keep_outs.distance_m(x, y)
        if here_m >= self._inflation_m:
            return self._keeps(x, y, to_x, to_y)
        # Nearer than wanted: it may not get nearer than it is, nor, from inside an area, out of it and into another.
        steps = max(2, math.ceil(math.dist((x, y), (to_x, to_y)) / max(self._inflation_m, 0.05)))
        distances = [
            self._site.keep_outs.distance_m(x + (to_x - x) * k / steps, y + (to_y - y) * k / steps)
            for k in range(steps + 1)
        ]
        return all(after >= before - TOUCH_M or after >= self._inflation_m for before, after in pairwise(distances))

    def _around(self, x: float, y: float) -> list[Point]:
        """Return where a free point may be because of discs."""
        found: list[Point] = []
        for number, (cx, cy, r) in enumerate(self._discs):
            away = math.hypot(x - cx, y - cy)
            if away > TOUCH_M:
                found.append((cx + (x - cx) / away * r, cy + (y - cy) / away * r))
            found += [(cx + r * ux, cy + r * uy) for ux, uy in _RING]
            for other in self._discs[:number]:
                found += circles_meet(cx, cy, r, *other)
        return found
