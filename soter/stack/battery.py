"""Battery: the charge always pays for the way home, with a reserve held back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from soter.errors import IllFormedModule
from soter.rta import Region, Situation, Topic
from soter.sdk import Waypoint
from soter.stack.recovery import RecoveryPlanner
from soter.stack.right_of_way import BATTERY
from soter.stack.routes import Rectangle, Routes
from soter.stack.safe_controller import SafeController
from soter.stack.terrain import Point, Terrain
from soter.workspace import Box

COMFORT: Final = 0.05
"""With so much charge to spare beyond the longest way home, the margin is not computed more exactly than that."""

BLOCKED_S: Final = 15.0
PROGRESS_M: Final = 0.1
DETOUR_M: Final = 0.5
"""Half-width of what a detour keeps out of around a peer: the trigger distance plus the tracking error."""

_DOCKED_M: Final = 0.03
_SAME_PLACE_M: Final = 1e-4


class Dock:
    """One robot's charging station, the ways to it, and what they cost.

    Args:
        terrain: what does not move.
        charger: the station.
        clearance_m: body clearance from boxes that ways home keep.
        inset_m: distance from the fence that ways home keep.
        cost_per_m: charge that a metre of the way home is accounted for.

    Attributes:
        place: the middle of the station.
        routes: the ways.
        longest_m: length of the longest way home.
    """

    def __init__(self, terrain: Terrain, charger: Box, clearance_m: float, inset_m: float, cost_per_m: float) -> None:
        self.place: Final = charger.centre
        self.cost_per_m: Final = cost_per_m
        self._terrain: Final = terrain
        self._charger: Final = charger
        self._clearance_m: Final = clearance_m
        self._inset_m: Final = inset_m
        self.routes: Final = Routes(terrain, self.place, clearance_m, inset_m)
        self.longest_m: Final = self.routes.longest_m()
        self._asked: Point = (math.inf, math.inf)
        self._answer_m = math.inf
        self.wants_charge = False
        """Set by the battery's safe controller while it is in charge or wants to be."""

    def home_m(self, x_m: float, y_m: float) -> float:
        """Return the length of the way home from a point; the longest of all where none is seen from there."""
        ax, ay = self._asked
        if abs(ax - x_m) > _SAME_PLACE_M or abs(ay - y_m) > _SAME_PLACE_M:
            self._asked = (x_m, y_m)
            found_m = self.routes.distance_m(x_m, y_m)
            self._answer_m = self.longest_m if found_m == math.inf else found_m
        return self._answer_m

    def check_way_from(self, x_m: float, y_m: float) -> None:
        """Check that there is a way home from a point.

        Raises:
            IllFormedModule: there is none, so that no safe controller could bring the robot to its charger.
        """
        if self.routes.distance_m(x_m, y_m) == math.inf:
            gap_m = 2.0 * (self._terrain.body_radius_m + self._clearance_m)
            raise IllFormedModule(
                BATTERY,
                "P2b",
                f"there is no way from ({x_m:g}, {y_m:g}), where the robot starts, to the middle of its charging "
                f"station at ({self.place[0]:g}, {self.place[1]:g}) that keeps {self._clearance_m:.3g} m from all "
                f"boxes and {max(self._inset_m, 0.0):.3g} m from the fence; gaps of {gap_m:.3g} m between boxes, or "
                "a start and a station on the same side of them, would do",
            )

    def way(self, x_m: float, y_m: float) -> list[Point]:
        """Return the legs of the static way home; straight home where none is seen, as far as that is certified."""
        return self.routes.legs(x_m, y_m) or [self.place]

    def detour(self, x_m: float, y_m: float, peers: list[Point]) -> list[Point]:
        """Return the legs of a way home around peers as they stand now; empty if there is none."""
        discs: list[Rectangle] = [
            (px - DETOUR_M, py - DETOUR_M, px + DETOUR_M, py + DETOUR_M)
            for px, py in peers
            if math.hypot(px - self.place[0], py - self.place[1]) > DETOUR_M
        ]
        return Routes(self._terrain, self.place, self._clearance_m, self._inset_m, discs).legs(x_m, y_m)

    def docked(self, situation: Situation) -> bool:
        """Return whether the robot's centre is on the station."""
        own = situation.own
        return self._charger.distance_m(own.x_m, own.y_m) <= 0.0

    def charging(self, situation: Situation) -> bool:
        """Return whether the robot stands on the station because it has to charge."""
        return self.wants_charge and self.docked(situation)


@dataclass(frozen=True)
class ChargeForTheWayHome(Region):
    """Situations in which the charge, less the cost of the way home, less the reserve, is not negative.

    It does not fall while the robot drives home: what is used up, the way gets shorter by.

    Attributes:
        dock: knows the way home.
        reserve: charge from 0 to 1 that is held back, for blocked ways and for waiting.
    """

    dock: Dock
    reserve: float
    unit = "of a charge"

    def margin(self, situation: Situation) -> float:
        own = situation.own
        if own.battery is None:
            return math.nan
        dock = self.dock
        spare = own.battery - self.reserve
        at_least = spare - dock.longest_m * dock.cost_per_m
        if at_least >= COMFORT:
            # The longest way home is paid for with a lot to spare: how long it is from here does not matter yet.
            return at_least
        return spare - dock.home_m(own.x_m, own.y_m) * dock.cost_per_m

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Charged):
            raise TypeError(f"phi_safer of a charge is Charged, not {type(safer).__name__}")
        return safer.least - self.dock.longest_m * self.dock.cost_per_m - self.reserve

    def noise(self, noise_m: float) -> float:
        return noise_m * self.dock.cost_per_m


@dataclass(frozen=True)
class Charged(Region):
    """Situations in which the charge is at least `least`, from 0 to 1."""

    least: float
    unit = "of a charge"

    def margin(self, situation: Situation) -> float:
        charge = situation.own.battery
        return math.nan if charge is None else charge - self.least

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Charged):
            raise TypeError(f"phi_safer of Charged is Charged, not {type(safer).__name__}")
        return safer.least - self.least

    def noise(self, noise_m: float) -> float:
        return 0.0


class GoHome(SafeController):
    """Drives the static way to the charger and holds there.

    The static way is kept even when peers stand in it: dodging them dithers until the battery is flat. Only after
    `BLOCKED_S` without progress does it commit to one detour around the peers as they stand then.

    Args:
        period_s: how often it looks.
        waypoint: where it publishes.
        recovery: makes and certifies its legs.
        dock: where to go.
    """

    def __init__(self, period_s: float, waypoint: Topic[Waypoint], recovery: RecoveryPlanner, dock: Dock) -> None:
        super().__init__("go-home", period_s, waypoint, recovery)
        self._dock: Final = dock
        self._legs: list[Point] = []
        self._detouring = False
        self._mark: Point = (math.inf, math.inf)
        self._mark_s = 0.0

    def engage(self, situation: Situation) -> None:
        super().engage(situation)
        if not self._detouring:
            own = situation.own
            self._legs = self._dock.way(own.x_m, own.y_m)

    def motion(self, situation: Situation) -> Waypoint | None:
        own = situation.own
        x, y = own.x_m, own.y_m
        if math.hypot(self._dock.place[0] - x, self._dock.place[1] - y) < _DOCKED_M:
            self._detouring = False
            return self.recovery.hold(situation)
        if math.hypot(self._mark[0] - x, self._mark[1] - y) > PROGRESS_M:
            self._mark, self._mark_s = (x, y), situation.now_s
        elif situation.now_s - self._mark_s > BLOCKED_S:
            self._mark_s = situation.now_s
            peers = [(peer.x_m, peer.y_m) for peer in situation.peers]
            self._legs = self._dock.detour(x, y, peers)
            self._detouring = bool(self._legs)
        if not self._legs:
            self._legs = self._dock.way(x, y)
        return self.follow(situation, self._legs)
