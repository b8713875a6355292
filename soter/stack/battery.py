"""Battery: the charge always pays for the return path, with a reserve held back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from soter.geometry.workspace import Box
from soter.rta import Region, Situation, Topic
from soter.sdk import Waypoint
from soter.stack.recovery import Leg, RecoveryPlanner
from soter.stack.return_path import DETOUR_M, ReturnPath
from soter.stack.safe_controller import SafeController
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, length_m

BLOCKED_S: Final = 15.0
PROGRESS_M: Final = 0.1
ASTRAY_M: Final = 1.0
"""A robot that has been driven so much farther from its station begins its way anew."""

DOCKED_M: Final = 0.03
"""A robot this near to the middle of its station has arrived."""


class Dock:
    """One robot's charging station, the path to it, and the charge that the path costs."""

    def __init__(self, charger: Box, path: ReturnPath, cost_per_m: float) -> None:
        self.place: Final = charger.centre
        self.path = path
        self.cost_per_m: Final = cost_per_m
        self._charger: Final = charger
        self.wants_charge = False
        """Set by the arbiter while the battery's module is in SC because it has fired or is not in phi_safer yet."""
        self.begins = False
        """Set by the arbiter while that module is in SC only because all modules begin so: the robot stays put."""

    @property
    def longest_m(self) -> float:
        """Length of the longest path that the roadmaps show."""
        return self.path.longest_m

    def docked(self, situation: Situation) -> bool:
        """Return whether the robot's centre is on the station."""
        own = situation.own
        return self._charger.distance_m(own.x_m, own.y_m) <= 0.0

    def charging(self, situation: Situation) -> bool:
        """Return whether the robot stands on the station because it has to charge."""
        return self.wants_charge and self.docked(situation)


@dataclass(frozen=True)
class ChargeForTheWayHome(Region):
    """Situations in which the charge, less the cost of the return path, is not negative.

    The margin does not fall while the robot drives home, since the path gets shorter by what the charge pays for. It is
    minus infinity without a path. The module's `keep` holds back charge for turns, blocked paths and waiting.
    """

    dock: Dock
    unit = "of a charge"

    def margin(self, situation: Situation) -> float:
        own = situation.own
        if own.battery is None:
            return math.nan
        dock = self.dock
        return own.battery - dock.path.length_m(own.x_m, own.y_m) * dock.cost_per_m

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Charged):
            raise TypeError(f"phi_safer of a charge is Charged, not {type(safer).__name__}")
        return safer.least - (self.dock.longest_m + DETOUR_M) * self.dock.cost_per_m

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
    """Drives the return path to the charger and holds there.

    It keeps to the path even when peers stand in it: dodging them would dither until the battery is flat. Only after
    `BLOCKED_S` without progress does it commit to one detour around the peers as they stand then.
    """

    def __init__(self, period_s: float, waypoint: Topic[Waypoint], recovery: RecoveryPlanner, dock: Dock) -> None:
        super().__init__("go-home", period_s, waypoint, recovery)
        self._dock: Final = dock
        self._legs: list[Point] = []
        self._detouring = False
        self._to_go_m = math.inf
        self._progress_s = self._asked_s = -math.inf

    def engage(self, situation: Situation) -> None:
        super().engage(situation)
        self.start_anew()

    def start_anew(self) -> None:
        """Find the path again, after another controller has driven the robot elsewhere."""
        if not self._detouring:
            self._legs = []

    def motion(self, situation: Situation) -> Leg | None:
        return self.recovery.hold(situation) if self._dock.begins else self.leg_home(situation)

    def leg_home(self, situation: Situation) -> Leg | None:
        """Return the next certified leg of the return path, or None to hold; any safe controller may ask for it."""
        own = situation.own
        x, y = own.x_m, own.y_m
        if math.hypot(self._dock.place[0] - x, self._dock.place[1] - y) < DOCKED_M:
            self._detouring = False
            return self.recovery.hold(situation)
        if not self._legs:
            self._legs = self._dock.path.legs(x, y)
        if self._blocked(situation.now_s, length_m([(x, y), *self._legs])):
            around = self._dock.path.around(x, y, self._discs(situation))
            self._detouring, self._to_go_m = bool(around), math.inf
            self._legs = around or self._dock.path.legs(x, y)
        return self.follow(situation, self._legs)

    def _blocked(self, now_s: float, to_go_m: float) -> bool:
        """Return whether the robot has not got nearer to its station for a while, even if it moves to and fro."""
        paused = now_s - self._asked_s > BLOCKED_S
        self._asked_s = now_s
        if paused or to_go_m < self._to_go_m - PROGRESS_M or to_go_m > self._to_go_m + ASTRAY_M:
            self._to_go_m, self._progress_s = to_go_m, now_s
        if now_s - self._progress_s <= BLOCKED_S:
            return False
        self._progress_s = now_s
        return True

    def _discs(self, situation: Situation) -> list[Rectangle]:
        """Return the room of every peer, which a detour keeps out of, except that of peers at the station itself."""
        apart_m = self.recovery.apart_m(situation.age_s)
        return [
            (peer.x_m - apart_m, peer.y_m - apart_m, peer.x_m + apart_m, peer.y_m + apart_m)
            for peer in situation.peers
            if math.dist((peer.x_m, peer.y_m), self._dock.place) > apart_m
        ]
