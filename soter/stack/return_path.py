"""The way back that a robot always has: found before it is needed, and kept while the robot moves.

A simplex without a model of the advanced controller (Bak et al., "Sandboxing controllers for cyber-physical systems",
ICCPS 2011; "black-box simplex"): the robot is left to its AC only while a complete path to its station is known. Where
the roadmap shows one, that is taken. Where it does not, the robot has come from somewhere: it can go back to the last
anchor, and on from there. So there is always a path, its length grows by no more than the robot drives, and all of it
keeps `path_m` from fence and boxes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from soter.stack.recovery import RecoveryPlanner
from soter.stack.routes import Routes, routes_to
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, Terrain

DETOUR_M: Final = 0.5
"""A roomy path is taken instead of a narrow one if it is longer by no more than this; the charge pays for it."""

_ROUNDING_M: Final = 1e-6

LOOK_S: Final = 1.0
"""The path is looked for again when the robot may have driven for so long."""

_BACK_M: Final = 1.0
"""In a site it is looked for when the robot is so far from where that was done last: so far it goes back there."""

_FARTHER: Final = 0.025
"""Or this share of the path: from far away that is as good."""


class _Anchor:
    """A place whose path to the station is known, and the places around it that see it.

    Attributes:
        place: where.
        length_m: what the path from there is accounted for, but for a detour of `DETOUR_M`.
        radius_m: from every place that is no farther, the straight way to the anchor is free.
        routes: what knows the path; None for one that goes on from `before`.
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
        terrain: what does not move.
        recovery: says what paths have to keep from fence and boxes.
        place: the station.
        clearance_m: body clearance from boxes of roomy paths.
        inset_m: distance from the fence of roomy paths.
        occupied: rectangles to keep out of: other robots' stations, as large as their robots need to be left alone.

    Attributes:
        place: the station.
        roomy: paths that keep so far from everything that no other module steps in.
        longest_m: length of the longest path, of the narrow ones too: where no other is, they are driven.
    """

    def __init__(
        self,
        terrain: Terrain,
        recovery: RecoveryPlanner,
        place: Point,
        clearance_m: float,
        inset_m: float,
        occupied: Sequence[Rectangle] = (),
    ) -> None:
        self.place: Final = place
        self._terrain: Final = terrain
        self._recovery: Final = recovery
        self._occupied: Final = tuple(occupied)
        self.roomy: Final = routes_to(terrain, place, clearance_m, inset_m, self._occupied)
        rules = recovery.rules
        self._fence_m: Final = recovery.path_m if rules.fence else -math.inf
        self._boxes_m: Final = recovery.path_m if rules.boxes else 0.0
        self._cap_m: Final = max(0.25, recovery.v_max_m_s * LOOK_S)
        self._anchor: _Anchor | None = None
        self._last: Point | None = None
        # Paths that keep only what certificates need.
        self.narrow: Final = routes_to(terrain, place, self._boxes_m, self._fence_m, self._occupied)
        self.longest_m: Final = max(self.roomy.longest_m, self.narrow.longest_m)

    @property
    def most_legs(self) -> int:
        """The largest number of legs of any path that the roadmaps show."""
        return max(self.roomy.most_legs, self.narrow.most_legs)

    def shortest_m(self, x_m: float, y_m: float) -> float:
        """Return the length of the path that the roadmaps show from a point; infinite where they show none."""
        entry = self.entry(x_m, y_m)
        length = self.roomy.distance_m(*entry)
        return (length if length < math.inf else self.narrow.distance_m(*entry)) + math.dist(entry, (x_m, y_m))

    def leads_back(self, x_m: float, y_m: float) -> bool:
        """Return whether the roadmaps show a path from a point, all of which keeps what paths keep."""
        x, y = self.entry(x_m, y_m)
        spare_m = min(self._terrain.clearance_m(x, y) - self._boxes_m, self._terrain.fence_m(x, y) - self._fence_m)
        return spare_m >= -_ROUNDING_M and self.shortest_m(x, y) < math.inf

    def track(self, x_m: float, y_m: float) -> None:
        """Keep the path up to date with where the robot is; call it at every tick."""
        here, anchor = (x_m, y_m), self._anchor
        if anchor is None or math.dist(here, anchor.place) > anchor.radius_m:
            self._anchor = self._find(here, anchor)
        self._last = here

    def length_m(self, x_m: float, y_m: float) -> float:
        """Return what the path home is accounted for, in metres; infinite where none is known."""
        anchor = self._anchor
        if anchor is not None:
            away_m = math.dist((x_m, y_m), anchor.place)
            if away_m <= anchor.radius_m:
                return away_m + anchor.length_m + DETOUR_M
        # Somebody asks about another place than the robot's.
        return self.shortest_m(x_m, y_m) + DETOUR_M

    def legs(self, x_m: float, y_m: float) -> list[Point]:
        """Return the corners of the path from a point, the station last; empty where none is known.

        It is looked for anew: one that leads back to the last anchor would turn a robot round that is on its way home.
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
        return Routes(self._terrain, self.place, self._boxes_m, self._fence_m, extra).legs(*entry)

    def entry(self, x_m: float, y_m: float) -> Point:
        """Return the nearest place that is as far from the fence, and from the nearest box, as paths are."""
        return self._terrain.beside(x_m, y_m, self._fence_m, self._boxes_m if self._recovery.rules.boxes else None)

    def _find(self, here: Point, anchor: _Anchor | None) -> _Anchor | None:
        """Return the anchor of a place that the last one does not see any more."""
        if anchor is not None and not self._terrain.convex:
            # From so near, going back is as good as a path that is looked for among a site's many corners.
            entry, found = self.entry(*here), anchor.before or anchor
            back_m = math.dist(entry, found.place)
            if back_m <= self._far_m(anchor) and self._recovery.free(*entry, *found.place):
                return _Anchor(entry, back_m + found.length_m, self._radius_m(here, entry, anchor), None, found)
        return self._look(here, anchor)

    def _far_m(self, anchor: _Anchor | None) -> float:
        """Return how far from an anchor the path need not be looked for again."""
        if anchor is None or self._terrain.convex:
            return self._cap_m
        return max(self._cap_m, _BACK_M, _FARTHER * anchor.length_m)

    def _radius_m(self, here: Point, entry: Point, anchor: _Anchor | None) -> float:
        """Return how far from `here` places may be that see the entry: distances change by a metre a metre."""
        terrain = self._terrain
        spare_m = min(terrain.clearance_m(*entry) - self._boxes_m, terrain.fence_m(*entry) - self._fence_m)
        return math.dist(here, entry) + min(max(spare_m, 0.0), self._far_m(anchor))

    def _look(self, here: Point, anchor: _Anchor | None) -> _Anchor | None:
        """Return the anchor of a place: of the paths that the roadmaps show and the way back, the best one."""
        entry = self.entry(*here)
        back = self._back_to(entry, anchor)
        back_m = math.inf if back is None else math.dist(entry, back.place) + back.length_m
        radius_m = self._radius_m(here, entry, anchor)
        if (length_m := self.roomy.distance_m(*entry)) <= back_m + DETOUR_M and length_m < math.inf:
            return _Anchor(entry, min(length_m, back_m), radius_m, self.roomy, None)
        if (length_m := self.narrow.distance_m(*entry)) <= back_m + DETOUR_M and length_m < math.inf:
            return _Anchor(entry, min(length_m, back_m), radius_m, self.narrow, None)
        return None if back is None else _Anchor(entry, back_m, radius_m, None, back)

    def _back_to(self, entry: Point, anchor: _Anchor | None) -> _Anchor | None:
        """Return the oldest anchor on the robot's way that it can go straight back to, or where it was a tick ago."""
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
