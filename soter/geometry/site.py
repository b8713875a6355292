"""A workspace of any shape: an outer boundary and keep-out areas that are polygons, anywhere. Metres, ENU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NoReturn

from soter.errors import ConfigError
from soter.geometry.grid import GridMap
from soter.geometry.workspace import Point, Ring, RobotPlace, Workspace

if TYPE_CHECKING:
    from soter.geometry.clearance import Field
    from soter.geometry.convex import Pieces
    from soter.geometry.nearest import Nearest

_ROUNDING_M: Final = 1e-9
_FAR_M: Final = 10.0
"""Without a fence, the ground up to this far around everything else is considered."""

_CELLS: Final = 4000
"""Near pieces are looked up in cells of 0.5 m, or larger ones: at most this many along a site's longer side."""

_RIM_M: Final = 1e15
"""Extent of the outside of a fence, farther than any place."""

_DIRECTIONS: Final = tuple((math.cos(k * math.pi / 16), math.sin(k * math.pi / 16)) for k in range(32))


class NotRectangular(ConfigError):
    """A workspace of another shape was given to code that only supports rectangles with axis-aligned boxes."""


def refuse(what: str) -> NoReturn:
    """Refuse to return a property of a site that only rectangles have.

    Raises:
        NotRectangular: always.
    """
    raise NotRectangular(
        f"it was asked for the {what} of a rectangle with boxes along its axes, which a workspace with polygons does "
        "not have; this part of SOTER works in rectangles only",
        key="workspace",
    )


@dataclass(frozen=True, slots=True)
class Area:
    """An area that robots keep out of.

    Attributes:
        name: its name in its file, for messages and pictures.
        ring: its corners.
        pieces: convex polygons that cover the area exactly.
        height_m: height above the ground.
    """

    name: str
    ring: Ring
    pieces: tuple[Ring, ...]
    height_m: float = 1.0


@dataclass(frozen=True, slots=True)
class GeoOrigin:
    """The geographic position, in WGS 84, of a site's point (0, 0)."""

    lat_deg: float
    lon_deg: float


@dataclass(frozen=True, slots=True)
class SitePlan:
    """The content of a site, as plain values that can be sent between processes.

    Attributes:
        fence: corners of the outer boundary; None without one.
        around: convex polygons that cover the fence's bounding box, minus the fence's inside, exactly.
        areas: areas that robots keep out of.
        robots: where robots start and charge.
        origin: the site's geographic position, if known.
        map: a map of what robots keep out of, in place of areas.
        far_around: `around` with fewer and fewer corners, for places farther and farther from the fence; empty if it
            has few.
    """

    fence: Ring | None
    around: tuple[Ring, ...]
    areas: tuple[Area, ...]
    robots: tuple[RobotPlace, ...]
    origin: GeoOrigin | None = None
    map: GridMap | None = None
    far_around: tuple[tuple[Ring, ...], ...] = ()


class Site(Workspace):
    """A workspace that is made of polygons.

    It can be used wherever a workspace can; properties that only rectangles with boxes have raise `NotRectangular`.
    """

    __slots__ = ("__dict__", "plan")

    plan: SitePlan

    def __init__(self, plan: SitePlan) -> None:
        object.__setattr__(self, "plan", plan)
        object.__setattr__(self, "robots", plan.robots)

    def __reduce__(self) -> tuple[Any, ...]:
        return Site, (self.plan,)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Site) and self.plan == other.plan

    def __hash__(self) -> int:
        return hash(self.plan)

    def __repr__(self) -> str:
        return f"Site({self.plan!r})"

    # Code that does not support polygons must not take a site for its bounding box.
    @property
    def width_m(self) -> NoReturn:
        refuse("width")

    @property
    def depth_m(self) -> NoReturn:
        refuse("depth")

    @property
    def boxes(self) -> NoReturn:
        refuse("boxes")

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        return self._bounds

    @cached_property
    def _bounds(self) -> tuple[float, float, float, float]:
        points = [*self.plan.fence] if self.plan.fence is not None else self._points()
        xs, ys = [x for x, _ in points], [y for _, y in points]
        rim_m = 0.0 if self.plan.fence is not None else _FAR_M
        return min(xs) - rim_m, min(ys) - rim_m, max(xs) + rim_m, max(ys) + rim_m

    def _points(self) -> list[Point]:
        places = [point for place in self.robots for point in ((place.x_m, place.y_m), place.charger.centre)]
        return [
            *(point for area in self.plan.areas for point in area.ring),
            *places,
            *(() if places else ((0.0, 0.0),)),
        ]

    @property
    def cell_m(self) -> float:
        """Side of the cells in which near pieces are looked up."""
        low_x, low_y, high_x, high_y = self.bounds
        return max(0.5, max(high_x - low_x, high_y - low_y) / _CELLS)

    @property
    def unders_m(self) -> tuple[float, ...]:
        """What distances from a fence with many corners may be less by: from ten times each of these on, as much."""
        return 0.05 * self.cell_m, 0.4 * self.cell_m

    @cached_property
    def keep_outs(self) -> Pieces:
        """The areas that robots keep out of, or the map's occupied cells."""
        if self.field is not None:
            return self.field
        return self._indexed([ring for area in self.plan.areas for ring in area.pieces], self.cell_m)

    @cached_property
    def field(self) -> Field | None:
        """Distances to the map's occupied cells; None without a map. They take seconds to compute."""
        if self.plan.map is None:
            return None
        # Imported here: only maps need the library.
        from soter.geometry.clearance import field_of

        return field_of(self.plan.map)

    @cached_property
    def outside(self) -> Pieces:
        """The outside of the fence, with a wide rim around its bounding box; empty without a fence."""
        return self._indexed((), self.cell_m) if self.plan.fence is None else self._outside(self.plan.around)

    @cached_property
    def from_fence(self) -> Nearest:
        """Distances to the outside of the fence; of one with many corners, large ones are lower bounds, see `far`."""
        found: Nearest = self.outside
        if self.plan.far_around:
            from soter.geometry.far import FarPieces

            for rings, under_m in zip(self.plan.far_around, self.unders_m, strict=False):
                found = FarPieces(found, self._outside(rings), under_m)
        return found

    def _outside(self, around: Sequence[Ring]) -> Pieces:
        low_x, low_y, high_x, high_y = self._bounds
        far_x, far_y, wide_x, wide_y = low_x - _RIM_M, low_y - _RIM_M, high_x + _RIM_M, high_y + _RIM_M
        rim = (
            ((far_x, far_y), (low_x, far_y), (low_x, wide_y), (far_x, wide_y)),
            ((high_x, far_y), (wide_x, far_y), (wide_x, wide_y), (high_x, wide_y)),
            ((far_x, far_y), (wide_x, far_y), (wide_x, low_y), (far_x, low_y)),
            ((far_x, high_y), (wide_x, high_y), (wide_x, wide_y), (far_x, wide_y)),
        )
        # Robots are mostly farther from it than from obstacles, where larger cells do as well.
        return self._indexed((*around, *rim), 2.0 * self.cell_m)

    def _indexed(self, rings: Sequence[Ring], cell_m: float) -> Pieces:
        # Imported here: a planner's worker process and robots' programs use sites, but need no index.
        from soter.geometry.convex import Pieces

        return Pieces(rings, cell_m)

    def fence_m(self, x_m: float, y_m: float) -> float:
        return self.from_fence.distance_m(x_m, y_m)

    def fence_along_m(self, ax_m: float, ay_m: float, bx_m: float, by_m: float, enough_m: float = math.inf) -> float:
        """Return the least distance to the fence along a straight line that begins inside; at most 0 if it leaves.

        A result above `enough_m` is returned as `enough_m`.
        """
        here_m, there_m = self.fence_m(ax_m, ay_m), self.fence_m(bx_m, by_m)
        least = min(here_m, there_m)
        if least <= 0.0:
            return least
        # The distance changes by at most a metre per metre.
        if here_m + there_m - math.hypot(bx_m - ax_m, by_m - ay_m) >= 2.0 * enough_m:
            return enough_m
        if self.from_fence.surely_keeps(ax_m, ay_m, bx_m, by_m, enough_m):
            return enough_m
        return self.outside.segment_m(ax_m, ay_m, bx_m, by_m, enough_m)

    def outlines(self) -> tuple[Ring | None, list[Ring]]:
        kept_out = [area.ring for area in self.plan.areas]
        return self.plan.fence, kept_out if self.plan.map is None else self.plan.map.outlines()

    def inset(self, by_m: float) -> list[Ring]:
        if self.plan.fence is None:
            return []
        from soter.geometry import decompose

        return decompose.inset(self.plan.fence, by_m)

    def clearance_m(self, x_m: float, y_m: float, body_radius_m: float) -> float:
        return self.keep_outs.distance_m(x_m, y_m) - body_radius_m

    def with_robots(self, count: int) -> Site:
        Workspace(1.0, 1.0, (), self.robots).with_robots(count)
        return Site(replace(self.plan, robots=self.robots[:count]))

    def freed(self, x_m: float, y_m: float, inset_m: float, clearance_m: float) -> Point:
        """Return a point near a place that is `inset_m` inside the fence and `clearance_m` from obstacles.

        It is found by moving away from what is too near, repeatedly; in narrow places the distances may be less.
        """
        if self.keep_outs.distance_m(x_m, y_m) >= clearance_m and self.fence_m(x_m, y_m) >= inset_m:
            return x_m, y_m
        for _ in range(_STEPS):
            walls = [
                *((away - clearance_m, ux, uy) for away, ux, uy in self.keep_outs.walls(x_m, y_m, clearance_m)),
                *((away - inset_m, ux, uy) for away, ux, uy in self.outside.walls(x_m, y_m, inset_m)),
            ]
            worst, ux, uy = min(walls, default=(0.0, 0.0, 0.0))
            if worst >= -_ROUNDING_M:
                break
            x_m, y_m = x_m + ux * worst, y_m + uy * worst
        return x_m, y_m

    def nearest_free(self, x_m: float, y_m: float, clearance_m: float) -> tuple[float, float] | None:
        """Return a point inside the fence at least `clearance_m` from every area: the nearest to within a tenth.

        In a map it is the corner of a cell.

        Returns:
            x and y in metres, the point itself if it is free; None if none is found.
        """

        def free(at: Point) -> bool:
            return self.contains(*at) and self.keep_outs.distance_m(*at) >= clearance_m - _ROUNDING_M

        if free((x_m, y_m)):
            return x_m, y_m
        if self.field is not None:
            return self.field.nearest_free(x_m, y_m, clearance_m)
        low_x, low_y, high_x, high_y = self.bounds
        far_m = 2.0 * math.hypot(high_x - low_x, high_y - low_y) + math.dist((x_m, y_m), (low_x, low_y))
        reach_m = 0.005
        while reach_m < far_m:
            ring = [(x_m + reach_m * ux, y_m + reach_m * uy) for ux, uy in _DIRECTIONS]
            found = [at for at in ring if free(at)]
            if found:
                return found[0]
            pushed = [at for at in (self.freed(*at, 0.0, clearance_m) for at in ring) if free(at)]
            if pushed:
                return min(pushed, key=lambda at: (math.dist(at, (x_m, y_m)), at))
            reach_m *= 1.1
        return None


_STEPS: Final = 40


def plain(workspace: Workspace) -> Workspace | SitePlan:
    """Return a workspace as plain values that can be serialised; `from_plain` makes it a workspace again."""
    return workspace.plan if isinstance(workspace, Site) else workspace


def from_plain(made_of: Workspace | SitePlan) -> Workspace:
    """Return the workspace that `plain` was given."""
    return Site(made_of) if isinstance(made_of, SitePlan) else made_of


__all__ = ["Area", "GeoOrigin", "NotRectangular", "Site", "SitePlan", "from_plain", "plain"]
