"""The safe controller of geofence and obstacle: goes to the nearest safe position, or home if there is none."""

from __future__ import annotations

import math
from typing import Final

from soter.rta import Situation, Topic
from soter.sdk import Waypoint
from soter.stack.battery import Dock, GoHome
from soter.stack.recovery import Leg, RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.right_of_way import Path
from soter.stack.safe_controller import AT_CORNER_M, SafeController
from soter.stack.terrain import Point

LOOK_AGAIN_S: Final = 1.0
"""How often a robot at rest, not yet at its refuge, looks for another one."""

STUCK_S: Final = 10.0
"""A robot that has stood on its way to a refuge for this long will not get there: a peer is in the way for good."""

TURNS: Final = 1.5
"""A robot at rest has this many times the duration of its longest turn in place to turn to its next leg."""

PATIENT_S: Final = 2.0
"""How long a robot without a certified leg stands on its return path before it first gets out of the way."""

ASIDE_S: Final = 15.0
"""After this long at the latest it is back on its path."""


class Retreat(SafeController):
    """Moves to the nearest refuge and waits there; looks for another when a peer comes near it.

    In two cases it drives the return path instead, so that no rule of lower priority is starved: while the battery's
    module is in SC, along every leg that keeps all rules; and if no refuge is in reach and its own margin cannot be
    made larger, until one is.

    Attributes:
        leave: a path that a refuge must not lie on; None if there is none.
        aside: whether any place where the robot can stand is a refuge, because others need room.
    """

    def __init__(
        self,
        name: str,
        period_s: float,
        waypoint: Topic[Waypoint],
        recovery: RecoveryPlanner,
        refuges: RefugeFinder,
        peer_m: float,
        home: GoHome,
        dock: Dock,
    ) -> None:
        super().__init__(name, period_s, waypoint, recovery)
        self._refuges: Final = refuges
        self._peer_m: Final = peer_m
        self._home: Final = home
        self._dock: Final = dock
        self.leave: Path | None = None
        self.aside = False
        self._legs: list[Point] = []
        self._turn_s: Final = TURNS * recovery.turn_s
        self._looked_s, self._pause_s = -math.inf, LOOK_AGAIN_S
        # The first driver of a run is never engaged by a switch.
        self._moved_s = math.inf
        self._homewards = False
        self._drove_home_s = self._aside_until_s = -math.inf

    def engage(self, situation: Situation) -> None:
        super().engage(situation)
        self._legs = []
        self._looked_s = -math.inf
        self._moved_s = situation.now_s
        self._homewards = False
        self._drove_home_s, self._aside_until_s = situation.now_s, -math.inf
        self._home.start_anew()

    def motion(self, situation: Situation) -> Leg | None:
        if not self._dock.wants_charge or (situation.now_s < self._aside_until_s and self.blocked(situation)):
            return self.retreat(situation)
        leg = self._leg_home(situation)
        if leg is not None or self.recovery.moves(situation.own) or self._dock.docked(situation):
            self._drove_home_s = situation.now_s
        elif situation.now_s - self._drove_home_s > self.patience_s(situation):
            self._aside_until_s = situation.now_s + max(ASIDE_S, 2.0 * self._turn_s)
            self._legs = []
            self._looked_s = -math.inf
        return leg

    def patience_s(self, situation: Situation) -> float:
        """Return how long the robot stands on its return path before it gets out of the way of what blocks it."""
        return PATIENT_S

    def blocked(self, situation: Situation) -> bool:
        """Return whether what has blocked the return path is likely to be there still."""
        return True

    def retreat(self, situation: Situation) -> Leg | None:
        """Return the next certified leg to a refuge."""
        # All safe controllers of a robot share the finder.
        self._refuges.leave, self._refuges.aside = self.leave, self.aside
        if situation.now_s - self._looked_s >= self._pause_s and not self._settled(situation):
            self._looked_s, self._pause_s = situation.now_s, LOOK_AGAIN_S
            self._legs = self.way(situation)
        if self._stuck(situation):
            # Until it looks again, get away from whatever is in the way: another place has another path.
            self._legs, self._pause_s = [], max(LOOK_AGAIN_S, self._turn_s)
            self._looked_s = self._moved_s = situation.now_s
        if self._legs:
            self._homewards = False
            return self.follow(situation, self._legs)
        if self._homewards:
            leg = self._leg_home(situation)
            if leg is not None or self.recovery.moves(situation.own):
                self._drove_home_s = situation.now_s
            if situation.now_s - self._drove_home_s <= self.patience_s(situation):
                return leg
            # The return path is blocked: get away from whatever is in the way, and back on the path from elsewhere.
            self._homewards = False
        leg = self.without_refuge(situation)
        return leg if leg is not None or self.recovery.moves(situation.own) else self._leg_home(situation)

    def way(self, situation: Situation) -> list[Point]:
        """Return the path to a refuge far from peers; if there is none, to one just far enough to pass them."""
        refuges = self._refuges
        return refuges.way(situation, self._peer_m) or refuges.way(situation, self.recovery.apart_m(situation.age_s))

    def without_refuge(self, situation: Situation) -> Leg | None:
        """Return the next leg if no refuge is in reach: as far away from fence and boxes as possible."""
        return self.recovery.climb(situation)

    def _leg_home(self, situation: Situation) -> Leg | None:
        if not self._homewards:
            self._homewards = True
            self._drove_home_s = situation.now_s
            self._home.start_anew()
        return self._home.leg_home(situation)

    def _stuck(self, situation: Situation) -> bool:
        """Return whether the robot has been on its way for long without moving, since no leg is certified."""
        own = situation.own
        there = bool(self._legs) and math.dist(self._legs[-1], (own.x_m, own.y_m)) < AT_CORNER_M
        if there or not self._legs or self.recovery.moves(own) or math.isinf(self._moved_s):
            self._moved_s = situation.now_s
        return situation.now_s - self._moved_s > max(STUCK_S, self._turn_s)

    def _settled(self, situation: Situation) -> bool:
        """Return whether the path is still good: not empty, with no peer near its end, and the robot gets along it."""
        if not self._legs or not self._refuges.good(situation, self._legs[-1], self._peer_m):
            return False
        own = situation.own
        # From another heading it may find another refuge, turn to that, and so on for ever.
        return (
            situation.now_s - self._looked_s < self._turn_s
            or self.recovery.moves(own)
            or math.hypot(self._legs[-1][0] - own.x_m, self._legs[-1][1] - own.y_m) < AT_CORNER_M
        )
