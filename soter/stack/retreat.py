"""The safe controller of geofence and obstacle: to the nearest safe position, or home where there is none."""

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
"""A robot at rest that is not where it was going looks for another refuge so often."""

STUCK_S: Final = 10.0
"""A robot that has stood on its way to a refuge for so long does not get there: a peer is in the way for good."""

TURNS: Final = 1.5
"""A robot at rest may be turning to its next leg for so many times as long as a turn takes at most."""

PATIENT_S: Final = 2.0
"""A robot that has stood on its return path for so long, no leg of which is certified, gets out of the way first."""

ASIDE_S: Final = 15.0
"""It is back on its path after so long at the latest."""


class Retreat(SafeController):
    """Moves to the nearest refuge and waits there; looks for another when a peer comes near it.

    It lets go of the actuator in two ways, so that no rule that stands behind its own is starved. While the battery's
    module is in SC, every leg of the return path that keeps all rules is driven. And where no refuge is in reach and
    its own margin cannot be made larger, the return path leads to where there is one.

    Attributes:
        leave: a path that a refuge must not lie on; None if there is none.
        aside: others need room: a refuge is anywhere where the robot can stand.
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
        self._looked_s = -math.inf
        # Whoever drives at the start of a run was never told to take charge.
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
            self._aside_until_s = situation.now_s + ASIDE_S
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
        if situation.now_s - self._looked_s >= LOOK_AGAIN_S and not self._settled(situation):
            self._looked_s = situation.now_s
            self._legs = self.way(situation)
        if self._stuck(situation):
            # Until it looks again, it gets away from whatever is in the way; from elsewhere the way is another one.
            self._legs = []
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
            # Nothing leads on along the return path: away from whatever is in the way, and back on it from elsewhere.
            self._homewards = False
        leg = self.without_refuge(situation)
        return leg if leg is not None or self.recovery.moves(situation.own) else self._leg_home(situation)

    def way(self, situation: Situation) -> list[Point]:
        """Return the way to a refuge: where peers leave none that is far from them, to one where they can be passed."""
        refuges = self._refuges
        return refuges.way(situation, self._peer_m) or refuges.way(situation, self.recovery.apart_m(situation.age_s))

    def without_refuge(self, situation: Situation) -> Leg | None:
        """Return what to do where no refuge is in reach: get away from fence and boxes as far as that goes."""
        return self.recovery.climb(situation)

    def _leg_home(self, situation: Situation) -> Leg | None:
        if not self._homewards:
            self._homewards = True
            self._drove_home_s = situation.now_s
            self._home.start_anew()
        return self._home.leg_home(situation)

    def _stuck(self, situation: Situation) -> bool:
        """Whether the robot has been on its way for long without moving: its legs are not certified."""
        own = situation.own
        there = bool(self._legs) and math.dist(self._legs[-1], (own.x_m, own.y_m)) < AT_CORNER_M
        if there or not self._legs or self.recovery.moves(own) or math.isinf(self._moved_s):
            self._moved_s = situation.now_s
        return situation.now_s - self._moved_s > max(STUCK_S, TURNS * self.recovery.turn_s)

    def _settled(self, situation: Situation) -> bool:
        """Whether the way is still good: it leads somewhere, no peer is near its end, and the robot gets along it."""
        if not self._legs or not self._refuges.good(situation, self._legs[-1], self._peer_m):
            return False
        own, recovery = situation.own, self.recovery
        # From another heading it may find another refuge, turn to that, and so on for ever.
        return (
            situation.now_s - self._looked_s < TURNS * recovery.turn_s
            or recovery.moves(own)
            or math.hypot(self._legs[-1][0] - own.x_m, self._legs[-1][1] - own.y_m) < AT_CORNER_M
        )
