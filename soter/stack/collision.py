"""Collision: the centres of robots stay apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from soter.rta import Region, Situation, Topic
from soter.sdk import Waypoint
from soter.stack.battery import Dock
from soter.stack.recovery import RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.right_of_way import RightOfWay
from soter.stack.safe_controller import Retreat

PEER_STALE_S: Final = 0.5
"""A peer not heard of for longer makes the margin minus infinity: nobody knows where it is."""

RETREAT_M: Final = 0.75


@dataclass(frozen=True)
class Separation(Region):
    """Situations in which every peer is at least `least_m` away, centre to centre.

    A peer's sample that is older than this robot's own is made up for at the peer's top speed.

    Attributes:
        least_m: distance at the edge of the region.
        peer_v_max_m_s: top speed that peers are assumed to respect.
        peer_noise_m: error of the positions that peers report, at most.
    """

    least_m: float
    peer_v_max_m_s: float
    peer_noise_m: float = 0.0

    def margin(self, situation: Situation) -> float:
        own = situation.own
        x, y, stamp_s = own.x_m, own.y_m, own.stamp_s
        nearest = math.inf
        for peer in situation.peers:
            dx, dy = peer.x_m - x, peer.y_m - y
            distance = math.sqrt(dx * dx + dy * dy)
            if peer.stamp_s < stamp_s:
                if situation.now_s - peer.stamp_s > PEER_STALE_S:
                    return -math.inf
                distance -= self.peer_v_max_m_s * (stamp_s - peer.stamp_s)
            if distance < nearest:
                nearest = distance
        return nearest - self.least_m

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Separation):
            raise TypeError(f"phi_safer of a separation is a separation, not {type(safer).__name__}")
        return safer.least_m - self.least_m

    def noise(self, noise_m: float) -> float:
        return noise_m + self.peer_noise_m


class BackAway(Retreat):
    """The first in the order holds, so that the others know where it is; the others retreat; a docked robot holds.

    Args:
        period_s: how often it looks.
        waypoint: where it publishes.
        recovery: makes and certifies its legs.
        refuges: finds where to go.
        right_of_way: who is first.
        dock: where this robot charges.
    """

    def __init__(
        self,
        period_s: float,
        waypoint: Topic[Waypoint],
        recovery: RecoveryPlanner,
        refuges: RefugeFinder,
        right_of_way: RightOfWay,
        dock: Dock,
    ) -> None:
        super().__init__("back-away", period_s, waypoint, recovery, refuges, RETREAT_M)
        self._right_of_way: Final = right_of_way
        self._dock: Final = dock

    def motion(self, situation: Situation) -> Waypoint | None:
        stays = self._right_of_way.first(situation.robot_id) or self._dock.charging(situation)
        if stays:
            return self.recovery.hold(situation)
        return super().motion(situation)

    def without_refuge(self, situation: Situation) -> Waypoint | None:
        own = situation.own
        nearest = min(situation.peers, key=lambda p: (p.x_m - own.x_m) ** 2 + (p.y_m - own.y_m) ** 2, default=None)
        if nearest is None:
            return super().without_refuge(situation)
        return self.recovery.away(situation, own.x_m - nearest.x_m, own.y_m - nearest.y_m)
