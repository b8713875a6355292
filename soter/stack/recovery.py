"""The certified recovery planner: the only source of motions that safe controllers make.

A motion is a turn in place and a straight leg of at most the length that the robot may cover before its safe
controller looks again, stopping included. The leg, inflated by the robot's tracking error, is tested against every
enabled rule; whatever is driving, all rules hold at its end and all along. A static margin that is negative already may
only rise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from soter.rta import Sample, Situation
from soter.sdk import Capabilities, Waypoint
from soter.stack.terrain import Point, Terrain

PAIR_NEAR_M: Final = 0.6
"""Peers nearer than this limit every motion of a safe controller; a larger separation needs a larger distance."""

SEPARATION_M: Final = 0.3
_ARRIVED_M: Final = 0.02
_CLIMB_M: Final = 0.005
_ROUNDING_M: Final = 1e-9
_MOVING_M_S: Final = 0.02
_ALIGNED_RAD: Final = 0.35
_ALIGNED_COS: Final = math.cos(_ALIGNED_RAD)
_ALIGNED_SIN: Final = math.sin(_ALIGNED_RAD)
_DIRECTIONS: Final = tuple((math.cos(k * math.pi / 8), math.sin(k * math.pi / 8)) for k in range(16))


@dataclass(frozen=True, slots=True)
class RecoveryRules:
    """Which rules a motion must keep.

    Attributes:
        fence: stay inside the fence.
        boxes: keep the body clear of boxes.
        pairs: keep the centres of robots apart.
        separation_m: how far apart.
    """

    fence: bool = True
    boxes: bool = True
    pairs: bool = True
    separation_m: float = SEPARATION_M


class RecoveryPlanner:
    """Certifies motions for one robot, and makes the next leg towards a place.

    Args:
        terrain: what does not move.
        capabilities: of the robot: top speed, brake, latency, tracking error.
        rules: the enabled ones.
        period_s: how often a safe controller looks (T_sc).
        peer_noise_m: error of the positions that peers report, at most.
        peer_v_max_m_s: top speed that peers are assumed to respect, where it is higher than this robot's own.
    """

    def __init__(
        self,
        terrain: Terrain,
        capabilities: Capabilities,
        rules: RecoveryRules,
        period_s: float,
        peer_noise_m: float = 0.0,
        peer_v_max_m_s: float = 0.0,
    ) -> None:
        self.terrain: Final = terrain
        self.rules: Final = rules
        self._v_max = capabilities.v_max_m_s
        self._peer_v_max = max(capabilities.v_max_m_s, peer_v_max_m_s)
        self._tracking_m = capabilities.tube_m
        self._tube = capabilities.tube_m + capabilities.position_noise_m
        self._pair_noise = capabilities.position_noise_m + peer_noise_m
        self._blind_s = period_s + capabilities.latency_s
        self._stop_m = self._v_max * self._v_max / (2.0 * capabilities.brake_m_s2)
        self._drift_m_s = self._v_max * _ALIGNED_SIN
        # Two robots that do not limit their legs for each other must not be able to meet within one leg of both.
        self._pair_near_m = max(PAIR_NEAR_M, rules.separation_m + 2.0 * self.leg_m(capabilities.sample_age_s))
        self._reverses = capabilities.reverses
        self.no_certified_motion = 0
        """Ticks at which neither any motion nor holding kept every rule."""

    def leg_m(self, age_s: float) -> float:
        """Return the length of a leg, which is as far as the robot may go before its safe controller looks again.

        It includes stopping, so that a robot whose supervisor dies comes to rest inside what was certified.

        Args:
            age_s: age of the sample that the leg starts from.
        """
        return self._v_max * (self._blind_s + age_s) + self._stop_m

    # --- certificates ----------------------------------------------------------------------------------------

    def certify(self, situation: Situation, bx_m: float, by_m: float) -> float:
        """Return the worst margin of the straight leg from the robot to b, in metres; negative if it is not allowed.

        A static margin that is negative at the start counts as zero if the leg makes it rise all the way.
        """
        own = situation.own
        ax, ay = own.x_m, own.y_m
        worst = math.inf
        rules, terrain = self.rules, self.terrain
        # A robot that moves while its sample ages may have done so at a slant to the leg.
        tube = self._tube + self._drift_m_s * situation.age_s
        if rules.fence:
            # Concave along a line: the least margin is at one of its ends.
            start, end = terrain.fence_m(ax, ay), terrain.fence_m(bx_m, by_m)
            worst = 0.0 if start < tube and start < end < tube else end - tube
        if rules.boxes:
            start = terrain.clearance_m(ax, ay)
            least = start - math.hypot(bx_m - ax, by_m - ay) - tube
            if least < 0.0:
                least = terrain.segment_clearance_m(ax, ay, bx_m, by_m) - tube
                if least < 0.0 and start < tube and self._leaves_boxes(ax, ay, bx_m, by_m):
                    least = 0.0
            if least < worst:
                worst = least
        if rules.pairs and situation.peers:
            spare = self._pair_spare_m(situation, bx_m - ax, by_m - ay)
            if spare < worst:
                worst = spare
        return worst

    def hold_margin(self, situation: Situation) -> float:
        """Return the worst margin of staying where the robot is."""
        own = situation.own
        worst = math.inf
        if self.rules.fence:
            worst = self.terrain.fence_m(own.x_m, own.y_m)
        if self.rules.boxes:
            worst = min(worst, self.terrain.clearance_m(own.x_m, own.y_m))
        if self.rules.pairs:
            for peer in situation.peers:
                gap = math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) - self.rules.separation_m
                worst = min(worst, gap)
        return worst

    def _leaves_boxes(self, ax: float, ay: float, bx: float, by: float) -> bool:
        """Whether the leg leads away from boxes: the clearance rises at its start and is nowhere less than there.

        The distance to one box is convex along the leg, so that rising at the start would do; that to several is not.
        """
        clearance = self.terrain.clearance_m
        start = clearance(ax, ay)
        nearby = clearance(ax + 0.05 * (bx - ax), ay + 0.05 * (by - ay))
        least = self.terrain.segment_clearance_m(ax, ay, bx, by)
        return nearby > start and clearance(bx, by) > nearby and least >= start - _ROUNDING_M

    def _pair_spare_m(self, situation: Situation, dx: float, dy: float) -> float:
        """Return by how much the motion stays below each robot's half of the gap, along the line to each near peer.

        Both robots of a pair keep to their half, so the projections on that line never come nearer than the
        separation, however each moves sideways. Balls of half the gap would not do: both may sidestep to one point.
        """
        own = situation.own
        spare = math.inf
        separation = self.rules.separation_m
        for peer in situation.peers:
            px, py = peer.x_m - own.x_m, peer.y_m - own.y_m
            distance = math.sqrt(px * px + py * py)
            age_s = situation.age_s + max(0.0, situation.now_s - peer.stamp_s)
            if distance >= self._pair_near_m + self._pair_noise + self._peer_v_max * age_s:
                continue
            if distance == 0.0:
                return -1.0
            along = (dx * px + dy * py) / distance
            gap = distance - self._pair_noise - separation
            half = gap / 2.0 - self._peer_v_max * (self._blind_s + age_s) - self._tracking_m
            if along <= 0.0:
                # Away, or at rest: always at least as good as anything else.
                half = max(half, 0.0)
            left = half - along
            if left < spare:
                spare = left
        return spare

    # --- motions ---------------------------------------------------------------------------------------------

    def towards(self, situation: Situation, legs: Sequence[Point]) -> Waypoint | None:
        """Return the next certified leg along a way, or None to brake and hold.

        The way's first corner is where to go next. The leg is only as long as the robot may be blind, stopping
        included, so that a safe controller that dies leaves the robot at rest inside what was certified.
        """
        own = situation.own
        goal = legs[0] if legs else None
        if goal is None:
            return self.hold(situation)
        gx, gy = goal[0] - own.x_m, goal[1] - own.y_m
        distance = math.sqrt(gx * gx + gy * gy)
        if distance < _ARRIVED_M:
            return None
        ux, uy = gx / distance, gy / distance
        if self._must_stop_first(own, ux, uy):
            return None
        # Never less than braking from top speed takes, else the vehicle would have to slow down for every leg.
        length = min(distance, self.leg_m(situation.age_s))
        while length >= _ARRIVED_M:
            bx, by = own.x_m + ux * length, own.y_m + uy * length
            if self.certify(situation, bx, by) >= 0.0:
                return self._leg(own, bx, by, ux, uy)
            length *= 0.5
        return self.hold(situation)

    def away(self, situation: Situation, score_x: float, score_y: float) -> Waypoint | None:
        """Return the certified leg that gets farthest along a direction, or None to hold."""
        own = situation.own
        length = self.leg_m(situation.age_s)
        best, chosen = 0.1, None
        for ux, uy in _DIRECTIONS:
            score = ux * score_x + uy * score_y
            if score > best and self.certify(situation, own.x_m + ux * length, own.y_m + uy * length) >= 0.0:
                best, chosen = score, (ux, uy)
        return self._go(situation, chosen, length)

    def climb(self, situation: Situation) -> Waypoint | None:
        """Return the certified leg at whose end the least static margin is largest, or None to hold at the top."""
        own, terrain = situation.own, self.terrain
        length = self.leg_m(situation.age_s)

        def height(x_m: float, y_m: float) -> float:
            fence_m = terrain.fence_m(x_m, y_m) if self.rules.fence else math.inf
            return min(fence_m, terrain.clearance_m(x_m, y_m))

        best, chosen = height(own.x_m, own.y_m) + _CLIMB_M, None
        for ux, uy in _DIRECTIONS:
            bx, by = own.x_m + ux * length, own.y_m + uy * length
            if height(bx, by) > best and self.certify(situation, bx, by) >= 0.0:
                best, chosen = height(bx, by), (ux, uy)
        return self._go(situation, chosen, length)

    def sees(self, situation: Situation, bx_m: float, by_m: float, clearance_m: float) -> bool:
        """Return whether a straight way to b keeps `clearance_m` from boxes, or as much as the robot has now."""
        own = situation.own
        needed = min(clearance_m, self.terrain.clearance_m(own.x_m, own.y_m)) - 1e-9
        return self.terrain.segment_clearance_m(own.x_m, own.y_m, bx_m, by_m) >= needed

    def _go(self, situation: Situation, direction: Point | None, length_m: float) -> Waypoint | None:
        if direction is None:
            return self.hold(situation)
        own = situation.own
        if self._must_stop_first(own, *direction):
            return None
        return self._leg(own, own.x_m + direction[0] * length_m, own.y_m + direction[1] * length_m, *direction)

    def _must_stop_first(self, own: Sample, ux: float, uy: float) -> bool:
        """Whether the robot moves in a direction that does not lie along the leg: it would brake somewhere else."""
        vx, vy = own.vx_m_s, own.vy_m_s
        speed = math.sqrt(vx * vx + vy * vy)
        return speed > _MOVING_M_S and (vx * ux + vy * uy) < _ALIGNED_COS * speed

    def hold(self, situation: Situation) -> Waypoint | None:
        """Hold; where even that breaks a rule, take the motion with the largest worst margin, and count it."""
        best = self.hold_margin(situation)
        if best >= 0.0:
            return None
        self.no_certified_motion += 1
        own = situation.own
        length = self._v_max * self._blind_s + self._stop_m
        chosen: Waypoint | None = None
        for ux, uy in _DIRECTIONS:
            bx, by = own.x_m + ux * length, own.y_m + uy * length
            margin = self.certify(situation, bx, by)
            if margin > best and not self._must_stop_first(own, ux, uy):
                best, chosen = margin, self._leg(own, bx, by, ux, uy)
        return chosen

    def _leg(self, own: Sample, bx: float, by: float, ux: float, uy: float) -> Waypoint:
        bearing = math.atan2(uy, ux)
        heading: float | None = None
        if self._reverses:
            backwards = math.cos(bearing - own.heading_rad) < 0.0
            heading = math.remainder(bearing + math.pi, math.tau) if backwards else bearing
        return Waypoint(bx, by, 0.0, heading, None, 0.005, 30.0)
