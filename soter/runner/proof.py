"""P2a and P2b of the shipped modules for one robot, proved over covers of the workspace.

The claim of a module is about the states from which its safe controller starts: at rest, with the margins that the
decision modules have left it. What is proved, and from what (numbers as in docs/writing-a-module.md):

1. A decision module that fires leaves its margin at v Delta or more once the robot has stopped: of the horizon, one
   Delta has passed, the latency and the way to stop are used up, and the second Delta is what is left. Modules that
   stand before the driving one have not fired, so their margins are at least R at their last look, less v Delta.
2. Distances to the fence and clearances from boxes change by at most 1 metre a metre. So do their least values along a
   straight leg when its ends move. What holds at the centre of a cell with its half-diagonal to spare, holds in it.
3. The robot stays within its tube of the straight line from where it stood to the place that it is sent to (assumed;
   the conformance kit measures it). A leg that keeps two tubes from everything is certified at every later look too,
   from wherever in the tube the robot is then, because the tube is convex. So it is driven to its end without a halt.
4. A leg that does not come nearer to a box than it begins is such a leg if it begins two tubes away. The finder of
   refuges takes no others. Along a straight line the distance to a box is convex, hence it does not fall where it does
   not fall at the beginning.
5. At its end the robot holds, in phi_safer, for as long as it takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from soter.check import OUTSIDE, Cell, Cover, Judged, Status, cover
from soter.rta import RTAModule, SpeedBound, Timing
from soter.sdk import Capabilities
from soter.stack.declaration import GEOFENCE, OBSTACLE, Declared
from soter.stack.refuge import LOOK_M, PIVOT_M, STEP_M, STEPS, TRIED
from soter.stack.right_of_way import BATTERY
from soter.stack.terrain import CELL_M, Edges, Point, Terrain, segment_to_box

LEAST_SIDE_M: Final = 0.0125
_SIDE_M: Final = 0.2


@dataclass(frozen=True, slots=True)
class Claim:
    """Where a module's safe controller may have to start.

    Attributes:
        fence_m: least distance to the fence; minus infinity where no module keeps it.
        clearance_m: least body clearance from boxes, likewise.
    """

    fence_m: float
    clearance_m: float


@dataclass(frozen=True)
class Setting:
    """What a proof is about.

    Attributes:
        terrain: fence and boxes.
        declared: the robot's modules and what their safe controllers use.
        capabilities: what the robot promises.
    """

    terrain: Terrain
    declared: Declared
    capabilities: Capabilities

    @property
    def tube_m(self) -> float:
        """How far the robot may be from where a certificate has it: tracking error and noise."""
        return self.capabilities.tube_m + self.capabilities.position_noise_m

    def module(self, name: str) -> RTAModule | None:
        """Return a module by name, or None if it is off."""
        return next((module for module in self.declared.modules if module.name == name), None)

    def claim(self, name: str) -> Claim:
        """Return where the safe controller of a module may start (1 above)."""
        before = [module.name for module in self.declared.modules]
        before = before[: before.index(name)]
        return Claim(*(self._left_m(each, each in before) for each in (GEOFENCE, OBSTACLE)))

    def _left_m(self, name: str, unfired: bool) -> float:
        module = self.module(name)
        if module is None:
            return -math.inf
        timing, v = self.declared.timing, self.capabilities.v_max_m_s
        if not isinstance(module.model, SpeedBound):
            # A model that depends on the state may leave less: only that the margin does not get negative is known.
            return 0.0
        if not unfired:
            return v * module.delta_s
        return module.model.bound(_look_s(module, timing)) - v * module.delta_s


def _look_s(module: RTAModule, timing: Timing) -> float:
    return module.horizon_s(timing) - timing.sample_age_s


def prove_retreat(setting: Setting, name: str) -> Cover:
    """Prove P2a and P2b of a module whose safe controller retreats to a refuge, for a robot that is alone.

    The cost of a cell is a bound on the length of the way, in metres.

    Args:
        setting: what it is about.
        name: obstacle or geofence.
    """
    return _cover(setting, _Retreats(setting, setting.claim(name)).judge)


def prove_way_home(setting: Setting) -> Cover:
    """Prove that the battery's safe controller gets home by certified legs, for a robot that is alone.

    The cost of a cell is a bound on the length of the way home, in metres.
    """
    return _cover(setting, _WaysHome(setting, setting.claim(BATTERY)).judge)


def _cover(setting: Setting, judge: Callable[[Cell], Judged]) -> Cover:
    return cover(setting.terrain.width_m, setting.terrain.depth_m, judge, _SIDE_M, LEAST_SIDE_M)


class _Ground:
    """What both proofs ask about a cell."""

    def __init__(self, setting: Setting, claim: Claim) -> None:
        self.setting: Final = setting
        self.claim: Final = claim
        self.terrain: Final = setting.terrain
        self.boxes: Final[tuple[Edges, ...]] = tuple(
            (b.low_x_m, b.low_y_m, b.high_x_m, b.high_y_m) for b in setting.terrain.boxes
        )
        self.radius_m: Final = setting.terrain.body_radius_m
        self.two_tubes_m: Final = 2.0 * setting.tube_m

    def outside(self, cell: Cell) -> bool:
        """Whether no state of the cell belongs to the claim."""
        r, terrain = cell.radius_m, self.terrain
        fence_m, clear_m = terrain.fence_m(cell.x_m, cell.y_m), terrain.clearance_m(cell.x_m, cell.y_m)
        if fence_m + r < max(self.claim.fence_m, 0.0):
            return True
        return clear_m + r < max(self.claim.clearance_m, 0.0)

    def too_near(self, cell: Cell) -> str:
        """Return why two tubes do not fit everywhere in the claim's part of the cell, or an empty text."""
        r, terrain, needed = cell.radius_m, self.terrain, self.two_tubes_m
        least_m = max(terrain.clearance_m(cell.x_m, cell.y_m) - r, self.claim.clearance_m)
        if least_m < needed:
            return f"nearer to a box than two tubes, which are {needed:.3f} m"
        if max(terrain.fence_m(cell.x_m, cell.y_m) - r, self.claim.fence_m) < needed:
            return f"nearer to the fence than two tubes, which are {needed:.3f} m"
        return ""

    def in_sight(self, cell: Cell, place: Point, moves: float, needed_m: float) -> bool:
        """Whether from every state of the cell the way to a place keeps clear of boxes, or leads away from them.

        Args:
            cell: where ways begin.
            place: where that from the centre ends.
            moves: how far the end of the way, seen from its beginning, differs at most, in half-diagonals.
            needed_m: body clearance to be kept by ways that do not lead away.
        """
        r, x, y = cell.radius_m, cell.x_m, cell.y_m
        dx, dy = place[0] - x, place[1] - y
        length = math.hypot(dx, dy)
        for edges in self.boxes:
            if segment_to_box(x, y, *place, edges) - r - self.radius_m >= needed_m:
                continue
            # The vector from the box to the robot is 1-Lipschitz too (a projection onto a convex set).
            wx, wy = from_box(x, y, edges)
            away_m = math.hypot(wx, wy)
            if wx * dx + wy * dy < r * length + moves * r * (away_m + r):
                return False
        return True


class _Retreats(_Ground):
    """Judges cells for a safe controller that retreats to a refuge."""

    def __init__(self, setting: Setting, claim: Claim) -> None:
        super().__init__(setting, claim)
        refuges = setting.declared.refuges
        self.fence_m: Final = refuges.fence_m
        self.clearance_m: Final = refuges.clearance_m
        fits = np.flatnonzero(refuges.static)
        self._x: Final = setting.terrain.cell_x.ravel()[fits]
        self._y: Final = setting.terrain.cell_y.ravel()[fits]
        self._straight_m: Final = STEPS * STEP_M

    def judge(self, cell: Cell) -> Judged:
        """See `soter.check.cover`."""
        if self.outside(cell):
            return OUTSIDE
        if why := self.too_near(cell):
            return Judged(Status.UNKNOWN, 0.0, why)
        # Whatever refuge the finder takes, its way is one of (4), so it is enough that there always is one.
        length_m = self._straight_inside(cell)
        if length_m is None:
            length_m = self._to_a_cell(cell)
        if length_m is None:
            return Judged(Status.UNKNOWN, 0.0, "no refuge is in sight from all of this cell")
        return Judged(Status.PROVED, length_m)

    def _straight_inside(self, cell: Cell) -> float | None:
        """Return a bound on the way if the nearest point far enough inside the fence will do, else None."""
        inset, terrain, r = self.fence_m, self.terrain, cell.radius_m
        if not math.isfinite(inset):
            place = (cell.x_m, cell.y_m)
        else:
            place = (
                min(max(cell.x_m, inset), terrain.width_m - inset), min(max(cell.y_m, inset), terrain.depth_m - inset)
            )  # fmt: skip
        # Clamping moves no two points apart, so that from elsewhere in the cell the place is as near to this one.
        if terrain.clearance_m(*place) - r < self.clearance_m or not self.in_sight(cell, place, 2.0, self.clearance_m):
            return None
        return math.dist(place, (cell.x_m, cell.y_m)) + 2.0 * r + PIVOT_M

    def _to_a_cell(self, cell: Cell) -> float | None:
        """Return a bound on the way if one of the finder's own cells is in sight of all of this one, else None."""
        r = cell.radius_m
        away = np.hypot(self._x - cell.x_m, self._y - cell.y_m)
        order = np.argsort(away, kind="stable")
        # The finder looks at so many cells, the nearest first, within a window that is counted in whole cells.
        far_m = LOOK_M[0] - cell.half_m - 2.0 * CELL_M
        for rank in order[:TRIED]:
            place = (float(self._x[rank]), float(self._y[rank]))
            if max(abs(place[0] - cell.x_m), abs(place[1] - cell.y_m)) > far_m:
                continue
            if int((away <= away[rank] + 2.0 * r).sum()) > TRIED:
                break
            if self.in_sight(cell, place, 1.0, self.clearance_m):
                return max(float(away[rank]) + r, self.fence_m + PIVOT_M, self._straight_m)
        return None


class _WaysHome(_Ground):
    """Judges cells for a safe controller that drives the shortest way home."""

    def __init__(self, setting: Setting, claim: Claim) -> None:
        super().__init__(setting, claim)
        routes = setting.declared.dock.routes
        self._corners: Final = routes.corners
        self._to_go_m: Final = routes.to_go_m.tolist()
        self._rectangles: Final = routes.roadmap.rectangles
        obstacle = setting.module(OBSTACLE)
        # Nearer than this the obstacle module would step in on the way.
        trigger_m = 0.0
        if obstacle is not None and obstacle.model is not None:
            trigger_m = obstacle.model.bound(_look_s(obstacle, setting.declared.timing))
        self._needed_m: Final = max(trigger_m + setting.tube_m, self.two_tubes_m)

    def judge(self, cell: Cell) -> Judged:
        """See `soter.check.cover`."""
        if self.outside(cell):
            return OUTSIDE
        if why := self.too_near(cell):
            return Judged(Status.UNKNOWN, 0.0, why)
        r, here = cell.radius_m, (cell.x_m, cell.y_m)
        ways = [
            (math.dist(here, corner) + to_go_m, corner)
            for corner, to_go_m in zip(self._corners, self._to_go_m, strict=True)
            if math.isfinite(to_go_m)
        ]
        ways.sort()
        best_m = next((length_m for length_m, corner in ways if self._surely_sees(cell, corner)), math.inf) + r
        if not math.isfinite(best_m):
            return Judged(Status.UNKNOWN, 0.0, "no corner of a way home is in sight from all of this cell")
        # From outside a grown box ways keep out of it, and from inside they lead no deeper: unless the cell is deep
        # inside one, whichever way is taken keeps clear. Else every way that might be taken is looked at.
        deep = any(_chebyshev_m(*here, edges) - r - self.radius_m < self._needed_m for edges in self.boxes)
        if deep:
            for length_m, corner in ways:
                if length_m - r > best_m:
                    break
                if not self.in_sight(cell, corner, 1.0, self._needed_m):
                    return Judged(Status.UNKNOWN, 0.0, "a way home that may be taken leads too near to a box")
        return Judged(Status.PROVED, best_m)

    def _surely_sees(self, cell: Cell, corner: Point) -> bool:
        """Whether the roadmap shows the way to a corner from every state of the cell."""
        return all(self._passes(cell, corner, rectangle) for rectangle in self._rectangles)

    def _passes(self, cell: Cell, corner: Point, rectangle: Edges) -> bool:
        low_x, low_y, high_x, high_y = rectangle
        r, half, (x, y) = cell.radius_m, cell.half_m, corner
        if segment_to_box(cell.x_m, cell.y_m, x, y, rectangle) > r:
            return True
        # Inwards of each side: how far the cell's outermost and innermost points are, and whether the corner is beyond.
        sides = (
            (cell.x_m - low_x, x <= low_x), (high_x - cell.x_m, x >= high_x),
            (cell.y_m - low_y, y <= low_y), (high_y - cell.y_m, y >= high_y),
        )  # fmt: skip
        if any(beyond and inwards + half <= 0.0 for inwards, beyond in sides):
            return True
        # From inside, a way counts as seen if it gets no deeper than it begins: so it does if it leads out by the
        # nearest side, or by two sides that are both nearer than the others.
        out = [inwards for inwards, beyond in sides if beyond]
        others = [inwards for inwards, beyond in sides if not beyond]
        return bool(out) and min(out) + half <= min(others) - half


def from_box(x: float, y: float, edges: Edges) -> Point:
    """Return the vector from the nearest point of a box to a point; zero inside."""
    low_x, low_y, high_x, high_y = edges
    return x - min(max(x, low_x), high_x), y - min(max(y, low_y), high_y)


def _chebyshev_m(x: float, y: float, edges: Edges) -> float:
    low_x, low_y, high_x, high_y = edges
    return max(low_x - x, x - high_x, low_y - y, y - high_y)
