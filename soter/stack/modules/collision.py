"""Collision: the centres of robots stay apart."""

from __future__ import annotations

from dataclasses import replace

from soter.config.tables import CollisionTable
from soter.rta import Motion, RTAModule, SpeedBound, Timing
from soter.stack.collision import BEYOND_M, RETREAT_M, BackAway, Separation, check_halves
from soter.stack.module_kit import ModuleKit
from soter.stack.peers import PeerBounds
from soter.stack.reach import reach_between


def declare(kit: ModuleKit, table: CollisionTable) -> RTAModule:
    """Declare the module of one robot.

    Raises:
        IllFormedModule: a robot does not promise what the motion model needs.
    """
    worst, peers = kit.peers.worst, kit.peers

    def motion(peer: PeerBounds) -> Motion:
        return peer.limits.motion(kit.name, table.model)

    def halves(module: RTAModule, timing: Timing) -> None:
        leg_m = kit.recovery.leg_m(timing.sample_age_s)
        for peer in dict.fromkeys(peers.each.values()) or (worst,):
            latency_s = min(timing.latency_s, peer.latency_s)
            check_halves(module, timing, leg_m, latency_s, SpeedBound(peer.v_max_m_s, peer.brake_m_s2))

    apart = Separation(table.phi_safe_m, worst.v_max_m_s, worst.noise_m)
    own = kit.capabilities
    aged_m = own.v_max_m_s * own.sample_age_s + worst.v_max_m_s * worst.sample_age_s
    unsure_m = own.position_noise_m + worst.noise_m + aged_m + own.overshoot_m
    # Robots that wait for others under a rule of the mission's own need that rule's distance.
    retreat_m = max(RETREAT_M, max(table.phi_safer_m, kit.pairs_m) + max(BEYOND_M, unsure_m))
    back_away = BackAway(
        kit.tick_s, kit.waypoint, kit.recovery, kit.refuges, kit.home, kit.dock, kit.right_of_way, retreat_m
    )
    return RTAModule(
        kit.name,
        kit.ac,
        back_away,
        table.delta_s,
        apart,
        replace(apart, least_m=table.phi_safer_m),
        reach_between(
            apart, kit.motion(table.model), motion(worst), {other: motion(peer) for other, peer in peers.unlike.items()}
        ),
        dwell_s=table.dwell_s,
        premise=halves,
    )
