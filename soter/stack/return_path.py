"""The return path that a robot always has: found before it is needed, and kept up to date while the robot moves.

A simplex without a model of the advanced controller (Bak et al., "Sandboxing controllers for cyber-physical systems",
ICCPS 2011; "black-box simplex"): the robot is left to its AC only while a complete path to its station is known. That
is the roadmap's path if there is one. If not, the robot can go back to its last anchor, where it came from, and on from
there. So there is always a path, its length grows by no more than the robot drives, and all of it keeps `path_m` from
fence and boxes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from soter.stack.recovery import RecoveryPlanner
from soter.stack.roadmap import Roadmap
from soter.stack.routes import Routes, routes_to
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, Terrain

DETOUR_M: Final = 0.5
"""How much longer a roomy path may be to be preferred to a narrow one; the charge pays for it."""

_ROUNDING_M: Final = 1e-6

_BESIDE_M: Final = 1e-5
"""Nothing so near to a rectangle is in the way beside it."""

LOOK_S: Final = 1.0
"""The path is looked for again after the distance that the robot can drive in this time."""

BACK_M: Final = 1.0
"""In a site the path is looked for again this far from the last such place, or farther where charges last long; nearer,
the robot goes back there."""

BACK_CHARGE: Final = 0.0025
"""Charge that a way back may cost before the path is looked for again, among a site's many corners."""

_BACK_SHARE: Final = 0.025
"""Or at this share of the path's length: far from the station a longer way back matters less."""


class _Anchor:
    """A place whose path to the station is known, and the places around it that see it.

    Attributes:
        place: where it is.
        length_m: accounted length of the path from there, without the detour of `DETOUR_M`.
        radius_m: from every place within it, the straight line to the anchor is free.
        routes: routes that have the path from here; None if the path goes back to `before`.
        before: the anchor that the robot came from.
    """

    __slots__ = ("before", "length_m", "place", "radius_m", "routes")

    def __init__(
        self, place: Point, length_m: float, radius_m: float, routes: Routes | None, before: _Anchor | None
    ) -> None:
        self.place, self.length_m, self.radius_m, self.routes, self.before = place, length_m, radius_m, routes, before

    def legs(self) -> list[Point]:
        """Return the corners of the path from here, the station last."""
        way: list[Point] = []
        anchor: _Anchor | None = self
        while anchor is not None:
            if anchor.routes is not None:
                return way + anchor.routes.legs(*anchor.place)
            anchor = anchor.before
            if anchor is not None:
                way.append(anchor.place)
        return way


class ReturnPath:
    """The path of one robot to its station.

    Args:
        terrain: fence and boxes.
        recovery: has the distance of paths from fence and boxes.
        place: the station.
        clearance_m: body clearance of roomy paths from boxes.
        inset_m: distance of roomy paths from the fence.
        occupied: rectangles to keep out of: other robots' stations, with the room that robots on them need.
        shared: the rectangles that the paths of all robots of the fleet keep out of, each robot but a few; see
            `soter.stack.roadmap.Roadmap`.
        back_m: how far a way back may be, in a site, before the path is looked for again.

    Attributes:
        place: the station.
        roomy: paths that keep so far from everything that no other module fires.
        longest_m: length of the longest path, also of the narrow ones, which are driven where there is no other.
    """

    def __init__(
        self,
        terrain: Terrain,
        recovery: RecoveryPlanner,
        place: Point,
        clearance_m: float,
        inset_m: float,
        occupied: Sequence[Rectangle] = (),
        shared: tuple[Rectangle, ...] = (),
        back_m: float = BACK_M,
    ) -> None:
        self.place: Final = place
        self._back_m: Final = back_m
        self._terrain: Final = terrain
        self._recovery: Final = recovery
        self._occupied: Final = tuple(occupied)
        self._shared: Final = shared
        self.roomy: Final = routes_to(terrain, place, clearance_m, inset_m, self._occupied, shared)
        rules = recovery.rules
        self._fence_m: Final = recovery.path_m if rules.fence else -math.inf
        self._boxes_m: Final = recovery.path_m if rules.boxes else 0.0
        self._cap_m: Final = max(0.25, recovery.v_max_m_s * LOOK_S)
        self._anchor: _Anchor | None = None
        self._last: Point | None = None
        # Paths that keep only what certificates need.
        self.narrow: Final = routes_to(terrain, place, self._boxes_m, self._fence_m, self._occupied, shared)
        self.longest_m: Final = max(self.roomy.longest_m, self.narrow.longest_m)

    @property
    def most_legs(self) -> int:
        """The largest number of legs of any path that the roadmaps show."""
        return max(self.roomy.most_legs, self.narrow.most_legs)

    def shortest_m(self, x_m: float, y_m: float) -> float:
        """Return the length of the roadmaps' path from a point; infinite if there is none."""
        entry = self.entry(x_m, y_m)
        length = self.roomy.distance_m(*entry)
        return (length if length < math.inf else self.narrow.distance_m(*entry)) + math.dist(entry, (x_m, y_m))

    def leads_back(self, x_m: float, y_m: float) -> bool:
        """Return whether the roadmaps show a path from a point that keeps its distances all along."""
        x, y = self.entry(x_m, y_m)
        return self.fits(x, y) and self.shortest_m(x, y) < math.inf

    def sees(self, here: Point, there: Point) -> bool:
        """Return whether a narrow path leads straight from one place to another."""
        return self.narrow.roadmap.sees(*here, *there)

    def fits(self, x_m: float, y_m: float) -> bool:
        """Return whether a place is as far from fence and boxes as narrow paths are."""
        return self._spare_m(x_m, y_m) >= -_ROUNDING_M

    def open_around(self, rectangles: Sequence[Rectangle]) -> bool:
        """Return whether a robot can drive all the way round rectangles that it keeps out of; False if that is unsure.

        It can if no other rectangle, no box and no fence is in its way there.
        """
        roadmap = self.narrow.roadmap
        if not isinstance(roadmap, Roadmap) or len(rectangles) > 1:
            return False
        low_x, low_y, high_x, high_y = rectangles[0]
        low_x, low_y, high_x, high_y = low_x - _BESIDE_M, low_y - _BESIDE_M, high_x + _BESIDE_M, high_y + _BESIDE_M
        if not all(self.fits(x, y) for x in (low_x, high_x) for y in (low_y, high_y)):
            return False
        lows_x, lows_y, highs_x, highs_y = roadmap.edges.T
        meets = (lows_x <= high_x) & (highs_x >= low_x) & (lows_y <= high_y) & (highs_y >= low_y)
        return bool(np.count_nonzero(meets) == 1)

    def track(self, x_m: float, y_m: float) -> None:
        """Keep the path up to date with where the robot is; call it at every tick."""
        here, anchor = (x_m, y_m), self._anchor
        if anchor is None or math.dist(here, anchor.place) > anchor.radius_m:
            self._anchor = self._find(here, anchor)
        self._last = here

    def length_m(self, x_m: float, y_m: float) -> float:
        """Return the accounted length of the return path, in metres; infinite if none is known."""
        anchor = self._anchor
        if anchor is not None:
            away_m = math.dist((x_m, y_m), anchor.place)
            if away_m <= anchor.radius_m:
                return away_m + anchor.length_m + DETOUR_M
        # The caller asks about another place than the robot's.
        return self.shortest_m(x_m, y_m) + DETOUR_M

    def legs(self, x_m: float, y_m: float) -> list[Point]:
        """Return the corners of the path from a point, the station last; empty if none is known.

        The path is looked for again: one back to the last anchor would turn round a robot on its way home.
        """
        if self._anchor is not None and not self._terrain.convex:
            self._anchor = self._look((x_m, y_m), self._anchor)
        entry, accounted_m = self.entry(x_m, y_m), self.length_m(x_m, y_m)
        first = [] if entry == (x_m, y_m) else [entry]
        if self.roomy.distance_m(*entry) <= accounted_m:
            return first + self.roomy.legs(*entry)
        anchor = self._anchor
        if anchor is not None and math.dist((x_m, y_m), anchor.place) <= anchor.radius_m:
            return [*first, anchor.place, *anchor.legs()]
        legs = self.narrow.legs(*entry)
        return first + legs if legs else []

    def around(self, x_m: float, y_m: float, peers: Sequence[Rectangle]) -> list[Point]:
        """Return the corners of a path around peers as they stand now; empty if there is none."""
        entry = self.entry(x_m, y_m)
        extra = (*self._occupied, *peers)
        routes = Routes(self._terrain, self.place, self._boxes_m, self._fence_m, extra, self._shared)
        return routes.legs(*entry)

    def entry(self, x_m: float, y_m: float) -> Point:
        """Return the nearest place as far from the fence and the nearest box as paths are."""
        return self._terrain.beside(x_m, y_m, self._fence_m, self._boxes_m if self._recovery.rules.boxes else None)

    def _find(self, here: Point, anchor: _Anchor | None) -> _Anchor | None:
        """Return the anchor for a place outside the last anchor's radius."""
        if anchor is not None and not self._terrain.convex:
            # So near, going back is as good as a path, which takes long to find among a site's many corners.
            entry, found = self.entry(*here), anchor.before or anchor
            back_m = math.dist(entry, found.place)
            if back_m <= self._far_m(anchor) and self._recovery.free(*entry, *found.place):
                return _Anchor(entry, back_m + found.length_m, self._radius_m(here, entry, anchor), None, found)
        return self._look(here, anchor)

    def _far_m(self, anchor: _Anchor | None) -> float:
        """Return the distance from an anchor within which the path need not be looked for again."""
        if anchor is None or self._terrain.convex:
            return self._cap_m
        return max(self._cap_m, self._back_m, _BACK_SHARE * anchor.length_m)

    def _radius_m(self, here: Point, entry: Point, anchor: _Anchor | None) -> float:
        """Return the radius around `here` within which all places see the entry: clearance falls a metre per metre."""
        return math.dist(here, entry) + min(max(self._spare_m(*entry), 0.0), self._far_m(anchor))

    def _spare_m(self, x_m: float, y_m: float) -> float:
        terrain = self._terrain
        return min(terrain.clearance_m(x_m, y_m) - self._boxes_m, terrain.fence_m(x_m, y_m) - self._fence_m)

    def _look(self, here: Point, anchor: _Anchor | None) -> _Anchor | None:
        """Return the anchor for a place, with the best of the roadmaps' paths and the way back."""
        entry = self.entry(*here)
        radius_m = self._radius_m(here, entry, anchor)
        length_m = self.roomy.distance_m(*entry)
        if anchor is not None and length_m <= math.dist(entry, anchor.place) + anchor.length_m and not anchor.before:
            # No way back is shorter.
            return _Anchor(entry, length_m, radius_m, self.roomy, None)
        back = self._back_to(entry, anchor)
        back_m = math.inf if back is None else math.dist(entry, back.place) + back.length_m
        if length_m <= back_m + DETOUR_M and length_m < math.inf:
            return _Anchor(entry, min(length_m, back_m), radius_m, self.roomy, None)
        if (length_m := self.narrow.distance_m(*entry)) <= back_m + DETOUR_M and length_m < math.inf:
            return _Anchor(entry, min(length_m, back_m), radius_m, self.narrow, None)
        return None if back is None else _Anchor(entry, back_m, radius_m, None, back)

    def _back_to(self, entry: Point, anchor: _Anchor | None) -> _Anchor | None:
        """Return the oldest anchor that the robot can go straight back to, or one where it was a tick ago."""
        if anchor is None or self._last is None:
            return None
        back = None
        candidate: _Anchor | None = anchor
        while candidate is not None and self._recovery.free(*entry, *candidate.place):
            back, candidate = candidate, candidate.before
        if back is not None:
            return back
        last = self.entry(*self._last)
        if not self._recovery.free(*entry, *last):
            return None
        return _Anchor(last, math.dist(last, anchor.place) + anchor.length_m, 0.0, None, anchor)
