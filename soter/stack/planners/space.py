"""The free space of a robot's centre, for planners: exact tests against inflated boxes, areas and discs; repairs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Final

from soter.geometry.site import Site
from soter.geometry.workspace import Workspace, crosses, grown
from soter.stack.planners.base import Point

TOUCH_M = 1e-9
"""Depth in metres up to which a point on an edge counts as free."""

_INSIDE_M: Final = 2.0 * TOUCH_M

PIECE_M = 0.25
"""Longest piece in metres that paths are divided into before corners are cut off."""


class FreeSpace:
    """The fence rectangle minus the boxes, grown on every side, and minus discs around other robots.

    Points on an edge are free. Every test of a point or of a segment adds one to `checks`.

    Args:
        workspace: fence and boxes.
        inflation_m: by how much boxes grow on each side: the body's radius plus the wanted clearance.
    """

    def __init__(self, workspace: Workspace, inflation_m: float) -> None:
        self.width_m, self.depth_m = workspace.width_m, workspace.depth_m
        self.bounds = workspace.bounds
        self.checks = 0
        self._discs: tuple[tuple[float, float, float], ...] = ()
        boxes = [grown(box, inflation_m) for box in workspace.boxes]
        self._boxes = [(a + TOUCH_M, b + TOUCH_M, c - TOUCH_M, d - TOUCH_M) for a, b, c, d in boxes]
        self._xs = sorted({0.0, self.width_m, *(x for a, _, c, _ in boxes for x in (a, c))})
        self._ys = sorted({0.0, self.depth_m, *(y for _, b, _, d in boxes for y in (b, d))})
        self._corners = [(x, y) for x in self._xs for y in self._ys if self._is_free(x, y)]

    def begin(self, discs: Iterable[tuple[float, float, float]]) -> None:
        """Start a new request: set the discs (centre and radius, metres) and count from zero."""
        self._discs = tuple(discs)
        self.checks = 0

    def is_free(self, x: float, y: float) -> bool:
        """Return whether a point is inside the fence and outside all boxes and discs."""
        self.checks += 1
        return self._is_free(x, y)

    def in_disc(self, x: float, y: float) -> bool:
        """Return whether a point is inside a disc."""
        return any(math.hypot(x - cx, y - cy) < r - TOUCH_M for cx, cy, r in self._discs)

    def is_open(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Return whether the segment between two points inside the fence meets no box and no disc."""
        self.checks += 1
        for low_x, low_y, high_x, high_y in self._boxes:
            # Most boxes lie to one side of the segment: these four comparisons rule them out.
            if ax <= low_x:
                if bx <= low_x:
                    continue
            elif ax >= high_x and bx >= high_x:
                continue
            if ay <= low_y:
                if by <= low_y:
                    continue
            elif ay >= high_y and by >= high_y:
                continue
            if crosses(ax, ay, bx, by, low_x, low_y, high_x, high_y):
                return False
        discs, dx, dy = self._discs, bx - ax, by - ay
        return not discs or all(distance_to_line_m(cx, cy, ax, ay, dx, dy) >= r - TOUCH_M for cx, cy, r in discs)

    def nearest_free(self, x: float, y: float) -> Point | None:
        """Return the free point nearest to a point that is not free, or None if none can be reached.

        Points that a straight line reaches through no other obstacle than those that hold the given point come first:
        the nearest of all may be behind a wall.

        The result is exact: the nearest point lies straight across on an edge, or where two edges meet.
        """
        candidates = [(c, y) for c in self._xs] + [(x, c) for c in self._ys] + self._corners
        candidates += self._around_discs(x, y)
        candidates.sort(key=lambda point: math.dist(point, (x, y)))
        fallback: Point | None = None
        for point in candidates:
            if self.is_free(*point):
                if self._leads_out(x, y, *point):
                    return point
                fallback = fallback or point
        return fallback

    def shortened(self, path: Sequence[Point]) -> list[Point]:
        """Return a path with the same ends, no longer, without needless waypoints.

        Args:
            path: start, waypoints and goal, all segments open.
        """
        return self._cut(_pieces(self._cut(path)))

    def _cut(self, path: Sequence[Point]) -> list[Point]:
        kept = [path[0]]
        here = 0
        while here < len(path) - 1:
            there = len(path) - 1
            while there > here + 1 and not self.is_open(*path[here], *path[there]):
                there -= 1
            kept.append(path[there])
            here = there
        return kept

    def _is_free(self, x: float, y: float) -> bool:
        if not (0.0 <= x <= self.width_m and 0.0 <= y <= self.depth_m):
            return False
        for low_x, low_y, high_x, high_y in self._boxes:
            if low_x < x < high_x and low_y < y < high_y:
                return False
        return not self._discs or not self.in_disc(x, y)

    def _leads_out(self, x: float, y: float, to_x: float, to_y: float) -> bool:
        """Return whether the line from a point that is not free to a free one meets only what holds the first."""
        # Only the part of the line inside the fence counts: robots do not get far outside it.
        enter = 0.0
        for start, end, high in ((x, to_x, self.width_m), (y, to_y, self.depth_m)):
            if start < 0.0:
                enter = max(enter, start / (start - end))
            elif start > high:
                enter = max(enter, (start - high) / (start - end))
        from_x, from_y = x + enter * (to_x - x), y + enter * (to_y - y)
        for box in self._boxes:
            holds = box[0] < x < box[2] and box[1] < y < box[3]
            if not holds and crosses(from_x, from_y, to_x, to_y, *box):
                return False
        dx, dy = to_x - from_x, to_y - from_y
        for cx, cy, r in self._discs:
            holds = math.hypot(x - cx, y - cy) < r - TOUCH_M
            if not holds and distance_to_line_m(cx, cy, from_x, from_y, dx, dy) < r - TOUCH_M:
                return False
        return True

    def _around_discs(self, x: float, y: float) -> Iterator[Point]:
        """Yield candidates for the nearest free point around discs: straight out, and where edges meet a disc."""
        for number, (cx, cy, r) in enumerate(self._discs):
            away = math.hypot(x - cx, y - cy)
            if away > TOUCH_M:
                yield cx + (x - cx) / away * r, cy + (y - cy) / away * r
            # From the middle all directions are equally far; elsewhere they are a second choice.
            for step in range(16):
                angle = math.tau * step / 16
                yield cx + r * math.cos(angle), cy + r * math.sin(angle)
            for line in self._xs:
                if abs(line - cx) <= r:
                    half = math.sqrt(r * r - (line - cx) ** 2)
                    yield from ((line, cy - half), (line, cy + half))
            for line in self._ys:
                if abs(line - cy) <= r:
                    half = math.sqrt(r * r - (line - cy) ** 2)
                    yield from ((cx - half, line), (cx + half, line))
            for ox, oy, other_r in self._discs[:number]:
                yield from circles_meet(cx, cy, r, ox, oy, other_r)


def distance_to_line_m(cx: float, cy: float, ax: float, ay: float, dx: float, dy: float) -> float:
    """Return the distance from c to the segment from a to a + d."""
    square = dx * dx + dy * dy
    share = ((cx - ax) * dx + (cy - ay) * dy) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(ax + share * dx - cx, ay + share * dy - cy)


def circles_meet(ax: float, ay: float, ar: float, bx: float, by: float, br: float) -> Iterator[Point]:
    """Yield where two circles meet."""
    between = math.hypot(bx - ax, by - ay)
    if between <= TOUCH_M or between > ar + br or between < abs(ar - br):
        return
    along = (between * between + ar * ar - br * br) / (2 * between)
    across = math.sqrt(max(ar * ar - along * along, 0.0))
    ux, uy = (bx - ax) / between, (by - ay) / between
    for side in (across, -across):
        yield ax + along * ux - side * uy, ay + along * uy + side * ux


def _pieces(path: Sequence[Point]) -> list[Point]:
    """Return the same path with more points on it."""
    points = [path[0]]
    for (ax, ay), (bx, by) in pairwise(path):
        number = max(math.ceil(math.hypot(bx - ax, by - ay) / PIECE_M), 1)
        points += [(ax + (bx - ax) * k / number, ay + (by - ay) * k / number) for k in range(1, number)]
        points.append((bx, by))
    return points


_RING: Final = tuple((math.cos(k * math.pi / 8), math.sin(k * math.pi / 8)) for k in range(16))
_FIRST_M: Final = 0.02
_GROWTH: Final = 1.25


def space_of(workspace: Workspace, inflation_m: float) -> FreeSpace:
    """Return the free space of centres that keep `inflation_m` from all obstacles, in a workspace of any shape."""
    return SiteSpace(workspace, inflation_m) if isinstance(workspace, Site) else FreeSpace(workspace, inflation_m)


class SiteSpace(FreeSpace):
    """The inside of a site's fence minus its areas, inflated, and minus discs around other robots."""

    def __init__(self, site: Site, inflation_m: float) -> None:
        self._site: Final = site
        self._inflation_m: Final = inflation_m
        self.bounds = site.bounds
        self.checks = 0
        self._discs = ()
        # For discs only: the fence and the areas are tested in another way.
        self._xs = self._ys = []

    def is_open(self, ax: float, ay: float, bx: float, by: float) -> bool:
        self.checks += 1
        if not self._keeps(ax, ay, bx, by):
            return False
        dx, dy = bx - ax, by - ay
        return all(distance_to_line_m(cx, cy, ax, ay, dx, dy) >= r - TOUCH_M for cx, cy, r in self._discs)

    def nearest_free(self, x: float, y: float) -> Point | None:
        """Return a free point near one that is not, or None; at most a quarter farther away than the nearest.

        Points that a straight line reaches without getting nearer to the obstacles that hold the given one come first.
        """
        found, checks = self._repaired(x, y, self._discs)
        self.checks += checks
        return found

    @lru_cache(maxsize=64)  # noqa: B019 - spaces are few, and kept as long
    def _repaired(self, x: float, y: float, discs: tuple[tuple[float, float, float], ...]) -> tuple[Point | None, int]:
        """Return the nearest free point among some discs, and the checks made; cached, since failures are retried."""
        before = self.checks
        found = self._nearest(x, y)
        checks, self.checks = self.checks - before, before
        return found, checks

    def _nearest(self, x: float, y: float) -> Point | None:
        low_x, low_y, high_x, high_y = self.bounds
        far_m = 2.0 * (math.hypot(high_x - low_x, high_y - low_y) + math.dist((x, y), (low_x, low_y)))
        fallback: Point | None = None
        reach_m = _FIRST_M
        while reach_m < far_m:
            ring = [(x + reach_m * ux, y + reach_m * uy) for ux, uy in _RING]
            pushed = [self._site.freed(*at, 0.0, self._inflation_m) for at in ring]
            beside = [at for at in self._around_discs(x, y) if math.dist(at, (x, y)) <= reach_m]
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
        if not site.outside.keeps(x, y, -TOUCH_M) or not site.keep_outs.keeps(x, y, self._inflation_m - TOUCH_M):
            return False
        return not self._discs or not self.in_disc(x, y)

    def _keeps(self, ax: float, ay: float, bx: float, by: float) -> bool:
        site = self._site
        if not site.keep_outs.line_keeps(ax, ay, bx, by, self._inflation_m - TOUCH_M):
            return False
        # Most lines stay well inside.
        return (
            site.outside.line_keeps(ax, ay, bx, by, _INSIDE_M)
            or min(site.fence_m(ax, ay), site.fence_m(bx, by)) <= TOUCH_M
            or site.fence_along_m(ax, ay, bx, by) > -TOUCH_M
        )

    def _leads_there(self, x: float, y: float, to_x: float, to_y: float) -> bool:
        """Return whether the line to a free point crosses no area except on its way out of where it begins."""
        here_m = self._site.keep_outs.distance_m(x, y)
        if here_m >= self._inflation_m:
            return self._keeps(x, y, to_x, to_y)
        # The start is too near: the line must not get nearer, nor, from inside an area, leave it and enter another.
        steps = max(2, math.ceil(math.dist((x, y), (to_x, to_y)) / max(self._inflation_m, 0.05)))
        distances = [
            self._site.keep_outs.distance_m(x + (to_x - x) * k / steps, y + (to_y - y) * k / steps)
            for k in range(steps + 1)
        ]
        return all(after >= before - TOUCH_M or after >= self._inflation_m for before, after in pairwise(distances))
