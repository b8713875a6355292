"""The user's own rules, which every safe controller keeps; only their margin is known."""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from soter.geometry.workspace import Box, RobotPlace, grown
from soter.rta import Region, Sample, Situation
from soter.sdk import Link, RobotState
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Edges, Point, Terrain

_FAR_M: Final = 10.0
_CLOSE_ENOUGH_M: Final = 0.005
_STEP_M: Final = 0.1
_ROUNDING: Final = 1e-9
_CELLS: Final = 80
_STRIPS: Final = 8
"""Number of strips of rows that cover a forbidden area; one rectangle around a disc would waste its corners."""
_SHARES: Final = (0.5, 1.0)
"""Points of a leg, as shares of its length, at which the margin is evaluated."""


class OwnRule(NamedTuple):
    """The rule of a user's module.

    Attributes:
        region: its phi_safe.
        of_pairs: whether peers use up its margin as well.
        safer: its phi_safer; None if that is no region.
        noise: how far margins may be off.
        needs: the least margin of phi_safe with which the module leaves a robot to its AC.
        name: the module's.
    """

    region: Region
    of_pairs: bool
    safer: Region | None = None
    noise: float = 0.0
    needs: float = 0.0
    name: str = ""

    def allows_stay(self, robot_id: int, x_m: float, y_m: float) -> bool:
        """Return whether the module would give a robot at rest there to its AC; elsewhere it may take the robot itself.

        With a rule about pairs that depends on the others.
        """
        return self.safer is None or self.of_pairs or _margin(self.safer, robot_id, x_m, y_m) >= self.noise

    def allows_way(self, own: Sample, x_m: float, y_m: float) -> bool:
        """Return whether the module leaves a robot on a straight line there to others, or it comes no farther out."""
        if self.safer is None or self.of_pairs:
            return True
        least = min(self.needs, _margin(self.region, own.robot_id, own.x_m, own.y_m) - _ROUNDING)
        return broken_on(self.region, own.robot_id, [(own.x_m, own.y_m), (x_m, y_m)], least) is None

    def outside(self, robot_id: int, line: Sequence[Point]) -> str:
        """Return where on a line the module would not give a robot at rest to its AC, in words; empty if it would."""
        if self.safer is None or self.of_pairs or (where := broken_on(self.safer, robot_id, line, self.noise)) is None:
            return ""
        margin, unit = _margin(self.safer, robot_id, *where), self.safer.unit
        return (
            f"({where[0]:.4g}, {where[1]:.4g}), where the margin of phi_safer of '{self.name}' is {margin:.3f} {unit} "
            f"and has to be {self.noise:.3f} {unit}"
        )

    def allows(
        self, situation: Situation, bx_m: float, by_m: float, off_m: float, off_rad: float, peer_m: float
    ) -> bool:
        """Return whether the rule holds along the leg to b, wherever the robot may stray, or the leg leads away.

        The margin is evaluated as if the robot were there already, at its present speed. A rule that raises allows no
        leg; its decision module raises as well, and reports why.

        Args:
            situation: the robot's.
            bx_m: the leg's end, east.
            by_m: the leg's end, north.
            off_m: how far the robot may stray.
            off_rad: at what angle to the leg it may really drive.
            peer_m: how far a peer may come nearer before this robot sees it.
        """
        strays, directions = _places(situation.own, bx_m, by_m, off_m), _directions(situation.own, bx_m, by_m, off_rad)
        # Each of a pair has half of that pair's own margin, whichever peer is the nearest.
        pairs = [_alone(situation, peer) for peer in situation.peers] if self.of_pairs else []
        try:
            return all(self._keeps(each, strays, directions, peer_m) for each in (situation, *pairs))
        except KeyboardInterrupt:
            raise
        except BaseException:  # noqa: BLE001 - foreign code must not take the shipped safe controllers along
            return False

    def _keeps(self, situation: Situation, strays: list[Point], directions: list[Point], peer_m: float) -> bool:
        now = self.region.margin(situation.copy())
        least = self._least(now, peer_m)
        # Written so that NaN allows nothing. A margin that stays as it is says nothing of what is aside.
        return all(self.region.margin(_moved(situation, *place)) >= least for place in strays) or all(
            self.region.margin(_moved(situation, *place)) > now for place in directions
        )

    def _least(self, margin: float, peer_m: float) -> float:
        if self.of_pairs and margin > 0.0:
            # Half of the margin is the peer's, which may be on its way.
            return min(margin, margin / 2.0 + peer_m)
        return min(0.0, margin)


def apart_m(region: Region, place: RobotPlace) -> float:
    """Return how far from a robot at rest its peers have to be for a rule about pairs to hold.

    Found by evaluating the rule, so it is a guess: 0 if peers 10 m away break the rule, if it raises, or if it allows
    peers anywhere. Progress may rest on it; safety does not.
    """
    own = _at_rest(place.id, place.x_m, place.y_m)
    situation = Situation(place.id, own, 0.0)

    def holds(distance_m: float) -> bool:
        peers = ((distance_m, 0.0), (-distance_m, 0.0), (0.0, distance_m), (0.0, -distance_m))
        for dx_m, dy_m in peers:
            situation.peers = [_at_rest(place.id + 1, own.x_m + dx_m, own.y_m + dy_m)]
            if not region.margin(situation) >= 0.0:
                return False
        return True

    try:
        if holds(0.0) or not holds(_FAR_M):
            return 0.0
        low_m, high_m = 0.0, _FAR_M
        while high_m - low_m > _CLOSE_ENOUGH_M:
            middle_m = (low_m + high_m) / 2.0
            low_m, high_m = (low_m, middle_m) if holds(middle_m) else (middle_m, high_m)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - foreign code; its decision module raises as well, and reports it
        return 0.0
    return high_m


def forbidden(region: Region, place: RobotPlace, terrain: Terrain, beside_m: float) -> list[Rectangle]:
    """Return rectangles that return paths go around so that a rule about one robot holds on them.

    Only the rule's margin is known, so it is evaluated all over the room, as if the robot stood there. If the station
    itself would be in a rectangle, none are returned, since no path could avoid it. Progress rests on this, safety does
    not; `broken_on` finds what is left.
    """
    xs, ys, step_m = _grid(terrain.bounds)
    broken = _broken(region, place.id, terrain.bounds)
    rows = np.flatnonzero(broken.any(axis=1))
    strips = np.array_split(rows, min(_STRIPS, len(rows))) if len(rows) else []
    found = [
        grown(Box(float(xs[low]), float(ys[strip[0]]), float(xs[high]), float(ys[strip[-1]])), step_m + beside_m)
        for strip in strips
        for low, high in _runs(np.any(broken[strip[0] : strip[-1] + 1], axis=0))
    ]
    x_m, y_m = place.charger.centre
    return [] if any(box[0] <= x_m <= box[2] and box[1] <= y_m <= box[3] for box in found) else found


def _grid(bounds: Edges) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], float]:
    low_x, low_y, high_x, high_y = bounds
    step_m = max(high_x - low_x, high_y - low_y) / _CELLS
    return np.arange(low_x, high_x + step_m, step_m), np.arange(low_y, high_y + step_m, step_m), step_m


def _broken(region: Region, robot_id: int, bounds: Edges) -> npt.NDArray[np.bool_]:
    """Return where the rule does not hold, on a grid all over the room.

    Trials declare the same regions hundreds of times; what a region has in it says which, not its author's equality.
    """
    try:
        key = type(region), pickle.dumps(vars(region)), robot_id, bounds
    except Exception:  # noqa: BLE001 - a region of any kind
        key = None
    if key is None or (found := _known.get(key)) is None:
        xs, ys, _ = _grid(bounds)
        found = np.array([[not _margin(region, robot_id, float(x), float(y)) >= 0.0 for x in xs] for y in ys])
        if key is not None:
            if len(_known) >= _KNOWN:
                _known.clear()
            _known[key] = found
    return found


_KNOWN: Final = 16
_known: Final[dict[tuple[type, bytes, int, Edges], npt.NDArray[np.bool_]]] = {}


def _runs(row: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and the last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], row, [False]))))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]


def broken_on(region: Region, robot_id: int, line: Sequence[Point], least: float = 0.0) -> Point | None:
    """Return the first place on a line where a robot at rest has a margin below `least`; None if there is none."""
    for (ax_m, ay_m), (bx_m, by_m) in pairwise(line):
        steps = max(1, math.ceil(math.hypot(bx_m - ax_m, by_m - ay_m) / _STEP_M))
        for step in range(steps + 1):
            x_m, y_m = ax_m + (bx_m - ax_m) * step / steps, ay_m + (by_m - ay_m) * step / steps
            # Written so that NaN counts as less.
            if not _margin(region, robot_id, x_m, y_m) >= least:
                return x_m, y_m
    return None


def _margin(region: Region, robot_id: int, x_m: float, y_m: float) -> float:
    """Return the margin of a robot at rest there; infinity if it raises: its decision module reports that."""
    try:
        return float(region.margin(Situation(robot_id, _at_rest(robot_id, x_m, y_m), 0.0)))
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - foreign code
        return math.inf


def _at_rest(robot_id: int, x_m: float, y_m: float) -> RobotState:
    return RobotState(robot_id, 0.0, 0.0, x_m, y_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, None, None, Link.UP)


class _Moved:
    """A sample of a robot as if it were elsewhere."""

    def __init__(self, own: Sample, x_m: float, y_m: float) -> None:
        self._own: Final = own
        self.x_m: Final = x_m
        self.y_m: Final = y_m

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own, name)


def _places(own: Sample, bx_m: float, by_m: float, off_m: float) -> list[tuple[float, float]]:
    """Return where the robot may be on its way to b: half-way and at the end, and off both, to the sides and ahead."""
    dx, dy = bx_m - own.x_m, by_m - own.y_m
    length_m = math.hypot(dx, dy) or 1.0
    ux, uy = dx / length_m, dy / length_m
    return [
        (own.x_m + part * dx + ahead_m * ux - left_m * uy, own.y_m + part * dy + ahead_m * uy + left_m * ux)
        for part in _SHARES
        for ahead_m, left_m in ((0.0, 0.0), (0.0, off_m), (0.0, -off_m), (off_m, 0.0))
    ]


def _directions(own: Sample, bx_m: float, by_m: float, off_rad: float) -> list[Point]:
    """Return where the robot is half-way and at the end of a leg if it drives at any angle that it may have to it."""
    dx, dy = bx_m - own.x_m, by_m - own.y_m
    turns = [(math.cos(angle), math.sin(angle)) for angle in (-off_rad, 0.0, off_rad)]
    return [
        (own.x_m + part * (cos * dx - sin * dy), own.y_m + part * (sin * dx + cos * dy))
        for part in _SHARES
        for cos, sin in turns
    ]


def _alone(situation: Situation, peer: Sample) -> Situation:
    """Return the situation as if there were no other peer."""
    there = situation.copy()
    there.peers = [peer]
    return there


def _moved(situation: Situation, x_m: float, y_m: float) -> Situation:
    there = Situation(situation.robot_id, _Moved(situation.own, x_m, y_m), situation.now_s)
    there.peers = tuple(situation.peers)
    return there
