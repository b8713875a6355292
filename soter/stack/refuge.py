"""Finds where a robot retreats to: the nearest place in every static rule's phi_safer, far enough from peers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from soter.rta import Situation
from soter.stack.own_rules import OwnRule
from soter.stack.recovery import RecoveryPlanner
from soter.stack.right_of_way import BESIDE_M, Path, from_line
from soter.stack.routes import Routes
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, Terrain

LOOK_M: Final = (1.0, 2.5, 6.0)
TRIED: Final = 40
FEW: Final = 4
"""How many of the nearest candidates are tried by a path around boxes and peers, which takes longer to find."""

_ASKED: Final = 400
"""Of how many candidates, evenly spread by distance, the user's rules are asked."""

SEEDS: Final = 200
"""How many of the cells that are refuges are tried for a path."""

STEP_M: Final = 0.02
STEPS: Final = 40
_ROUNDING_M: Final = 1e-9
PIVOT_M: Final = 0.1
"""A turn in place takes about as long as driving this far."""

_BESIDE_M: Final = 0.1
"""A place is as good as a cell this near to it."""

_NEAR_M: Final = 8.0
"""How far around a station robots look for a way out."""


class RefugeFinder:
    """Finds refuges for one robot.

    Args:
        terrain: fence and boxes.
        recovery: certifies the paths.
        fence_m: least distance of a refuge to the fence.
        clearance_m: least body clearance of a refuge from boxes.

    Attributes:
        static: which cells of the terrain are refuges from fence and boxes.
        leave: a path of another robot that a refuge must not lie on; None if there is none.
        aside: whether any place will do where a robot can stand and leave again, because others need room.
        around: rectangles that hold where the user's own rules do not; paths lead around them.
    """

    def __init__(self, terrain: Terrain, recovery: RecoveryPlanner, fence_m: float, clearance_m: float) -> None:
        self._terrain: Final = terrain
        self._recovery: Final = recovery
        self._path_m: Final = recovery.path_m
        self.fence_m: Final = fence_m
        self.clearance_m: Final = clearance_m
        self.leave: Path | None = None
        self.aside = False
        self.around: Sequence[Rectangle] = ()
        self._kept: Sequence[OwnRule] = ()
        self.static: Final = terrain.roomy_cells(fence_m, clearance_m)
        self._standable: Final = terrain.roomy_cells(min(fence_m, self._path_m), min(clearance_m, self._path_m))
        self._roomy_cells: dict[tuple[tuple[Point, ...], float], NDArray[np.bool_]] = {}
        self._leads_out = False

    @property
    def needs_m(self) -> tuple[float, float]:
        """Distances from the fence and from boxes that a refuge needs at the moment."""
        if self.aside:
            return min(self.fence_m, self._path_m), min(self.clearance_m, self._path_m)
        return self.fence_m, self.clearance_m

    def peer_m(self, situation: Situation, peer_m: float) -> float:
        """Return the distance from peers that a refuge needs at the moment, at most `peer_m`."""
        return min(peer_m, self._recovery.apart_m(situation.age_s)) if self.aside else peer_m

    def way(self, situation: Situation, peer_m: float) -> list[Point]:
        """Return the corners of a path to the nearest refuge at least `peer_m` from every peer; empty if none.

        Where there is no refuge that keeps the user's own rules, another one will do.
        """
        if legs := self.kept_way(situation, peer_m):
            return legs
        self._kept = ()
        return self._way_there(situation, peer_m) if self._recovery.own_rules else []

    def kept_way(self, situation: Situation, peer_m: float) -> list[Point]:
        """Return a path as `way` does, to a refuge where no module of the user's takes the robot; empty if none."""
        self._kept = self._recovery.own_rules
        return self._way_there(situation, peer_m)

    def _way_there(self, situation: Situation, peer_m: float) -> list[Point]:
        # Any place that a robot gets to past its peers as they stand comes before one that they would have to free.
        for past_peers in (True, False) if self.aside and situation.peers else (False,):
            for leads_out in (True, False) if self.leave is not None else (False,):
                self._leads_out = leads_out
                if legs := self._way_aside(situation, peer_m, past_peers=past_peers):
                    return legs
        return []

    def _way_aside(self, situation: Situation, peer_m: float, *, past_peers: bool) -> list[Point]:
        if not self.aside:
            return self._way(situation, peer_m, past_peers=False)
        # Paths lead around squares about the peers, beyond whose corners they are certified all along.
        apart_m = self.peer_m(situation, peer_m)
        away_m = min(peer_m, math.sqrt(2.0) * apart_m)
        return self._way(situation, away_m, past_peers=past_peers) or self._way(
            situation, apart_m, past_peers=past_peers
        )

    def _way(self, situation: Situation, peer_m: float, *, past_peers: bool) -> list[Point]:
        ahead = self._along_heading(situation, peer_m)
        direct = self._straight_inside(situation, peer_m)
        if ahead is not None and (direct is None or _far(situation, ahead) < _far(situation, direct) + PIVOT_M):
            return [ahead]
        if direct is not None:
            return [direct]
        for look_m in LOOK_M:
            for spread in (False, True) if past_peers else (False,):
                candidates = self._candidates(situation, look_m, peer_m, spread=spread)
                for x_m, y_m in candidates:
                    if self._free(situation, x_m, y_m):
                        return [(x_m, y_m)]
                if legs := self._around(situation, candidates, past_peers=past_peers):
                    return legs
        return []

    def room_for(self, robots: int, apart_m: float, leads_back: Callable[[float, float], bool]) -> int:
        """Return how many robots find room in refuges at the same time, up to `robots`.

        A lower bound: places are chosen greedily, along the room and across it, from both ends.

        Args:
            robots: how many are enough.
            apart_m: distance between their centres.
            leads_back: whether a path leads from a place to the robot's station; other places do not count.
        """
        return _room(self._terrain, self._reached(leads_back).tobytes(), robots, apart_m)

    def _reached(self, leads_back: Callable[[float, float], bool]) -> NDArray[np.bool_]:
        """Return the refuges that are connected, through refuges, to a tried one from which a path leads back."""
        xs, ys, chosen = self._terrain.cell_x.ravel(), self._terrain.cell_y.ravel(), np.flatnonzero(self.static)
        tried = np.zeros(self.static.shape, dtype=np.bool_)
        for at in chosen[:: max(1, chosen.size // SEEDS)].tolist():
            tried.flat[at] = leads_back(float(xs[at]), float(ys[at]))
        return _connected(self.static, tried)

    def good(self, situation: Situation, place: Point, peer_m: float) -> bool:
        """Return whether a refuge is still far enough from every peer, and off the path to be left."""
        return self._clear(situation, place, self.peer_m(situation, peer_m))

    def _clear(self, situation: Situation, place: Point, peer_m: float) -> bool:
        if self.leave is not None and self.leave.near(*place):
            return False
        return all(math.hypot(peer.x_m - place[0], peer.y_m - place[1]) >= peer_m for peer in situation.peers)

    def _free(self, situation: Situation, x_m: float, y_m: float) -> bool:
        """Return whether a straight line there passes all boxes, and all peers if others need room."""
        own = situation.own
        if self.aside and any(
            from_line(p.x_m, p.y_m, (own.x_m, own.y_m), (x_m, y_m)) < self._recovery.rules.separation_m
            for p in situation.peers
        ):
            return False
        return self._recovery.sees(situation, x_m, y_m, self.needs_m[1]) and all(
            rule.allows_stay(own.robot_id, x_m, y_m) and rule.allows_way(own, x_m, y_m) for rule in self._kept
        )

    def _around(self, situation: Situation, candidates: list[Point], *, past_peers: bool) -> list[Point]:
        """Return a path to one of several places around boxes, and around peers if that is asked for."""
        own, apart_m = situation.own, self._recovery.apart_m(situation.age_s)
        peers = situation.peers if past_peers else ()
        rooms = [(p.x_m - apart_m, p.y_m - apart_m, p.x_m + apart_m, p.y_m + apart_m) for p in peers]
        for place in candidates[:: TRIED // FEW] if self.aside else candidates[:1]:
            around = (*rooms, *self.around) if self._kept else rooms
            routes = Routes(self._terrain, place, self._path_m, min(self._path_m, self.fence_m), around)
            if legs := routes.legs(own.x_m, own.y_m):
                return legs
        return []

    def _along_heading(self, situation: Situation, peer_m: float) -> Point | None:
        """Return the nearest refuge straight behind or ahead, which costs no turn."""
        own, terrain = situation.own, self._terrain
        fence_m, clearance_m = self.needs_m
        cos, sin = math.cos(own.heading_rad), math.sin(own.heading_rad)
        for step in range(1, STEPS):
            for length in (-step * STEP_M, step * STEP_M):
                place = (own.x_m + length * cos, own.y_m + length * sin)
                if (
                    terrain.fence_m(*place) >= fence_m
                    and terrain.clearance_m(*place) >= clearance_m
                    and self._clear(situation, place, peer_m)
                    and self._may_leave(place)
                    and self._free(situation, *place)
                ):
                    return place
        return None

    def _straight_inside(self, situation: Situation, peer_m: float) -> Point | None:
        """Return the nearest point far enough from the fence, if boxes and peers allow it; finer than the cells."""
        own, terrain = situation.own, self._terrain
        inset, clearance_m = self.needs_m
        place = terrain.inside(own.x_m, own.y_m, inset)
        if terrain.fence_m(*place) < inset - _ROUNDING_M:
            return None
        fits = terrain.clearance_m(*place) >= clearance_m and self._clear(situation, place, peer_m)
        return place if fits and self._may_leave(place) and self._free(situation, *place) else None

    def _candidates(self, situation: Situation, look_m: float, peer_m: float, *, spread: bool) -> list[Point]:
        """Return the nearest cells that may be refuges, or, if `spread`, some of all, the nearest first."""
        own, terrain = situation.own, self._terrain
        window = terrain.window(own.x_m, own.y_m, look_m)
        xs, ys = terrain.cell_x[window], terrain.cell_y[window]
        fits = (self._standable if self.aside else self.static)[window].copy()
        for peer in situation.peers:
            fits &= (xs - peer.x_m) ** 2 + (ys - peer.y_m) ** 2 >= peer_m * peer_m
        chosen = np.flatnonzero(fits)
        if not chosen.size:
            return []
        distance = (xs.ravel()[chosen] - own.x_m) ** 2 + (ys.ravel()[chosen] - own.y_m) ** 2
        # A stable sort, so that equally near cells are tried in the same order on every host.
        nearest = chosen[np.argsort(distance, kind="stable")]
        if self._kept:
            # Foreign code may be slow.
            nearest = nearest[:: max(1, nearest.size // _ASKED)]
        if spread:
            nearest = nearest[:: max(1, nearest.size // TRIED)]
        places = ((float(x), float(y)) for x, y in zip(xs.ravel()[nearest], ys.ravel()[nearest], strict=True))
        return list(islice((place for place in places if self._may_stay(situation, place)), TRIED))

    def _may_stay(self, situation: Situation, place: Point) -> bool:
        """Return whether nothing else takes a robot from that place: no path to be left, and no rule of the user's."""
        if self.leave is not None and self.leave.near(*place):
            return False
        return self._may_leave(place) and all(rule.allows_stay(situation.robot_id, *place) for rule in self._kept)

    def _may_leave(self, place: Point) -> bool:
        """Return whether refuges lead out from a place, past those who need room, once they stand on their stations.

        A robot in a corner behind a station would have to wait there until whoever charges has left.
        """
        leave = self.leave
        if leave is None or not self._leads_out:
            return True
        roomy = self._roomy_cells.get((leave.ends, leave.apart_m))
        if roomy is None:
            roomy = self._roomy_cells[leave.ends, leave.apart_m] = self._roomy(leave)
        return bool(roomy[self._terrain.window(*place, _BESIDE_M)].any())

    def _roomy(self, leave: Path) -> NDArray[np.bool_]:
        """Return the cells but those near a station that robots on their stations, where paths end, shut in."""
        terrain, roomy = self._terrain, np.ones(self.static.shape, dtype=np.bool_)
        for end in leave.ends:
            near = terrain.window(*end, _NEAR_M)
            fits = self.static[near].copy()
            for x_m, y_m in leave.ends:
                away_m = np.hypot(terrain.cell_x[near] - x_m, terrain.cell_y[near] - y_m)
                fits &= away_m >= leave.apart_m + BESIDE_M
            roomy[near] &= _largest(fits)
        return roomy


def _largest(fits: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the largest connected part of the cells that fit."""
    left, largest = fits.copy(), np.zeros(fits.shape, dtype=np.bool_)
    while np.count_nonzero(left) > np.count_nonzero(largest):
        first = np.zeros(fits.shape, dtype=np.bool_)
        first.flat[int(left.argmax())] = True
        part = _connected(fits, first)
        largest = max(largest, part, key=np.count_nonzero)
        left &= ~part
    return largest


@lru_cache(maxsize=8)
def _room(terrain: Terrain, within: bytes, robots: int, apart_m: float) -> int:
    """Return how many robots find room in cells; see `RefugeFinder.room_for`. Most robots have the same cells."""
    most, cells = 0, np.frombuffer(within, dtype=np.bool_).reshape(terrain.cell_x.shape)
    for order in ("C", "F"):
        xs, ys = (each.ravel(order)[cells.ravel(order)] for each in (terrain.cell_x, terrain.cell_y))
        for free_x, free_y in ((xs, ys), (xs[::-1], ys[::-1])):
            found = 0
            while found < robots and free_x.size:
                found += 1
                left = (free_x - free_x[0]) ** 2 + (free_y - free_y[0]) ** 2 >= apart_m * apart_m
                free_x, free_y = free_x[left], free_y[left]
            most = max(most, found)
    return most


def _connected(fits: NDArray[np.bool_], reached: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells that are connected to a reached one through cells that fit, side by side."""
    count = 0
    while (now := int(np.count_nonzero(reached))) > count:
        count = now
        for turned in range(4):
            reached = np.rot90(_along_rows(np.rot90(fits, turned), np.rot90(reached, turned)), -turned)
    return reached


def _along_rows(fits: NDArray[np.bool_], reached: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cells fit and follow a reached one with only fitting cells in between."""
    index = np.arange(fits.shape[1])
    stopped = np.maximum.accumulate(np.where(fits, -1, index), axis=1)
    begun = np.maximum.accumulate(np.where(reached & fits, index, -1), axis=1)
    return np.asarray(fits & (begun > stopped))


def _far(situation: Situation, place: Point) -> float:
    return math.hypot(place[0] - situation.own.x_m, place[1] - situation.own.y_m)
