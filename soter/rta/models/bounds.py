"""Bounds that follow from the declared limits, mostly without looking at the state."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, nan
from typing import ClassVar, Final

from soter.rta.assumptions import Assumption
from soter.rta.models.base import ROUNDING_M, Directed, Motion, ReachModel
from soter.rta.models.motion import positive
from soter.rta.situation import Sample, Situation

_ROUNDING_CHARGE: Final = 1e-6


class SpeedBound(Motion):
    """A top speed and a guaranteed deceleration: R(T) = v_max T + v_max^2 / (2 brake).

    Args:
        v_max_m_s: top speed.
        brake_m_s2: guaranteed deceleration; the distance to stop after T is part of the bound, because no controller
            can stop a vehicle with inertia at once.
    """

    def __init__(self, v_max_m_s: float, brake_m_s2: float) -> None:
        self.v_max_m_s = positive("v_max_m_s", v_max_m_s)
        self.brake_m_s2 = positive("brake_m_s2", brake_m_s2)
        self.stop_m = v_max_m_s * v_max_m_s / (2.0 * brake_m_s2)

    def bound(self, time_s: float) -> float:
        return self.v_max_m_s * time_s + self.stop_m

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        # As `_allowed_m`; this is called for every sample.
        allowed_m = self.v_max_m_s * (after.stamp_s - before.stamp_s) + 2.0 * noise_m + ROUNDING_M
        dx, dy = after.x_m - before.x_m, after.y_m - before.y_m
        return allowed_m >= 0.0 and dx * dx + dy * dy <= allowed_m * allowed_m

    def excess(self, before: Sample, after: Sample, noise_m: float) -> tuple[float, str]:
        way_m = hypot(after.x_m - before.x_m, after.y_m - before.y_m)
        return way_m - self._allowed_m(before, after, noise_m), "m"

    def _allowed_m(self, before: Sample, after: Sample, noise_m: float) -> float:
        return self.v_max_m_s * (after.stamp_s - before.stamp_s) + 2.0 * noise_m + ROUNDING_M


class PairBound(ReachModel):
    """The distance between two robots falls by at most the sum of their speed bounds.

    Args:
        own: this robot's bound.
        other: the bound that every peer is assumed to respect.
    """

    @property
    def of_pairs(self) -> bool:
        return True

    def __init__(self, own: SpeedBound, other: SpeedBound) -> None:
        self.own = own
        self.other = other

    def bound(self, time_s: float) -> float:
        return self.own.bound(time_s) + self.other.bound(time_s)

    def of_own(self) -> ReachModel:
        return self.own

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        return self.own.admits(before, after, noise_m)


class PairsBound(PairBound):
    """`PairBound` for robots that differ: each pair's distance falls by at most the sum of its own two robots' bounds.

    For a slower peer this robot's own bound is counted twice, since each robot keeps to its half of the gap.

    Args:
        region: the region with this margin; its threats name the peers.
        own: this robot's bound.
        each: by peer, the bound that the peer respects.
    """

    def __init__(self, region: Directed, own: SpeedBound, each: Mapping[int, SpeedBound]) -> None:
        super().__init__(own, SpeedBound(
            max(bound.v_max_m_s for bound in each.values()), min(bound.brake_m_s2 for bound in each.values())
        ))  # fmt: skip
        self.region: Final = region
        self.each: Final = each

    def bound(self, time_s: float) -> float:
        alone = self.own.bound(time_s)
        return alone + max(alone, *(other.bound(time_s) for other in self.each.values()))

    def reach(self, situation: Situation, time_s: float) -> float:
        margin, alone = self.region.margin(situation), self.own.bound(time_s)
        # The nearest peer need not be the first to come too near: take the largest fall of any pair.
        worst = 0.0
        for part, _, _, _, peer in self.region.threats(situation):
            theirs = self.other if peer is None else self.each.get(peer.robot_id, self.other)
            fall = alone + max(alone, theirs.bound(time_s)) - (part - margin)
            # Written so that a fall that is not a number is returned, and counts as danger.
            if not fall <= worst:
                worst = fall
        return worst


class DischargeBound(ReachModel):
    """The charge falls no faster than at driving power; the return path grows no faster than the robot drives.

    Args:
        drive_per_s: charge used per second at driving power.
        v_max_m_s: top speed.
        cost_per_m: charge set aside for each metre of the return path.
        jump: charge by which the cost of the return path may jump when a shorter path is no longer in sight.
    """

    assumption: ClassVar[Assumption] = Assumption.DISCHARGE

    def __init__(self, drive_per_s: float, v_max_m_s: float, cost_per_m: float, jump: float = 0.0) -> None:
        self.drive_per_s = drive_per_s
        self.cost_per_m = cost_per_m
        self.rate_per_s = drive_per_s + v_max_m_s * cost_per_m
        self.jump = jump

    def bound(self, time_s: float) -> float:
        return self.rate_per_s * time_s + self.jump

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        if before.battery is None or after.battery is None:
            return before.battery is after.battery
        return before.battery - after.battery <= self._allowed(before, after, noise_m)

    def excess(self, before: Sample, after: Sample, noise_m: float) -> tuple[float, str]:
        if before.battery is None or after.battery is None:
            return nan, ""
        return before.battery - after.battery - self._allowed(before, after, noise_m), "of a charge"

    def _allowed(self, before: Sample, after: Sample, noise_m: float) -> float:
        # Both positions may be wrong by the noise, so the charge used may be off by driving that far.
        unsure = 2.0 * noise_m * self.cost_per_m + _ROUNDING_CHARGE
        return self.drive_per_s * (after.stamp_s - before.stamp_s) + unsure


class DirectedReach(ReachModel):
    """R(T) of a region's margin, from the reach tubes of a robot and, for a margin to peers, of those peers.

    A part of the margin that is m now is never less than m - h(u) within T, where u is the direction in which it
    falls and h(u) the extent of the tube. The margin is the least of its parts, so it falls by no more than the
    largest of margin - m + h(u). A part that is more than `bound` above the margin cannot become the least, and is
    not looked at.

    Between two robots m falls by no more than h(u) + h'(-u), with h' the peer's extent. Twice the larger of the two is
    taken, so that each robot keeps to its half of the gap, which the other robot's SC relies on.

    Args:
        region: the region with this margin.
        own: this robot's motion.
        other: the motion of every peer, for a region whose threats name peers.
        each: by peer, its motion; peers that are not in it have `other`.
    """

    def __init__(
        self, region: Directed, own: Motion, other: Motion | None = None, each: Mapping[int, Motion] | None = None
    ) -> None:
        self.region: Final = region
        self.own: Final = own
        self.other: Final = other
        self.each: Final = each or {}

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
                other = self.each.get(peer.robot_id, self.other)
                theirs = self._extent_of(other, peer, own.stamp_s, time_s, -ux, -uy, -uz)
                # Twice the larger of the two, written so that NaN stays NaN.
                far = far + theirs + abs(far - theirs)
            # Written so that a fall that is not a number is returned, and counts as danger.
            if not far - above <= worst:
                worst = far - above
        return min(worst, most)

    @staticmethod
    def _extent_of(
        other: Motion, peer: Sample, stamp_s: float, time_s: float, ux: float, uy: float, uz: float
    ) -> float:
        """Return how far a peer gets from its sample, if it drives at top speed up to this robot's own stamp."""
        behind_s = stamp_s - peer.stamp_s
        if behind_s <= 0.0:
            return other.extent(peer, time_s, ux, uy, uz)
        accounted = other.bound(time_s + behind_s) - other.bound(time_s)
        return other.extent(peer, time_s + behind_s, ux, uy, uz) - accounted

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        return self.own.admits(before, after, noise_m)
