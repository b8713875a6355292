"""Robots that ram each other, and reverse to ram again."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from soter.controllers.adversaries.base import Adversary, AdversaryOptions, towards
from soter.controllers.base import Arena
from soter.sdk import RobotState, Waypoint

_MOVED_M = 0.02
_RUN_UP_M = 0.1


class ChaseOptions(AdversaryOptions):
    """Options of `Chase`.

    Attributes:
        dart: share of attacks that reverse before the collision module looks again.
        reverse_m: how far it reverses.
    """

    dart: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    reverse_m: Annotated[float, Field(gt=0.0, le=10.0)] = 0.3


class Chase(Adversary):
    """Every robot drives at its nearest peer. Attacks begin right after a look of the collision module.

    Some attacks last until control is lost. The others are darts: forwards for a part of Delta, then backwards, so that
    at the next look the robots are apart again.
    """

    Options = ChaseOptions
    options: ChaseOptions

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = arena.random("chase")
        self._ram_until_s = dict.fromkeys(arena.ports, math.nan)
        self._back_until_s = dict.fromkeys(arena.ports, -math.inf)
        self._aim: dict[int, tuple[float, float]] = {}

    def act(self, now_s: float, tick: int) -> None:
        """Ram, reverse, ram."""
        delta_s = self.arena.rta.collision.delta_s
        looked = self.arena.looked(tick, delta_s)
        for robot_id, port in self.arena.ports.items():
            own = port.state
            peers = self.arena.peers_of(robot_id)
            if own is None or not peers or not port.engaged:
                self._aim.pop(robot_id, None)
                self._ram_until_s[robot_id] = math.nan
                continue
            peer = peers[0]
            if now_s < self._back_until_s[robot_id]:
                continue
            if now_s >= self._ram_until_s[robot_id]:
                self._ram_until_s[robot_id] = math.nan
                self._back_until_s[robot_id] = now_s + max(0.5 * delta_s, self.arena.base_tick_s)
                self._aim.pop(robot_id, None)
                port.goto(self._backwards(own))
                continue
            if looked and math.isnan(self._ram_until_s[robot_id]) and self._near(own, peer, delta_s):
                darts = self._random.random() < self.options.dart
                lasts_s = delta_s * self._random.uniform(0.5, 0.9)
                self._ram_until_s[robot_id] = now_s + lasts_s if darts else math.inf
            if math.dist(self._aim.get(robot_id, (math.inf, math.inf)), (peer.x_m, peer.y_m)) > _MOVED_M:
                self._aim[robot_id] = (peer.x_m, peer.y_m)
                port.goto(towards(own, peer.x_m, peer.y_m))

    def _near(self, own: RobotState, peer: RobotState, delta_s: float) -> bool:
        """Return whether the module will act soon: farther away, reversing is useless."""
        gap_m = math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) - self.arena.rta.collision.phi_safe_m
        return gap_m < self.options.facts.reach_m(delta_s, 2) + _RUN_UP_M

    def _backwards(self, own: RobotState) -> Waypoint:
        """Return a goal behind the robot that it reaches by reversing."""
        back_m, heading = self.options.reverse_m, own.heading_rad
        x_m, y_m = own.x_m - back_m * math.cos(heading), own.y_m - back_m * math.sin(heading)
        return Waypoint(x_m, y_m, 0.0, heading, None, 0.005, 600.0)
