"""What all safe controllers share: they publish certified legs, or a hold, on the topic `waypoint`."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Final

from soter.rta import Node, Sample, Situation, Topic
from soter.sdk import Waypoint
from soter.stack.recovery import RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.terrain import Point

WAYPOINT: Final = "waypoint"
_CORNER_M: Final = 0.03
LOOK_AGAIN_S: Final = 1.0
"""A robot at rest that is not where it was going looks for another refuge so often."""


STUCK_S: Final = 10.0
"""A robot that has stood on its way to a refuge for so long does not get there: a peer is in the way for good."""


class SafeController(Node):
    """A node that drives by certified legs only.

    Args:
        name: for recordings.
        period_s: how often it looks (T_sc).
        waypoint: where it publishes; None published means: brake and hold.
        recovery: makes and certifies its legs.
    """

    publishes = (WAYPOINT,)
    subscribes = ("state", "peers")

    def __init__(self, name: str, period_s: float, waypoint: Topic[Waypoint], recovery: RecoveryPlanner) -> None:
        self.name = name
        self.period_s = period_s
        self.recovery: Final = recovery
        self._waypoint: Final = waypoint
        self._holding = False

    def engage(self, situation: Situation) -> None:
        self._holding = False

    def step(self, situation: Situation) -> None:
        leg = self.motion(situation)
        if leg is not None:
            self._holding = False
            self._waypoint.publish(leg)
        elif not self._holding:
            self._holding = True
            self._waypoint.publish(None)

    @abstractmethod
    def motion(self, situation: Situation) -> Waypoint | None:
        """Return the next certified leg, or None to hold."""

    def follow(self, situation: Situation, legs: list[Point]) -> Waypoint | None:
        """Go along a way; corners that are passed are taken off it."""
        own = situation.own
        while len(legs) > 1 and math.hypot(legs[0][0] - own.x_m, legs[0][1] - own.y_m) < _CORNER_M:
            legs.pop(0)
        return self.recovery.towards(situation, legs) if legs else None


class Retreat(SafeController):
    """Moves to the nearest refuge and waits there; looks for another when a peer comes near it.

    Args:
        name: for recordings.
        period_s: how often it looks.
        waypoint: where it publishes.
        recovery: makes and certifies its legs.
        refuges: finds where to go.
        peer_m: distance from every peer that a refuge has at least.
    """

    def __init__(
        self,
        name: str,
        period_s: float,
        waypoint: Topic[Waypoint],
        recovery: RecoveryPlanner,
        refuges: RefugeFinder,
        peer_m: float,
    ) -> None:
        super().__init__(name, period_s, waypoint, recovery)
        self._refuges: Final = refuges
        self._peer_m: Final = peer_m
        self._legs: list[Point] = []
        self._looked_s = -math.inf
        # Whoever drives at the start of a run was never told to take charge.
        self._moved_s = math.inf

    def engage(self, situation: Situation) -> None:
        super().engage(situation)
        self._legs = []
        self._looked_s = -math.inf
        self._moved_s = situation.now_s

    def motion(self, situation: Situation) -> Waypoint | None:
        if situation.now_s - self._looked_s >= LOOK_AGAIN_S and not self._settled(situation):
            self._looked_s = situation.now_s
            self._legs = self._refuges.way(situation, self._peer_m)
        if self._stuck(situation):
            # Until it looks again, it gets away from whatever is in the way; from elsewhere the way is another one.
            self._legs = []
            self._looked_s = self._moved_s = situation.now_s
        return self.follow(situation, self._legs) if self._legs else self.without_refuge(situation)

    def without_refuge(self, situation: Situation) -> Waypoint | None:
        """Return what to do where no refuge is in reach: get away from fence and boxes as far as that goes."""
        return self.recovery.climb(situation)

    def _stuck(self, situation: Situation) -> bool:
        """Whether the robot has been on its way for long without moving: its legs are not certified."""
        own = situation.own
        there = bool(self._legs) and math.dist(self._legs[-1], (own.x_m, own.y_m)) < _CORNER_M
        if there or not self._legs or _moving(own) or math.isinf(self._moved_s):
            self._moved_s = situation.now_s
        return situation.now_s - self._moved_s > STUCK_S

    def _settled(self, situation: Situation) -> bool:
        """Whether the way is still good: it leads somewhere, no peer is near its end, and the robot gets along it."""
        if not self._legs or not self._refuges.good(situation, self._legs[-1], self._peer_m):
            return False
        own = situation.own
        return _moving(own) or math.hypot(self._legs[-1][0] - own.x_m, self._legs[-1][1] - own.y_m) < _CORNER_M


def _moving(own: Sample) -> bool:
    return own.vx_m_s * own.vx_m_s + own.vy_m_s * own.vy_m_s > 1e-4
