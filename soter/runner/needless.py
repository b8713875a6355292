"""Judges which disengagements were needless: the AC, left alone, would have kept the rule.

A statistic about how conservative the modules are. It uses the AC's intentions, which the modules themselves never may.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

from soter.rta import RobotSupervisor, Situation, SwitchRecord
from soter.rta.module import margin_of
from soter.sdk import Controller, RobotState, Waypoint
from soter.stack.assembly import SafeRobot
from soter.stack.terrain import length_m

STEP_S: Final = 0.1
LONGEST_S: Final = 30.0

Place = tuple[float, float]


class NeedlessJudge:
    """Rolls the AC's pending waypoints forward, at top speed and straight from one to the next."""

    def __init__(
        self,
        supervisors: Mapping[int, RobotSupervisor],
        robots: Mapping[int, SafeRobot],
        v_max_m_s: Mapping[int, float],
    ) -> None:
        self._supervisors: Final = supervisors
        self._robots: Final = robots
        self._v_max_m_s: Final = v_max_m_s

    def judge(self, record: SwitchRecord) -> bool:
        """Return whether all of the AC's remaining path would have kept the module's rule."""
        module = next((m for m in self._robots[record.robot_id].declared.modules if m.name == record.module), None)
        if module is None or module.phi_safe is None:
            return False
        situation = self._supervisors[record.robot_id].situation
        own = situation.own
        if not isinstance(own, RobotState):
            return False
        way = self._pending(record.robot_id, own)
        meets = module.of_pairs
        peers = [(peer, self._way_of_peer(peer)) for peer in situation.peers if isinstance(peer, RobotState)]
        speeds = self._v_max_m_s
        lasts_s = min(length_m(way) / speeds[record.robot_id], LONGEST_S)
        imagined = Situation(record.robot_id, own, record.time_s)
        steps = math.ceil(max(lasts_s, module.delta_s) / STEP_S)
        for step in range(1, steps + 1):
            time_s = step * STEP_S
            imagined.own = _moved(own, way, speeds[record.robot_id] * time_s)
            if meets:
                imagined.peers = [_moved(peer, path, speeds.get(peer.robot_id, 0.0) * time_s) for peer, path in peers]
            # A rule of a user's own may fail; then it cannot be said to be kept.
            if not margin_of(module.phi_safe, imagined) >= 0.0:
                return False
        return True

    def _way_of_peer(self, state: RobotState) -> list[Place]:
        """Return the path of a peer; a peer whose AC has no control stays where it is."""
        supervisor = self._supervisors.get(state.robot_id)
        if supervisor is None or supervisor.mode is Controller.SC:
            return [(state.x_m, state.y_m)]
        return self._pending(state.robot_id, state)

    def _pending(self, robot_id: int, state: RobotState) -> list[Place]:
        """Return where a robot is, and the places that its AC intends to pass."""
        request = self._robots[robot_id].forwarder.request
        pending: list[Waypoint] = [] if request is None else [request.command, *request.upcoming]
        return [(state.x_m, state.y_m), *(place for waypoint in pending if (place := _place(waypoint)) is not None)]


def _place(waypoint: Waypoint) -> Place | None:
    """Return where a waypoint is; None if an untrusted AC has passed something else as one."""
    if type(waypoint) is not Waypoint or type(waypoint.x_m) is not float or type(waypoint.y_m) is not float:
        return None
    return (waypoint.x_m, waypoint.y_m) if math.isfinite(waypoint.x_m + waypoint.y_m) else None


def _moved(state: RobotState, way: Sequence[Place], travelled_m: float) -> RobotState:
    """Return the state of a robot that has travelled this far along a path."""
    x, y = way[-1]
    left = travelled_m
    for a, b in pairwise(way):
        leg = math.dist(a, b)
        if left < leg:
            part = left / leg
            x, y = a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])
            break
        left -= leg
    return state._replace(x_m=x, y_m=y)
