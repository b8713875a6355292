"""How far a margin can fall, by how far robots get in the very directions in which it falls."""

from __future__ import annotations

from typing import Final

from soter.rta.models.base import Directed, Motion, ReachModel
from soter.rta.situation import Sample, Situation


class DirectedReach(ReachModel):
    """R(T) of a region's margin from the reach tube of a robot, and of its peers where the margin is one to them.

    A part of the margin that is m now is never less than m - h(u) - h'(-u) within T, where h and h' are the extents
    of both tubes and u is the direction in which it falls. The margin is the least of its parts, so it falls by no
    more than the largest of margin - m + h(u) + h'(-u). A part that is more than `bound` above the margin cannot
    become the least, and is not looked at.

    Args:
        region: whose margin it is.
        own: this robot's motion.
        other: the motion of every peer, for a region whose threats name peers.
    """

    def __init__(self, region: Directed, own: Motion, other: Motion | None = None) -> None:
        self.region: Final = region
        self.own: Final = own
        self.other: Final = other

    @property
    def of_pairs(self) -> bool:
        return self.other is not None

    def of_own(self) -> ReachModel:
        return self.own

    def bound(self, time_s: float) -> float:
        return self.own.bound(time_s) + (0.0 if self.other is None else self.other.bound(time_s))

    def reach(self, situation: Situation, time_s: float) -> float:
        own, other = situation.own, self.other
        margin = self.region.margin(situation)
        most = self.bound(time_s)
        worst = 0.0
        for part, ux, uy, uz, peer in self.region.threats(situation):
            above = part - margin
            peer_s, peer_most = time_s, most
            if peer is not None and other is not None and peer.stamp_s < own.stamp_s:
                # The peer has been moving since its own sample, which is older.
                peer_s += own.stamp_s - peer.stamp_s
                peer_most = self.own.bound(time_s) + other.bound(peer_s)
            if peer_most - above <= worst:
                continue
            fall = self.own.extent(own, time_s, ux, uy, uz) - above
            if peer is not None and other is not None:
                fall += other.extent(peer, peer_s, -ux, -uy, -uz)
            # Written so that a fall that is not a number is returned, and counts as danger.
            if not fall <= worst:
                worst = fall
        return min(worst, most)

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        return self.own.admits(before, after, noise_m)
