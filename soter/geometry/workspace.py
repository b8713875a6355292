"""The known workspace: fence, boxes, and where robots start and charge. Metres, ENU, z up."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

from soter.errors import ConfigError

Point = tuple[float, float]
Ring = tuple[Point, ...]
"""Corners in order, counter-clockwise, the first not repeated."""

MAX_ROBOT_ID = 254
"""Robot ids are also MAVLink system ids, where 0 and 255 have other meanings."""

HEIGHT_M = 1.0
"""Height of what does not say its own."""

_ROUNDING_M = 1e-9
"""Rounding error up to which a point constructed to lie on an edge counts as on it."""


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-aligned box on the ground, seen from above."""

    low_x_m: float
    low_y_m: float
    high_x_m: float
    high_y_m: float
    height_m: float = HEIGHT_M

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point to the box: negative inside, by the depth."""
        dx = max(self.low_x_m - x_m, x_m - self.high_x_m)
        dy = max(self.low_y_m - y_m, y_m - self.high_y_m)
        if dx > 0.0:
            return math.hypot(dx, dy) if dy > 0.0 else dx
        return max(dx, dy)

    @property
    def centre(self) -> tuple[float, float]:
        """The middle, x and y in metres."""
        return (self.low_x_m + self.high_x_m) / 2, (self.low_y_m + self.high_y_m) / 2

    @property
    def ring(self) -> Ring:
        """The corners."""
        return (
            (self.low_x_m, self.low_y_m),
            (self.high_x_m, self.low_y_m),
            (self.high_x_m, self.high_y_m),
            (self.low_x_m, self.high_y_m),
        )


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """Where one robot of the workspace starts and charges.

    Attributes:
        id: the robot's number, from 1.
        x_m: start, east.
        y_m: start, north.
        charger: its charging station, a flat patch; a robot charges while its centre is on one.
        heading_rad: start heading, counter-clockwise from east.
    """

    id: int
    x_m: float
    y_m: float
    charger: Box
    heading_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Workspace:
    """A rectangle from the origin to (width_m, depth_m), its boxes and its robots' places."""

    width_m: float
    depth_m: float
    boxes: tuple[Box, ...]
    robots: tuple[RobotPlace, ...]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The least axis-aligned rectangle that holds the workspace: low x, low y, high x, high y in metres."""
        return 0.0, 0.0, self.width_m, self.depth_m

    def outlines(self) -> tuple[tuple[Point, ...] | None, list[tuple[Point, ...]]]:
        """Return the corners of the fence, or None without one, and those of all obstacles."""
        return Box(0.0, 0.0, self.width_m, self.depth_m).ring, [box.ring for box in self.boxes]

    def inset(self, by_m: float) -> list[tuple[Point, ...]]:
        """Return the outlines of the places at least `by_m` inside the fence, to draw."""
        high_x, high_y = self.width_m - by_m, self.depth_m - by_m
        return [((by_m, by_m), (high_x, by_m), (high_x, high_y), (by_m, high_y))]

    def clearance_m(self, x_m: float, y_m: float, body_radius_m: float) -> float:
        """Return the distance from a round body at a point to the nearest box; negative where they overlap."""
        return min((box.distance_m(x_m, y_m) for box in self.boxes), default=math.inf) - body_radius_m

    def fence_m(self, x_m: float, y_m: float) -> float:
        """Return the distance of a point to the fence: negative outside, infinite without one."""
        return min(x_m, self.width_m - x_m, y_m, self.depth_m - y_m)

    def contains(self, x_m: float, y_m: float) -> bool:
        """Return whether a point is inside the fence or on it."""
        return self.fence_m(x_m, y_m) >= 0.0

    def with_robots(self, count: int) -> Workspace:
        """Return the same workspace with only its first `count` robots and their chargers.

        Raises:
            ConfigError: the workspace has fewer, or `count` is below 1.
        """
        if not 1 <= count <= len(self.robots):
            raise ConfigError(
                f"{count} robots were asked for, the workspace has {len(self.robots)}; allowed: 1 to "
                f"{len(self.robots)}; for more, add robots and charging stations to the workspace file",
                key="robots",
            )
        return replace(self, robots=self.robots[:count])

    def nearest_free(self, x_m: float, y_m: float, clearance_m: float) -> tuple[float, float] | None:
        """Return the nearest point inside the fence that is at least `clearance_m` from every box.

        The distance is that of the point itself: for a round body, add its radius. The point is exact, except where
        the rounded outline of a box crosses another one or the fence: there it may be slightly farther away than
        necessary, but never too close to a box.

        Returns:
            x and y in metres, the point itself if it is free; None if there is no such place.
        """
        if self._free(x_m, y_m, clearance_m):
            return x_m, y_m
        # The nearest point of a free region lies straight across an edge, on the arc around the corner of a box, or at
        # the corner of two edges; nowhere else.
        inside_x_m, inside_y_m = min(max(x_m, 0.0), self.width_m), min(max(y_m, 0.0), self.depth_m)
        xs_m, ys_m = {inside_x_m, 0.0, self.width_m}, {inside_y_m, 0.0, self.depth_m}
        arcs: list[tuple[float, float]] = []
        for box in self.boxes:
            xs_m |= {box.low_x_m - clearance_m, box.high_x_m + clearance_m}
            ys_m |= {box.low_y_m - clearance_m, box.high_y_m + clearance_m}
            for corner_x_m, corner_y_m in product((box.low_x_m, box.high_x_m), (box.low_y_m, box.high_y_m)):
                away_m = math.hypot(x_m - corner_x_m, y_m - corner_y_m)
                if away_m > 0.0:
                    scale = clearance_m / away_m
                    arcs.append((corner_x_m + scale * (x_m - corner_x_m), corner_y_m + scale * (y_m - corner_y_m)))

        def nearest(candidates: Iterable[tuple[float, float]]) -> tuple[float, float] | None:
            # Break ties by the coordinates: the result must not depend on the order of a set.
            ordered = sorted(candidates, key=lambda at: (math.dist(at, (x_m, y_m)), at))
            return next((at for at in ordered if self._free(*at, clearance_m)), None)

        first = nearest([*product(xs_m, [inside_y_m]), *product([inside_x_m], ys_m), *arcs])
        # The number of corners grows with the square of the boxes: only try those no farther than the best so far.
        reach_m = math.inf if first is None else math.dist(first, (x_m, y_m))
        corners = product(
            [at for at in xs_m if abs(at - x_m) <= reach_m], [at for at in ys_m if abs(at - y_m) <= reach_m]
        )
        return nearest([*corners, *([] if first is None else [first])])

    def _free(self, x_m: float, y_m: float, clearance_m: float) -> bool:
        needed_m = clearance_m - _ROUNDING_M
        return self.contains(x_m, y_m) and all(box.distance_m(x_m, y_m) >= needed_m for box in self.boxes)


def as_box(x_m: float, y_m: float, side_m: float) -> Box:
    """Return the box of a station: a square around a place."""
    half_m = side_m / 2.0
    return Box(x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m, 0.0)


def crosses(
    ax: float, ay: float, bx: float, by: float, low_x: float, low_y: float, high_x: float, high_y: float
) -> bool:
    """Return whether the segment from a to b meets the inside of a rectangle (slab method); touching is not meeting."""
    enter, leave = 0.0, 1.0
    for start, delta, low, high in ((ax, bx - ax, low_x, high_x), (ay, by - ay, low_y, high_y)):
        if delta == 0.0:
            if not low < start < high:
                return False
            continue
        first, second = (low - start) / delta, (high - start) / delta
        if first > second:
            first, second = second, first
        if first > enter:
            enter = first
        if second < leave:
            leave = second
        if enter >= leave:
            return False
    return True


def grown(box: Box, by_m: float) -> tuple[float, float, float, float]:
    """Return the edges of a box grown by `by_m` on every side: low x, low y, high x, high y."""
    return box.low_x_m - by_m, box.low_y_m - by_m, box.high_x_m + by_m, box.high_y_m + by_m
