"""How far a margin can fall, by how far robots get in the very directions in which it falls."""

from __future__ import annotations

from typing import Final

from soter.rta.models.base import Directed, Motion, ReachModel
from soter.rta.situation import Sample, Situation


class DirectedReach(ReachModel):
    """R(T) of a region's margin from the reach tube of a robot, and of its peers where the margin is one to them.

    A part of the margin that is m now is never less than m - h(u) within T, where u is the direction in which it
    falls and h(u) the extent of the tube. The margin is the least of its parts, so it falls by no more than the
    largest of margin - m + h(u). A part that is more than `bound` above the margin cannot become the least, and is
    not looked at.

    Between two robots m falls by no more than h(u) + h'(-u), with h' the peer's extent. Twice the larger of the two is
    taken: each robot keeps to its half of the gap then, which is what the other one counts upon in its own SC.

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

    def of_own(self) -> Motion:
        return self.own

    def bound(self, time_s: float) -> float:
        alone = self.own.bound(time_s)
        return alone if self.other is None else 2.0 * max(alone, self.other.bound(time_s))

    def reach(self, situation: Situation, time_s: float) -> float:
        own, region = situation.own, self.region
        margin = region.margin(situation)
        most = self.bound(time_s)
        worst = 0.0
        for part, ux, uy, uz, peer in region.threats(situation):
            above = part - margin
            if most - above <= worst:
                continue
            far = self.own.extent(own, time_s, ux, uy, uz)
            if peer is not None and self.other is not None:
                theirs = self._extent_of(self.other, peer, own.stamp_s, time_s, -ux, -uy, -uz)
                # Twice the larger of the two; written so that what is not a number stays that.
                far = far + theirs + abs(far - theirs)
            # Written so that a fall that is not a number is returned, and counts as danger.
            if not far - above <= worst:
                worst = far - above
        return min(worst, most)

    @staticmethod
    def _extent_of(
        other: Motion, peer: Sample, stamp_s: float, time_s: float, ux: float, uy: float, uz: float
    ) -> float:
        """Return how far a peer gets from where the margin has it: at top speed up to this robot's own stamp."""
        behind_s = stamp_s - peer.stamp_s
        if behind_s <= 0.0:
            return other.extent(peer, time_s, ux, uy, uz)
        accounted = other.bound(time_s + behind_s) - other.bound(time_s)
        return other.extent(peer, time_s + behind_s, ux, uy, uz) - accounted

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        return self.own.admits(before, after, noise_m)
