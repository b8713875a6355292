"""Who goes first when robots meet. Progress rests on it; safety never does."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from soter.rta import Mode, RobotSupervisor, Situation

NEAR_M: Final = 0.6
"""Robots nearer than this meet; 0.1 m beyond phi_safer where that is more."""

MEMORY_S: Final = 3.0
"""An encounter ends so long after its robots were last near each other."""

TURN_S: Final = 20.0
"""After so long the order rotates, so that a first robot that cannot move does not block the others for ever."""

CLEAR_M: Final = 0.70
"""Beyond this distance from every peer nobody needs a turn; 0.2 m beyond phi_safer where that is more."""

PATIENCE_S: Final = 4.0
"""After so long in SC a robot at phi_safer may go on whatever the order says."""

LOW_CHARGE: Final = 0.60
COLLISION: Final = "collision"
BATTERY: Final = "battery"


@dataclass(slots=True)
class Encounter:
    """Robots that met, and since when.

    Attributes:
        members: their ids.
        since_s: fleet time of the first meeting.
        order: ids, who goes first at the front.
    """

    members: frozenset[int]
    since_s: float
    order: tuple[int, ...]


class RightOfWay:
    """The arbiter of re-engagement. One for a supervisor's robots; called by it before decisions are made.

    Supervisors that share peers come to the same order, up to the time it takes to hear of each other.

    Args:
        safer_m: the distance from which the collision module gives robots back.
        needs_charge: whether a robot of another supervisor is on its way to charge, and low.
    """

    def __init__(self, safer_m: float = 0.0, needs_charge: Callable[[int], bool] = lambda _: False) -> None:
        self._near_m: Final = max(NEAR_M, safer_m + 0.1)
        self._clear_m: Final = max(CLEAR_M, safer_m + 0.2)
        self._remote_needs_charge: Final = needs_charge
        self._met_s: dict[tuple[int, int], float] = {}
        self._encounters: dict[int, Encounter] = {}
        self._disengaged_s: dict[int, float] = {}

    def update(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        """Find out who meets whom, and who goes first."""
        met, near_m = self._met_s, self._near_m
        for robot_id, robot in robots.items():
            own = robot.situation.own
            for peer in robot.situation.peers:
                peer_id = peer.robot_id
                if peer_id <= robot_id and peer_id in robots:
                    continue
                dx, dy = peer.x_m - own.x_m, peer.y_m - own.y_m
                if dx * dx + dy * dy < near_m * near_m:
                    met[min(robot_id, peer_id), max(robot_id, peer_id)] = now_s
            for module in robot.modules:
                if module.name == COLLISION:
                    self._disengaged_s[robot_id] = module.since_s if module.mode is Mode.SC else now_s
        if met or self._encounters:
            for pair in [pair for pair, seen_s in met.items() if now_s - seen_s > MEMORY_S]:
                del met[pair]
            self._form(now_s, robots)

    def encounter(self, robot_id: int) -> Encounter | None:
        """Return the encounter that a robot is in, or None."""
        return self._encounters.get(robot_id)

    def first(self, robot_id: int) -> bool:
        """Return whether a robot goes before all others that it meets; True where it meets nobody."""
        encounter = self._encounters.get(robot_id)
        return encounter is None or encounter.order[0] == robot_id

    def permits(self, module: str, situation: Situation) -> bool:
        """Return whether a robot's collision module may release it; the others need no permission."""
        if module != COLLISION or self.first(situation.robot_id):
            return True
        if situation.now_s - self._disengaged_s.get(situation.robot_id, situation.now_s) >= PATIENCE_S:
            return True
        own = situation.own
        clear_m = self._clear_m
        return all(math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) > clear_m for peer in situation.peers)

    def _form(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        groups: dict[int, set[int]] = {}
        for one, other in self._met_s:
            merged = groups.get(one, {one}) | groups.get(other, {other})
            for member in merged:
                groups[member] = merged
        encounters: dict[int, Encounter] = {}
        for robot_id in sorted(groups):
            members = frozenset(groups[robot_id])
            if robot_id != min(members):
                continue
            # A group that grows or shrinks goes on with the order of its oldest part.
            since_s = min((e.since_s for m in members if (e := self._encounters.get(m)) is not None), default=now_s)
            ranked = sorted(members, key=lambda member: (not self._needs_charge(robots, member), member))
            turn = int((now_s - since_s) / TURN_S) % len(ranked)
            encounter = Encounter(members, since_s, tuple(ranked[turn:] + ranked[:turn]))
            for member in members:
                encounters[member] = encounter
        self._encounters = encounters

    def _needs_charge(self, robots: Mapping[int, RobotSupervisor], robot_id: int) -> bool:
        robot = robots.get(robot_id)
        return self._remote_needs_charge(robot_id) if robot is None else needs_charge(robot)


def needs_charge(robot: RobotSupervisor) -> bool:
    """Return whether a robot is on its way to charge and low: it goes before all others."""
    charge = robot.situation.own.battery
    low = charge is not None and charge < LOW_CHARGE
    return low and any(module.name == BATTERY and module.mode is Mode.SC for module in robot.modules)
