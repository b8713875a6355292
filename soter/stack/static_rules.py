"""Geofence and obstacles: the robot's centre stays inside the fence, and its body clear of obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from soter.geometry.convex import Pieces
from soter.geometry.nearest import Nearest
from soter.rta import Region, Situation, Threat
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Terrain


@dataclass(frozen=True)
class Fence(Region):
    """A rectangle of positions; its margin is the distance to the nearest side, negative outside."""

    low_x_m: float
    high_x_m: float
    low_y_m: float
    high_y_m: float

    def margin(self, situation: Situation) -> float:
        own = situation.own
        x, y = own.x_m, own.y_m
        return min(x - self.low_x_m, self.high_x_m - x, y - self.low_y_m, self.high_y_m - y)

    def threats(self, situation: Situation) -> tuple[Threat, ...]:
        own = situation.own
        x, y = own.x_m, own.y_m
        return (
            Threat(x - self.low_x_m, -1.0, 0.0),
            Threat(self.high_x_m - x, 1.0, 0.0),
            Threat(y - self.low_y_m, 0.0, -1.0),
            Threat(self.high_y_m - y, 0.0, 1.0),
        )

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Fence):
            raise TypeError(f"phi_safer of a fence is a fence, not {type(safer).__name__}")
        return min(
            safer.low_x_m - self.low_x_m,
            self.high_x_m - safer.high_x_m,
            safer.low_y_m - self.low_y_m,
            self.high_y_m - safer.high_y_m,
        )

    def inset(self, by_m: float) -> Fence:
        """Return the fence drawn in by `by_m` on every side."""
        return Fence(self.low_x_m + by_m, self.high_x_m - by_m, self.low_y_m + by_m, self.high_y_m - by_m)


@dataclass(frozen=True)
class SiteFence(Region):
    """Positions inside a polygonal fence; the margin is the distance to the fence, negative outside.

    Its parts are the distances to the convex pieces of the outside.

    Attributes:
        away: distances to the outside of the fence.
        outside: the outside of the fence.
        inset_m: how far inside the fence the region begins.
        look_m: parts that exceed the least by more than this cannot become the least before the next look.
    """

    away: Nearest
    outside: Pieces
    inset_m: float = 0.0
    look_m: float = math.inf

    def margin(self, situation: Situation) -> float:
        own = situation.own
        return self.away.distance_m(own.x_m, own.y_m) - self.inset_m

    def threats(self, situation: Situation) -> list[Threat]:
        x, y = situation.own.x_m, situation.own.y_m
        parts = self.outside.walls(x, y, self.away.distance_m(x, y) + self.look_m)
        return [Threat(away - self.inset_m, ux, uy) for away, ux, uy in parts]

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, SiteFence):
            raise TypeError(f"phi_safer of a site's fence is one, not {type(safer).__name__}")
        return safer.inset_m - self.inset_m

    def inset(self, by_m: float) -> SiteFence:
        """Return the region that begins `by_m` farther inside."""
        return replace(self, inset_m=self.inset_m + by_m)


def fence_of(terrain: Terrain, look_m: float) -> Fence | SiteFence:
    """Return the region inside a fence.

    Args:
        terrain: the terrain with the fence.
        look_m: how far a robot gets before the next look, at most.
    """
    if isinstance(terrain, SiteTerrain):
        return SiteFence(terrain.site.from_fence, terrain.site.outside, 0.0, look_m)
    return Fence(0.0, terrain.width_m, 0.0, terrain.depth_m)


@dataclass(frozen=True)
class Clearance(Region):
    """Positions in which the body is at least `least_m` clear of every box.

    Attributes:
        terrain: the boxes.
        least_m: clearance at the edge of the region.
        path_m: clearance of return paths, and their distance from the fence.
        fenced: whether robots have to stay inside the fence.
        look_m: boxes that are farther than the nearest by more than this cannot become it before the next look.
    """

    terrain: Terrain
    least_m: float = 0.0
    path_m: float = 0.0
    fenced: bool = False
    look_m: float = math.inf

    def margin(self, situation: Situation) -> float:
        own = situation.own
        return self.terrain.clearance_m(own.x_m, own.y_m) - self.least_m

    def leaves_room(self, situation: Situation, margin: float, keep: float, fall: float) -> bool:
        own, terrain = situation.own, self.terrain
        if not terrain.convex:
            # Straight inwards may not lead away from everything near, and a single box may be several pieces.
            return margin - keep >= fall
        x, y, path_m = own.x_m, own.y_m, self.path_m
        # As by `fence_m`; this is asked at every decision.
        open_x, open_y = path_m <= x <= terrain.width_m - path_m, path_m <= y <= terrain.depth_m - path_m
        if self.fenced and not (open_x and open_y):
            # Near the fence the robot first drives inwards, so there must be room for its body there, too.
            margin = min(margin, terrain.clearance_m(*terrain.inside(x, y, path_m)) - self.least_m)
        if margin - keep >= fall:
            return True
        fence_m = terrain.fence_m(x, y) if self.fenced else math.inf
        # Beside a single box in the open it can drive straight away from it, wherever the AC has taken it.
        others = sorted(clearance for clearance, _, _ in terrain.walls(x, y))[1:2]
        return min([fence_m, *(clearance - self.least_m for clearance in others)]) >= 2.0 * path_m + fall

    def threats(self, situation: Situation) -> list[Threat]:
        own = situation.own
        reach_m = self.terrain.clearance_m(own.x_m, own.y_m) + self.look_m
        walls = self.terrain.walls(own.x_m, own.y_m, reach_m)
        return [Threat(clearance - self.least_m, ux, uy) for clearance, ux, uy in walls]

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Clearance):
            raise TypeError(f"phi_safer of a clearance is a clearance, not {type(safer).__name__}")
        return safer.least_m - self.least_m
