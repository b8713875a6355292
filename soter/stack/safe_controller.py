"""The base of all safe controllers: they publish certified legs, or a hold, on the topic `waypoint`."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Final

from soter.rta import Node, Situation, Topic
from soter.sdk import Waypoint
from soter.stack.recovery import CORNER_M, Leg, RecoveryPlanner
from soter.stack.terrain import Point

WAYPOINT: Final = "waypoint"
AT_CORNER_M: Final = 0.03
"""A robot this near to a corner goes on to the next one as soon as the straight line there is free."""


class SafeController(Node):
    """A node that drives by certified legs only: it chooses among those that the recovery planner makes.

    Args:
        name: its name in recordings.
        period_s: how often it looks (T_sc).
        waypoint: topic on which it publishes; publishing None means brake and hold.
        recovery: makes and certifies its legs.

    Attributes:
        waypoint: the topic; the declaration of its module sets it to the robot's.
    """

    publishes = (WAYPOINT,)
    subscribes = ("state", "peers")

    def __init__(self, name: str, period_s: float, waypoint: Topic[Waypoint], recovery: RecoveryPlanner) -> None:
        self.name = name
        self.period_s = period_s
        self.recovery: Final = recovery
        self.waypoint = waypoint
        self._holding = False

    def engage(self, situation: Situation) -> None:
        self._holding = False

    def step(self, situation: Situation) -> None:
        leg = self.motion(situation)
        if leg is not None:
            if not isinstance(leg, Leg):
                raise TypeError(
                    f"the safe controller '{self.name}' chose a {type(leg).__name__}, which is no certified leg"
                )
            self._holding = False
            self.waypoint.publish(Waypoint(*leg))
        elif not self._holding:
            self._holding = True
            self.waypoint.publish(None)

    @abstractmethod
    def motion(self, situation: Situation) -> Leg | None:
        """Return the next certified leg, or None to hold."""

    def follow(self, situation: Situation, legs: list[Point]) -> Leg | None:
        """Return the next leg along a path, and remove the corners that are passed from the path."""
        x, y = situation.own.x_m, situation.own.y_m
        while len(legs) > 1:
            away_m = math.hypot(legs[0][0] - x, legs[0][1] - y)
            if away_m >= AT_CORNER_M or (away_m >= CORNER_M and not self.recovery.free(x, y, *legs[1])):
                break
            legs.pop(0)
        return self.recovery.towards(situation, legs) if legs else None
