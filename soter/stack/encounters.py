"""Decides which of two robots waits before they meet, so that the collision module need not take both. Untrusted.

Otherwise two robots whose paths cross lose their ACs at the same moment, and some seconds later go on as before. Of two
robots on their way, the one with the higher id waits until the other is past; a robot that stands is driven round.
"""

from __future__ import annotations

from enum import Enum, auto
from math import hypot, inf, sqrt
from typing import Final

from soter.sdk import Link, RobotState
from soter.stack.kit import RobotKit, RobotPort

AHEAD_S: Final = 2.0
"""Encounters farther in the future are ignored: they may never come, since robots do not know each other's paths."""

LOOK_S: Final = 0.25
"""A robot looks this often for those that it is about to meet, while it may meet any."""

_LOOKS_LEFT_OUT: Final = 8
"""At most so many looks in a row are left out while all others are far away."""

_TURNS_RAD_S: Final = 0.1
_MEETING_SHARE: Final = 0.95
"""Share of the distance that plans keep at which robots meet; below 1, so that passing as planned is no encounter."""


class Duty(Enum):
    """How a robot on its way has to behave towards the others."""

    NONE = auto()
    WAIT = auto()
    GO_ROUND = auto()


def stands(kit: RobotKit, peer: RobotPort) -> bool:
    """Return whether a peer is to be driven round: it stands, is silent, or its AC has no control.

    A peer that turns in place does not count: it is about to set off. Two robots that turned back because of each other
    would meet again on the other side.
    """
    state = peer.state
    if state is None:
        return False
    moves = hypot(state.vx_m_s, state.vy_m_s) >= kit.promised.moving_m_s or abs(state.yaw_rate_rad_s) > _TURNS_RAD_S
    return not (peer.engaged and state.link is Link.UP and moves)


def duty(kit: RobotKit, own: RobotState) -> Duty:
    """Return how a robot has to behave towards the robots that it would meet if it went on as it does now."""
    apart_m = _MEETING_SHARE * kit.disc_m
    met = {robot_id: peer for robot_id, peer in kit.peers.items() if _meets_s(own, peer.state, apart_m) < AHEAD_S}
    if not met:
        return Duty.NONE
    if any(robot_id < kit.robot_id and not stands(kit, peer) for robot_id, peer in met.items()):
        return Duty.WAIT
    return Duty.GO_ROUND if any(stands(kit, peer) for peer in met.values()) else Duty.NONE


def looks_again_s(kit: RobotKit, own: RobotState) -> float:
    """Return when a robot has to look for encounters next, in seconds: before that, no peer can come near enough."""
    closing_m_s = kit.promised.v_max_m_s + kit.peers_v_max_m_s
    enough_m = _MEETING_SHARE * kit.disc_m + closing_m_s * AHEAD_S
    looks = 1.0 + _LOOKS_LEFT_OUT
    for peer in kit.peers.values():
        state = peer.state
        if state is None:
            return LOOK_S
        spare_m = hypot(state.x_m - own.x_m, state.y_m - own.y_m) - enough_m
        # Written so that NaN in a peer's state leaves out no look.
        if not spare_m >= looks * LOOK_S * closing_m_s:
            looks = max(spare_m // (LOOK_S * closing_m_s), 1.0) if spare_m > 0.0 else 1.0
    return looks * LOOK_S


def has_to_wait(kit: RobotKit, own: RobotState) -> bool:
    """Return whether a peer still comes towards a robot that waits."""
    return any(_comes(kit, own, peer) for peer in kit.peers.values())


def _comes(kit: RobotKit, own: RobotState, peer: RobotPort) -> bool:
    state = peer.state
    if state is None or stands(kit, peer):
        return False
    x_m, y_m = state.x_m - own.x_m, state.y_m - own.y_m
    return hypot(x_m, y_m) < 2.0 * kit.disc_m and x_m * state.vx_m_s + y_m * state.vy_m_s < 0.0


def _meets_s(own: RobotState, other: RobotState | None, apart_m: float) -> float:
    """Return in how many seconds two robots at constant velocity are `apart_m` apart; infinity for never."""
    if other is None:
        return inf
    x_m, y_m = other.x_m - own.x_m, other.y_m - own.y_m
    vx_m_s, vy_m_s = other.vx_m_s - own.vx_m_s, other.vy_m_s - own.vy_m_s
    # |(x, y) + t v| = apart, the earlier of both solutions.
    # Products, since powers raise where they overflow.
    a, b = vx_m_s * vx_m_s + vy_m_s * vy_m_s, x_m * vx_m_s + y_m * vy_m_s
    c = x_m * x_m + y_m * y_m - apart_m * apart_m
    # Written so that NaN in a peer's state is no encounter.
    if not (b < 0.0 and b * b >= a * c):
        return inf
    return max((-b - sqrt(b * b - a * c)) / a, 0.0)
