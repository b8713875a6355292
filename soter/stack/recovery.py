"""The certified recovery planner: the only source of motions that safe controllers make.

A motion is a turn in place and a straight leg, no longer than the robot may cover before its safe controller looks
again, stopping included. The leg, inflated by the robot's tracking error, is tested against every enabled rule,
whichever module drives: all rules hold along it and at its end. Where the tracking error does not fit, a leg may only
lead away from what is too near, in every direction that the robot may really take.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

from soter.rta import Sample, Situation
from soter.sdk import Capabilities, Waypoint
from soter.stack.own_rules import OwnRule
from soter.stack.terrain import Point, Terrain

PAIR_NEAR_M: Final = 0.6
"""Peers nearer than this limit every motion of a safe controller; a larger separation needs a larger distance."""

SEPARATION_M: Final = 0.3
LEAST_LEG_M: Final = 0.04
"""Least length of a leg: a slow robot, which may only be blind for a few millimetres, would count as arrived."""

CORNER_M: Final = 0.02
"""A robot this near to a corner of its path counts as past it."""

_ARRIVED_M: Final = 0.02
_CLIMB_M: Final = 0.005
_ALIGNED_RAD: Final = 0.35
_ALIGNED_COS: Final = math.cos(_ALIGNED_RAD)
_ALIGNED_SIN: Final = math.sin(_ALIGNED_RAD)
_DIRECTIONS: Final = tuple((math.cos(k * math.pi / 8), math.sin(k * math.pi / 8)) for k in range(16))


def _best_first(score: Callable[[float, float], float], least: float) -> list[Point]:
    """Return the directions that score more than `least`: to certify legs against users' rules takes long."""
    scored = sorted(((score(*each), each) for each in _DIRECTIONS), key=itemgetter(0), reverse=True)
    return [each for value, each in scored if value > least]


@dataclass(frozen=True, slots=True)
class RecoveryRules:
    """The rules that are enabled, which every motion keeps."""

    fence: bool = True
    boxes: bool = True
    pairs: bool = True
    separation_m: float = SEPARATION_M


def extent_m(capabilities: Capabilities, period_s: float) -> float:
    """Return how far a leg may take a robot, its tracking error included."""
    blind_s = period_s + capabilities.latency_s + capabilities.sample_age_s
    return _leg_m(capabilities.v_max_m_s, blind_s, _stop_m(capabilities)) + capabilities.tube_m


def _stop_m(capabilities: Capabilities) -> float:
    return capabilities.v_max_m_s * capabilities.v_max_m_s / (2.0 * capabilities.brake_m_s2)


def _leg_m(v_max_m_s: float, blind_s: float, stop_m: float) -> float:
    return max(v_max_m_s * blind_s + stop_m, LEAST_LEG_M)


class Leg(Waypoint):
    """A waypoint made by the recovery planner; safe controllers drive to no others."""

    __slots__ = ()


class RecoveryPlanner:
    """Certifies motions for one robot, and makes the next leg towards a place.

    Args:
        terrain: fence and boxes.
        capabilities: the robot's top speed, brake, latency and tracking error.
        rules: the enabled rules.
        period_s: how often a safe controller looks (T_sc).
        peer_noise_m: error of the positions that peers report, at most.
        peer_v_max_m_s: top speed that peers are assumed to respect; this robot's own counts if it is higher.
        peer_extent_m: how far a leg may take a peer, see `extent_m`; this robot's own counts if it is more.
        pair_v_max_m_s: by peer, the higher of its and this robot's top speeds, for pairs slower than the fastest.

    Attributes:
        own_rules: the rules of the user's own modules, which every leg keeps, too.
        v_max_m_s: top speed of the robot.
        turn_s: how long a turn in place to a leg takes at most, at the top turn rate.
        certified_m: distance of the end of a leg from fence and boxes.
        path_m: distance of paths from fence and boxes: enough for every leg to be certified from wherever the robot may
            be by then, off a corner or off the line, with its position noise.
        no_certified_motion: number of ticks at which neither any motion nor holding kept every rule.
    """

    def __init__(
        self,
        terrain: Terrain,
        capabilities: Capabilities,
        rules: RecoveryRules,
        period_s: float,
        peer_noise_m: float = 0.0,
        peer_v_max_m_s: float = 0.0,
        peer_extent_m: float = 0.0,
        pair_v_max_m_s: Mapping[int, float] | None = None,
    ) -> None:
        self.terrain: Final = terrain
        self.rules: Final = rules
        self.own_rules: Sequence[OwnRule] = ()
        self.v_max_m_s: Final = capabilities.v_max_m_s
        self.moving_m_s: Final = capabilities.moving_m_s
        self._peer_v_max = max(capabilities.v_max_m_s, peer_v_max_m_s)
        self._pair_v_max = pair_v_max_m_s or {}
        self._tracking_m = capabilities.tube_m
        self._tube = capabilities.tube_m + capabilities.position_noise_m
        self._pair_noise = capabilities.position_noise_m + peer_noise_m
        self._blind_s = period_s + capabilities.latency_s
        self._stop_m = _stop_m(capabilities)
        self._braking_s_per_m_s = 0.5 / capabilities.brake_m_s2
        self._drift_m_s = self.v_max_m_s * _ALIGNED_SIN
        self.certified_m: Final = self._tube + self._drift_m_s * capabilities.sample_age_s
        self.path_m: Final = self.certified_m + self._tube + CORNER_M
        # Two robots that do not limit their legs for each other must not be able to meet within one leg of both. The
        # peer's leg, which may be longer, counts in full: it may have been certified from farther away.
        own_m = extent_m(capabilities, period_s)
        self._pair_near_m = max(PAIR_NEAR_M, rules.separation_m + own_m + max(own_m, peer_extent_m))
        self._reverses = capabilities.reverses
        # Who goes backwards as well turns no farther than that.
        self.turn_s: Final = math.pi / (2.0 if self._reverses else 1.0) / capabilities.yaw_rate_max_rad_s
        self.no_certified_motion = 0

    def leg_m(self, age_s: float) -> float:
        """Return the length of a leg: how far the robot may go before its safe controller looks again.

        It includes stopping, so that a robot whose supervisor dies comes to rest inside what was certified. A longer
        leg is as safe, since all of it is certified.

        Args:
            age_s: age of the sample that the leg starts from.
        """
        return _leg_m(self.v_max_m_s, self._blind_s + age_s, self._stop_m)

    def apart_m(self, age_s: float) -> float:
        """Return the distance from a robot at rest beyond which legs of a path are certified in every direction.

        These legs may be short: of half the gap, only a corner's tolerance is left.

        Args:
            age_s: the largest age of a sample.
        """
        blind_m = self._peer_v_max * (self._blind_s + 2.0 * age_s)
        return self.rules.separation_m + self._pair_noise + 2.0 * (blind_m + self._tracking_m + CORNER_M)

    def certify(self, situation: Situation, bx_m: float, by_m: float) -> float:
        """Return the worst margin of the straight leg from the robot to b, in metres; negative if it is not allowed.

        Anything that is too near already counts as zero if the leg leads away from it.
        """
        own = situation.own
        ax, ay = own.x_m, own.y_m
        worst = math.inf
        rules, terrain = self.rules, self.terrain
        # While the sample aged, the robot may have moved at an angle to the leg.
        tube = self._tube + self._drift_m_s * situation.age_s
        if rules.fence:
            worst = terrain.leg_fence_m(ax, ay, bx_m, by_m, tube, _ALIGNED_SIN)
        if rules.boxes:
            least = terrain.clearance_m(ax, ay) - math.hypot(bx_m - ax, by_m - ay) - tube
            if least < 0.0:
                least = terrain.leg_clearance_m(ax, ay, bx_m, by_m, tube, _ALIGNED_SIN) - tube
            if least < worst:
                worst = least
        if rules.pairs and situation.peers:
            spare = self._pair_spare_m(situation, bx_m - ax, by_m - ay)
            if spare < worst:
                worst = spare
        if worst >= 0.0 and self.own_rules:
            peer_m = self._peer_v_max * (self._blind_s + situation.age_s)
            off_m = self.certified_m
            if not all(rule.allows(situation, bx_m, by_m, off_m, _ALIGNED_RAD, peer_m) for rule in self.own_rules):
                return -1.0
        return worst

    def hold_margin(self, situation: Situation) -> float:
        """Return the worst margin of holding where the robot is."""
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

    def _pair_spare_m(self, situation: Situation, dx: float, dy: float) -> float:
        """Return what the motion leaves of this robot's half of the gap, along the line to each near peer.

        Both robots of a pair keep to their halves, so their projections on that line never come nearer than the
        separation, however each moves sideways. Balls of half the gap would not do: both may sidestep to one point.
        """
        own = situation.own
        spare = math.inf
        separation, length = self.rules.separation_m, math.sqrt(dx * dx + dy * dy)
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
            half = gap / 2.0 - self._pair_v_max.get(peer.robot_id, self._peer_v_max) * (self._blind_s + age_s)
            if along <= -_ALIGNED_SIN * length:
                # Away, however the robot strays from the leg, or at rest: nothing else can be better.
                left = max(half, 0.0)
            else:
                # Towards the peer the robot may run beyond the leg's end; across, it may only stray to the side.
                aside = 1.0 if along > 0.0 else math.sqrt(length * length - along * along) / length
                left = half - max(along, 0.0) - self._tracking_m * aside
            if left < spare:
                spare = left
        return spare

    def towards(self, situation: Situation, legs: Sequence[Point]) -> Leg | None:
        """Return the next certified leg along a path, or None to brake and hold.

        The path's first corner is where to go next. The leg is only as long as the robot may be blind, stopping
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
        # Never shorter than braking from top speed takes, or the vehicle would slow down for every leg.
        length = min(distance, self.leg_m(situation.age_s))
        while length >= _ARRIVED_M:
            bx, by = own.x_m + ux * length, own.y_m + uy * length
            if self.certify(situation, bx, by) >= 0.0:
                return self._leg(own, bx, by, ux, uy)
            length *= 0.5
        if self._squeezed(own):
            return self.climb(situation)
        return self.hold(situation)

    def _squeezed(self, own: Sample) -> bool:
        """Return whether the robot is nearer to fence or boxes than paths are: it may not be able to follow one."""
        if self.rules.fence and self.terrain.fence_m(own.x_m, own.y_m) < self.path_m:
            return True
        return self.rules.boxes and self.terrain.clearance_m(own.x_m, own.y_m) < self.path_m

    def away(
        self, situation: Situation, score_x: float, score_y: float, leads_back: Callable[[float, float], bool]
    ) -> Leg | None:
        """Return the certified leg that gets farthest along a direction, or None to hold.

        Args:
            situation: the robot's.
            score_x: the direction, east.
            score_y: the direction, north.
            leads_back: whether a place has a path to the station. A leg needs less room than a path; it only ends where
                there is a path, unless the robot has none now.
        """
        own = situation.own
        length = self.leg_m(situation.age_s)
        anywhere = not leads_back(own.x_m, own.y_m)
        for ux, uy in _best_first(lambda ux, uy: ux * score_x + uy * score_y, 0.1):
            bx, by = own.x_m + ux * length, own.y_m + uy * length
            if self.certify(situation, bx, by) >= 0.0 and (anywhere or leads_back(bx, by)):
                return self._go(own, ux, uy, length)
        return self.hold(situation)

    def climb(self, situation: Situation) -> Leg | None:
        """Return the certified leg at whose end the least static margin is largest, or None to hold at the top."""
        own, terrain = situation.own, self.terrain
        length = self.leg_m(situation.age_s)

        def height(x_m: float, y_m: float) -> float:
            fence_m = terrain.fence_m(x_m, y_m) if self.rules.fence else math.inf
            return min(fence_m, terrain.clearance_m(x_m, y_m) if self.rules.boxes else math.inf)

        for ux, uy in _best_first(
            lambda ux, uy: height(own.x_m + ux * length, own.y_m + uy * length), height(own.x_m, own.y_m) + _CLIMB_M
        ):
            if self.certify(situation, own.x_m + ux * length, own.y_m + uy * length) >= 0.0:
                return self._go(own, ux, uy, length)
        return self.hold(situation)

    def moves(self, own: Sample) -> bool:
        """Return whether a robot moves, judged by its reported speed."""
        return own.vx_m_s * own.vx_m_s + own.vy_m_s * own.vy_m_s > self.moving_m_s * self.moving_m_s

    def sees(self, situation: Situation, bx_m: float, by_m: float, clearance_m: float) -> bool:
        """Return whether the straight line to b keeps `clearance_m` from boxes, or as much as the robot has now.

        Inside a fence that is not convex, the line must also keep its distance from the fence.
        """
        own, terrain = situation.own, self.terrain
        x_m, y_m = own.x_m, own.y_m
        needed = min(clearance_m, terrain.clearance_m(x_m, y_m)) - 1e-9
        if terrain.segment_clearance_m(x_m, y_m, bx_m, by_m, needed) < needed:
            return False
        if not self.rules.fence or terrain.convex:
            return True
        inside = min(self.path_m, terrain.fence_m(x_m, y_m)) - 1e-9
        return terrain.fence_along_m(x_m, y_m, bx_m, by_m, inside) >= inside

    def free(self, ax_m: float, ay_m: float, bx_m: float, by_m: float) -> bool:
        """Return whether a line keeps the distance of paths from fence and boxes, less a corner's tolerance."""
        needed, terrain = self.path_m - CORNER_M, self.terrain
        if self.rules.fence and terrain.fence_along_m(ax_m, ay_m, bx_m, by_m, needed) < needed:
            return False
        return not self.rules.boxes or terrain.segment_clearance_m(ax_m, ay_m, bx_m, by_m, needed) >= needed

    def _go(self, own: Sample, ux: float, uy: float, length_m: float) -> Leg | None:
        if self._must_stop_first(own, ux, uy):
            return None
        return self._leg(own, own.x_m + ux * length_m, own.y_m + uy * length_m, ux, uy)

    def _must_stop_first(self, own: Sample, ux: float, uy: float) -> bool:
        """Return whether the robot moves in another direction than the leg's, and would come to rest off the leg.

        That is the case at a large angle, or at a speed that might take it farther off the leg than its tube.
        """
        vx, vy = own.vx_m_s, own.vy_m_s
        speed = math.sqrt(vx * vx + vy * vy)
        if speed <= self.moving_m_s:
            return False
        aside_m = abs(vx * uy - vy * ux) * (self._blind_s + speed * self._braking_s_per_m_s)
        return (vx * ux + vy * uy) < _ALIGNED_COS * speed or aside_m > self._tracking_m

    def hold(self, situation: Situation) -> Leg | None:
        """Return None to hold; if holding breaks a rule, the leg with the largest worst margin, and count the tick."""
        best = self.hold_margin(situation)
        if best >= 0.0:
            return None
        self.no_certified_motion += 1
        own = situation.own
        length = self.leg_m(0.0)
        chosen: Leg | None = None
        for ux, uy in _DIRECTIONS:
            bx, by = own.x_m + ux * length, own.y_m + uy * length
            margin = self.certify(situation, bx, by)
            if margin > best and not self._must_stop_first(own, ux, uy):
                best, chosen = margin, self._leg(own, bx, by, ux, uy)
        return chosen

    def _leg(self, own: Sample, bx: float, by: float, ux: float, uy: float) -> Leg:
        bearing = math.atan2(uy, ux)
        heading: float | None = None
        if self._reverses:
            backwards = math.cos(bearing - own.heading_rad) < 0.0
            heading = math.remainder(bearing + math.pi, math.tau) if backwards else bearing
        return Leg(bx, by, 0.0, heading, None, 0.005, 30.0)
