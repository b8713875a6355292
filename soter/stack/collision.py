"""Collision: the centres of robots stay apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from soter.errors import IllFormedModule
from soter.rta import PairBound, Region, RTAModule, Situation, SpeedAccelerationBound, SpeedBound, Threat, Timing, Topic
from soter.sdk import Waypoint
from soter.stack.battery import Dock, GoHome
from soter.stack.recovery import Leg, RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.retreat import PATIENT_S, Retreat
from soter.stack.right_of_way import Path, RightOfWay
from soter.stack.terrain import Point

RETREAT_M: Final = 0.75
"""How far from every peer robots retreat; `BEYOND_M` beyond phi_safer if that is farther."""

BEYOND_M: Final = 0.25
"""How far beyond phi_safer; more if noise and age of both samples could otherwise keep the AC from control."""

FIRST_PATIENT_S: Final = 6.0
"""The first robot in the order waits this long for the others to leave its path, then makes room for them."""

_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Separation(Region):
    """Situations in which every peer is at least `least_m` away, centre to centre.

    If a peer's sample is older than this robot's own, the peer counts as driving at top speed in between.

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
                distance -= self.peer_v_max_m_s * (stamp_s - peer.stamp_s)
            if distance < nearest:
                nearest = distance
        return nearest - self.least_m

    def threats(self, situation: Situation) -> list[Threat]:
        own = situation.own
        x, y = own.x_m, own.y_m
        found = []
        for peer in situation.peers:
            dx, dy = peer.x_m - x, peer.y_m - y
            distance = math.sqrt(dx * dx + dy * dy)
            # At the same place, any direction will do: the margin is negative.
            ux, uy = (dx / distance, dy / distance) if distance > 0.0 else (1.0, 0.0)
            if peer.stamp_s < own.stamp_s:
                distance -= self.peer_v_max_m_s * (own.stamp_s - peer.stamp_s)
            found.append(Threat(distance - self.least_m, ux, uy, 0.0, peer))
        return found

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Separation):
            raise TypeError(f"phi_safer of a separation is a separation, not {type(safer).__name__}")
        return safer.least_m - self.least_m

    def noise(self, noise_m: float) -> float:
        return noise_m + self.peer_noise_m


def check_halves(
    module: RTAModule,
    timing: Timing,
    leg_m: float,
    peer_latency_s: float | None = None,
    peer: SpeedBound | None = None,
) -> None:
    """Check that each of two robots may use up half of the gap between them (P2a).

    A safe controller limits its legs along the line to where the peer is seen now. That line turns while both move, and
    a robot takes some distance to brake, of which the peer knows nothing. The first is covered if legs are at most a
    quarter of the separation long, the second if the AC loses control early enough; see docs/assurance.md.

    Args:
        module: the collision module of one robot.
        timing: what that robot adds to every horizon.
        leg_m: the longest leg of its safe controllers.
        peer_latency_s: the lesser of the two robots' latencies; None for this robot's own.
        peer: the bound that the other robot respects; None for the bound of all robots.

    Raises:
        IllFormedModule: names the numbers and a value that would do.
    """
    phi_safe, model = module.phi_safe, module.model
    if not isinstance(phi_safe, Separation) or model is None or not model.of_pairs:
        return
    if leg_m > phi_safe.least_m / 4.0 + _ROUNDING:
        fits_m = math.ceil(leg_m * 4000.0 - 1e-6) / 1000.0
        raise IllFormedModule(
            module.name,
            "P2a",
            f"legs of its safe controllers are up to {leg_m:.3f} m long, more than a quarter of the separation of "
            f"{phi_safe.least_m:g} m; phi_safe_m = {fits_m:.3f} would do, or robots with less latency and sample age",
            {"phi_safe_m": fits_m},
        )
    own = model.of_own()
    if not isinstance(own, SpeedBound | SpeedAccelerationBound):
        raise IllFormedModule(module.name, "P2a", f"a {type(own).__name__} has no top speed that could be checked")
    braking_s = own.v_max_m_s / own.brake_m_s2
    ahead_s = timing.ahead_s(module.delta_s)
    early_s = ahead_s - module.delta_s
    # A peer comes nearer at its own speed; it has set aside the part of its half that this takes within its latency.
    peer_m_s = max(phi_safe.peer_v_max_m_s if peer is None else peer.v_max_m_s, own.v_max_m_s)
    least_s = timing.latency_s if peer_latency_s is None else peer_latency_s
    aside_m = peer_m_s * (timing.tick_s + least_s) / 2.0
    if isinstance(model, PairBound):
        # The slower robot has less than half of the required gap to itself.
        look_s = timing.look_s(module.delta_s)
        share_m = (peer_m_s - own.v_max_m_s) * look_s
        if peer is not None:
            share_m = min(share_m, max(0.0, peer.bound(look_s) - own.bound(look_s)))
        aside_m += share_m / 2.0
    root_s = math.sqrt(aside_m / own.brake_m_s2)
    needed_s = peer_m_s / (2.0 * own.brake_m_s2) - root_s
    if 2.0 * own.brake_m_s2 * root_s > own.v_max_m_s:
        # Braking costs most from a speed that only the faster peer reaches.
        costs_s = (2.0 * peer_m_s - own.v_max_m_s) / (4.0 * own.brake_m_s2)
        needed_s = costs_s - aside_m / own.v_max_m_s
    if early_s < needed_s - _ROUNDING:
        # A Delta is a whole number of ticks.
        fits_s = math.ceil(needed_s / timing.tick_s - 1e-6) * timing.tick_s
        raise IllFormedModule(
            module.name,
            "P2a",
            f"braking from top speed takes {braking_s:.3f} s, so that the AC has to lose control {needed_s:.3f} s "
            f"before it must, and not {early_s:.3f} s; Delta = {fits_s:g} s would do",
            {"delta_s": fits_s},
        )


class BackAway(Retreat):
    """The collision module's safe controller: the first robot in the order holds, and the others retreat from it.

    A robot that has to charge goes on along its return path wherever the legs are certified. The others leave that
    path, even those on their way to charge if they come later in the order. A docked robot holds.
    """

    def __init__(
        self,
        period_s: float,
        waypoint: Topic[Waypoint],
        recovery: RecoveryPlanner,
        refuges: RefugeFinder,
        home: GoHome,
        dock: Dock,
        right_of_way: RightOfWay,
        retreat_m: float = RETREAT_M,
    ) -> None:
        super().__init__("back-away", period_s, waypoint, recovery, refuges, retreat_m, home, dock)
        self._right_of_way: Final = right_of_way

    def motion(self, situation: Situation) -> Leg | None:
        rule = self._right_of_way
        if self._dock.charging(situation):
            return self._home.leg_home(situation)
        path = rule.path_to_leave(situation.robot_id)
        self.leave, self.aside = path, path is not None or self._dock.wants_charge
        if path is not None:
            return self._leave(situation, path)
        if rule.first(situation.robot_id) and not self._dock.wants_charge and not rule.is_held(situation.robot_id):
            return self.recovery.hold(situation)
        return super().motion(situation)

    def patience_s(self, situation: Situation) -> float:
        # Others may be able to leave the first robot's path only past where it stands.
        return FIRST_PATIENT_S if self._right_of_way.first(situation.robot_id) else PATIENT_S

    def blocked(self, situation: Situation) -> bool:
        # A charging peer need not leave the path, and so near to it no leg of the path may be certified.
        own, apart_m = situation.own, self.recovery.apart_m(situation.age_s)
        return not self._right_of_way.path_is_clear(situation.robot_id) or any(
            math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) < apart_m for peer in situation.peers
        )

    def _leave(self, situation: Situation, path: Path) -> Leg | None:
        """Return the next leg out of a path that another robot needs; a leg home, if home leads away from that path."""
        own = situation.own
        if self._dock.wants_charge:
            leg = self._leg_home(situation)
            needs_m = math.dist((own.x_m, own.y_m), path.start)
            if leg is not None and math.dist((leg.x_m, leg.y_m), path.start) > needs_m:
                return leg
        return self.retreat(situation)

    def way(self, situation: Situation) -> list[Point]:
        return self._refuges.way(situation, self._peer_m)

    def without_refuge(self, situation: Situation) -> Leg | None:
        own = situation.own
        nearest = min(situation.peers, key=lambda p: (p.x_m - own.x_m) ** 2 + (p.y_m - own.y_m) ** 2, default=None)
        if nearest is None:
            return super().without_refuge(situation)
        return self.recovery.away(situation, own.x_m - nearest.x_m, own.y_m - nearest.y_m, self._dock.path.leads_back)
