"""Where a robot retreats to: the nearest place that is safer for every static rule and far enough from the peers."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from soter.rta import Situation
from soter.stack.recovery import RecoveryPlanner
from soter.stack.routes import Routes
from soter.stack.terrain import Point, Terrain

LOOK_M: Final = (1.0, 2.5)
TRIED: Final = 40
STEP_M: Final = 0.02
STEPS: Final = 40
PIVOT_M: Final = 0.1
"""A turn in place takes about as long as driving so far."""


class RefugeFinder:
    """Finds refuges for one robot.

    Args:
        terrain: what does not move.
        recovery: certifies the ways.
        fence_m: distance to the fence that a refuge has at least.
        clearance_m: body clearance from boxes that a refuge has at least.

    Attributes:
        static: which cells of the terrain are refuges as far as fence and boxes go.
    """

    def __init__(self, terrain: Terrain, recovery: RecoveryPlanner, fence_m: float, clearance_m: float) -> None:
        self._terrain: Final = terrain
        self._recovery: Final = recovery
        self.fence_m: Final = fence_m
        self.clearance_m: Final = clearance_m
        self.static: Final = (terrain.cell_fence >= fence_m) & (terrain.cell_clearance >= clearance_m)

    def way(self, situation: Situation, peer_m: float) -> list[Point]:
        """Return the legs of a way to the nearest refuge at least `peer_m` from every peer; empty if there is none."""
        ahead = self._along_heading(situation, peer_m)
        direct = self._straight_inside(situation, peer_m)
        if ahead is not None and (direct is None or _far(situation, ahead) < _far(situation, direct) + PIVOT_M):
            return [ahead]
        if direct is not None:
            return [direct]
        for look_m in LOOK_M:
            candidates = self._candidates(situation, look_m, peer_m)
            for x_m, y_m in candidates:
                if self._recovery.sees(situation, x_m, y_m, self.clearance_m):
                    return [(x_m, y_m)]
            if candidates:
                own = situation.own
                routes = Routes(self._terrain, candidates[0], self.clearance_m, self.fence_m)
                return routes.legs(own.x_m, own.y_m)
        return []

    def good(self, situation: Situation, place: Point, peer_m: float) -> bool:
        """Return whether a refuge is still far enough from every peer."""
        return all(math.hypot(peer.x_m - place[0], peer.y_m - place[1]) >= peer_m for peer in situation.peers)

    def _along_heading(self, situation: Situation, peer_m: float) -> Point | None:
        """The nearest place straight behind or ahead: it costs no turn."""
        own, terrain = situation.own, self._terrain
        cos, sin = math.cos(own.heading_rad), math.sin(own.heading_rad)
        for step in range(1, STEPS):
            for length in (-step * STEP_M, step * STEP_M):
                place = (own.x_m + length * cos, own.y_m + length * sin)
                if (
                    terrain.fence_m(*place) >= self.fence_m
                    and terrain.clearance_m(*place) >= self.clearance_m
                    and self.good(situation, place, peer_m)
                    and self._recovery.sees(situation, *place, self.clearance_m)
                ):
                    return place
        return None

    def _straight_inside(self, situation: Situation, peer_m: float) -> Point | None:
        """The nearest point far enough from the fence, if it also fits boxes and peers: finer than cells are."""
        own, terrain = situation.own, self._terrain
        inset = self.fence_m
        place = (
            min(max(own.x_m, inset), terrain.width_m - inset),
            min(max(own.y_m, inset), terrain.depth_m - inset),
        )
        fits = terrain.clearance_m(*place) >= self.clearance_m and self.good(situation, place, peer_m)
        return place if fits and self._recovery.sees(situation, *place, self.clearance_m) else None

    def _candidates(self, situation: Situation, look_m: float, peer_m: float) -> list[Point]:
        own, terrain = situation.own, self._terrain
        window = terrain.window(own.x_m, own.y_m, look_m)
        xs, ys = terrain.cell_x[window], terrain.cell_y[window]
        fits = self.static[window].copy()
        for peer in situation.peers:
            fits &= (xs - peer.x_m) ** 2 + (ys - peer.y_m) ** 2 >= peer_m * peer_m
        chosen = np.flatnonzero(fits)
        if not chosen.size:
            return []
        distance = (xs.ravel()[chosen] - own.x_m) ** 2 + (ys.ravel()[chosen] - own.y_m) ** 2
        # A stable sort, so that equally near cells are tried in one order everywhere.
        nearest = chosen[np.argsort(distance, kind="stable")[:TRIED]]
        return [(float(x), float(y)) for x, y in zip(xs.ravel()[nearest], ys.ravel()[nearest], strict=True)]


def _far(situation: Situation, place: Point) -> float:
    return math.hypot(place[0] - situation.own.x_m, place[1] - situation.own.y_m)
