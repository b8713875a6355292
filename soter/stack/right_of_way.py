"""Decides which robot goes first when robots meet. Progress rests on it; safety never does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

from soter.controller import AC, SC
from soter.rta import DecisionModule, RobotSupervisor, Situation
from soter.stack.terrain import Point, length_m

NEAR_M: Final = 0.6
"""Robots nearer than this meet; more if phi_safer asks for it, so that robots farther apart can be given back."""

MEMORY_S: Final = 3.0
"""An encounter ends this long after its robots were last near each other."""

TURN_S: Final = 20.0
"""The order rotates after this time, so that a first robot that cannot move does not block the others for ever."""

CLEAR_M: Final = 0.70
"""A robot farther than this from every peer needs no turn; at least 0.1 m more than where robots meet."""

PATIENCE_S: Final = 4.0
"""After this long in SC a robot in phi_safer may go on whatever the order says."""

WAIT_S: Final = 30.0
"""A robot kept from its AC for this long is left alone by peers: for three such periods of every four."""

SETTLED_S: Final = 1.0
"""A robot needs its return path once the battery's module has had it for this long: all modules begin in SC."""

LOOK_S: Final = 0.5
"""How often paths are looked for again; in between they are kept as they are."""

BESIDE_M: Final = 0.3
"""A robot leaving a path goes on until it is this much farther away than it must be."""

AHEAD_S: Final = 30.0
"""Others leave as much of a robot's path as it covers in this time: robots farther ahead have time."""

PROGRESS_M: Final = 0.1
LOW_CHARGE: Final = 0.60
COLLISION: Final = "collision"
BATTERY: Final = "battery"


@dataclass(slots=True)
class Encounter:
    """Robots that have met: the fleet time since when, and their ids in order, the one that goes first in front."""

    members: frozenset[int]
    since_s: float
    order: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Path:
    """The return paths of robots on their way to charge, which others have to leave.

    Attributes:
        robot_id: the first of these robots in the order.
        lines: the next parts of their return paths, each from where the robot is.
        apart_m: distance that others keep from the lines.
        ends: where the whole paths end.
    """

    robot_id: int
    lines: tuple[tuple[Point, ...], ...]
    apart_m: float
    ends: tuple[Point, ...] = ()

    @property
    def start(self) -> Point:
        """Place of the first robot."""
        return self.lines[0][0]

    def near(self, x_m: float, y_m: float, beside_m: float = 0.0) -> bool:
        """Return whether a place is nearer to a line than `apart_m` plus `beside_m`."""
        apart_m = self.apart_m + beside_m
        return any(from_line(x_m, y_m, one, other) < apart_m for line in self.lines for one, other in pairwise(line))


@dataclass(slots=True)
class _Homing:
    """A robot on its way to charge: the part of its path that others leave, its end, when found, and its progress."""

    line: tuple[Point, ...]
    end: Point
    looked_s: float
    to_go_m: float
    progress_s: float


class _Modules(NamedTuple):
    """Two decision modules of a robot; None for one that is off."""

    collision: DecisionModule | None
    battery: DecisionModule | None


@dataclass(slots=True)
class _Wait:
    """Since when a robot has been without its AC, and whether a rule about pairs has held it since."""

    since_s: float
    of_pairs: bool = False


class RightOfWay:
    """The arbiter of which robots drive on and which make room. One per supervisor; called before decisions are made.

    Robots that have to charge come first, in the order in which they began to. All others leave the next part of the
    first one's return path, whichever controller drives them; all but the first leave the second one's, and so on. A
    robot that makes no progress goes to the end. Peers also make room for a robot that is not given back to its AC
    because they linger near it under their own ACs.

    Supervisors that share peers come to the same order of encounters, up to the time it takes to hear of each other;
    they do not know the paths of each other's robots.

    Args:
        safer_m: the distance from which the collision module gives robots back.
        needs_charge: whether a robot of another supervisor is on its way to charge, and low.
        apart_m: how far from a robot's path others must be, so that every leg along it is certified.
        legs: the return path of a robot from a place, as its corners.
        docked: whether a robot stands on its station.
        unsure_m: how much farther apart than `safer_m` robots may really be while noise and age keep them from being
            given back.
        ahead_m: how much of a robot's path others leave.
    """

    def __init__(
        self,
        safer_m: float = 0.0,
        needs_charge: Callable[[int], bool] = lambda _: False,
        apart_m: Callable[[int], float] = lambda _: NEAR_M,
        legs: Callable[[int, float, float], Sequence[Point]] = lambda *_: (),
        docked: Callable[[RobotSupervisor], bool] = lambda _: False,
        unsure_m: float = 0.0,
        ahead_m: Callable[[int], float] = lambda _: math.inf,
    ) -> None:
        self._apart_m: Final = apart_m
        self._ahead_m: Final = ahead_m
        self._legs: Final = legs
        self._docked: Final = docked
        self._known: dict[int, _Modules] = {}
        self._homing: dict[int, _Homing] = {}
        self._to_leave: dict[int, Path] = {}
        self._near_m: Final = max(NEAR_M, safer_m + max(0.1, unsure_m))
        self._clear_m: Final = max(CLEAR_M, self._near_m + 0.1)
        self._remote_needs_charge: Final = needs_charge
        self._met_s: dict[tuple[int, int], float] = {}
        self._encounters: dict[int, Encounter] = {}
        self._grouped: Set[tuple[int, int]] = frozenset()
        self._groups: Sequence[frozenset[int]] = ()
        self._waits: dict[int, _Wait] = {}
        self._held: dict[int, str] = {}

    def update(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        """Find the encounters, and the order of their robots."""
        met, near_sq_m2 = self._met_s, self._near_m * self._near_m
        # While every robot has its AC, nobody waits, is held, or is on its way to charge.
        settled = not (self._waits or self._held or self._homing or self._to_leave)
        for robot_id, robot in robots.items():
            settled = settled and robot.mode is AC
            own = robot.situation.own
            for peer in robot.situation.peers:
                peer_id = peer.robot_id
                if peer_id <= robot_id and peer_id in robots:
                    continue
                dx, dy = peer.x_m - own.x_m, peer.y_m - own.y_m
                if dx * dx + dy * dy < near_sq_m2:
                    met[min(robot_id, peer_id), max(robot_id, peer_id)] = now_s
        if not settled:
            self._leave_alone(now_s, robots)
            if self._find_homing(now_s, robots) or self._to_leave:
                self._make_room(now_s, robots)
        if met or self._encounters:
            for pair in [pair for pair, seen_s in met.items() if now_s - seen_s > MEMORY_S]:
                del met[pair]
            self._form(now_s, robots)

    def encounter(self, robot_id: int) -> Encounter | None:
        """Return the encounter that a robot is in, or None."""
        return self._encounters.get(robot_id)

    def path_to_leave(self, robot_id: int) -> Path | None:
        """Return the paths that a robot has to leave because others need them, or None."""
        return self._to_leave.get(robot_id)

    def path_is_clear(self, robot_id: int) -> bool:
        """Return whether no robot has to leave the given robot's path any more."""
        return all(path.robot_id != robot_id for path in self._to_leave.values())

    def first(self, robot_id: int) -> bool:
        """Return whether a robot goes before all others that it meets; True if it meets none."""
        if robot_id in self._to_leave:
            return False
        encounter = self._encounters.get(robot_id)
        return encounter is None or encounter.order[0] == robot_id

    def is_held(self, robot_id: int) -> bool:
        """Return whether a robot is kept from its AC so that it gets away from one that has waited long."""
        return robot_id in self._held

    def permits(self, module: str, situation: Situation, since_s: float) -> bool:
        """Return whether a module may release a robot that it has kept from its AC since then.

        The collision module may by the order of encounters, one that holds the robot for a peer never.
        """
        if self._held.get(situation.robot_id) == module:
            return False
        if module != COLLISION:
            return True
        if situation.robot_id in self._to_leave:
            return False
        if self.first(situation.robot_id):
            return True
        if situation.now_s - since_s >= PATIENCE_S:
            return True
        own = situation.own
        clear_m = self._clear_m
        return all(math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) > clear_m for peer in situation.peers)

    def _find_homing(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> bool:
        """Find the robots on their way to charge; return whether there are any."""
        homing = self._homing
        for robot_id, robot in robots.items():
            battery = None if robot.mode is AC else self._modules(robot).battery
            wants = battery is not None and battery.mode is SC and now_s - battery.since_s > SETTLED_S
            if not wants or self._docked(robot):
                homing.pop(robot_id, None)
                continue
            own, known = robot.situation.own, homing.get(robot_id)
            if known is not None and now_s - known.looked_s < LOOK_S:
                continue
            whole = ((own.x_m, own.y_m), *self._legs(robot_id, own.x_m, own.y_m))
            line, to_go_m = _beginning(whole, self._ahead_m(robot_id)), length_m(whole)
            if known is None:
                homing[robot_id] = _Homing(line, whole[-1], now_s, to_go_m, now_s)
                continue
            known.line, known.end, known.looked_s = line, whole[-1], now_s
            if to_go_m < known.to_go_m - PROGRESS_M:
                known.to_go_m, known.progress_s = to_go_m, now_s
            elif now_s - known.progress_s > TURN_S:
                # Move it to the end of the order, and measure its progress anew.
                del homing[robot_id]
                homing[robot_id] = _Homing(line, whole[-1], now_s, to_go_m, now_s)
        return bool(homing)

    def _make_room(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        """Have every robot leave the paths of the robots that go before it."""
        before, to_leave = self._to_leave, {}
        order = list(self._homing.items())
        for robot_id, robot in robots.items():
            ahead = [known for known in order[: _rank(robot_id, order)] if len(known[1].line) > 1]
            collision, battery = self._modules(robot)
            charges = battery is not None and battery.mode is SC and self._docked(robot)
            if not ahead or charges or collision is None:
                continue
            first, lines = ahead[0][0], tuple(known.line for _, known in ahead)
            path = Path(first, lines, self._apart_m(first), tuple(known.end for _, known in ahead))
            own = robot.situation.own
            if path.near(own.x_m, own.y_m, BESIDE_M if robot_id in before else 0.0):
                to_leave[robot_id] = path
                collision.take(now_s, f"robot {path.robot_id} has to get past to its charging station")
        self._to_leave = to_leave

    def _leave_alone(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        """Take from their ACs the peers that may keep a robot from its own: all that meet it, or at least the nearest.

        The robot that has waited longest comes first; a robot that is held itself has no peers held.
        """
        waits = [(robot_id, wait) for robot_id, each in robots.items() if (wait := self._wait(now_s, each)) is not None]
        if not waits:
            self._held = {}
            return
        held: dict[int, str] = {}
        for robot_id, wait in sorted(waits, key=lambda each: each[1].since_s):
            if robot_id in held or int((now_s - wait.since_s) / WAIT_S) % 4 == 0:
                continue
            own, peers = robots[robot_id].situation.own, robots[robot_id].situation.peers
            far_m = {peer.robot_id: math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) for peer in peers}
            # Under a rule about pairs the nearest peer keeps it waiting, however far away; else one may be in its way.
            nearest_m = min(far_m.values(), default=0.0) if wait.of_pairs else 0.0
            near_m = max(self._near_m, nearest_m)
            for peer_id in far_m.keys() & robots.keys():
                if far_m[peer_id] > near_m:
                    continue
                peer = robots[peer_id]
                module = self._modules(peer).collision or next(filter(_of_pairs, peer.modules), None)
                if module is not None:
                    held[peer_id] = module.name
                    module.take(now_s, f"robot {robot_id} has waited {WAIT_S:g} s for this one to keep away")
        self._held = held

    def _wait(self, now_s: float, robot: RobotSupervisor) -> _Wait | None:
        """Return since when modules other than the battery's have kept a robot from its AC; None if they do not."""
        kept_by: Sequence[DecisionModule] = ()
        if robot.mode is SC and not robot.ac_failure:
            battery = self._modules(robot).battery
            if battery is None or battery.mode is AC:
                kept_by = [each for each in robot.modules if each.mode is SC]
        if not kept_by:
            self._waits.pop(robot.robot_id, None)
            return None
        # A module in SC since it was bound has not waited for another robot yet.
        since_s = now_s if math.isinf(kept_by[0].since_s) else kept_by[0].since_s
        wait = self._waits.setdefault(robot.robot_id, _Wait(since_s))
        wait.of_pairs = wait.of_pairs or any(map(_of_pairs, kept_by))
        return wait

    def _form(self, now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        if self._met_s.keys() != self._grouped:
            self._grouped, self._groups = set(self._met_s), _groups(self._met_s)
        encounters: dict[int, Encounter] = {}
        for members in self._groups:
            # A group that grows or shrinks keeps the order of its oldest part.
            since_s = min((e.since_s for m in members if (e := self._encounters.get(m)) is not None), default=now_s)
            homing = [member for member in self._homing if member in members]
            others = members.difference(homing)
            ranked = sorted(others, key=lambda member: (not self._needs_charge(robots, member), member))
            turn = int((now_s - since_s) / TURN_S) % max(len(ranked), 1)
            encounter = Encounter(members, since_s, (*homing, *ranked[turn:], *ranked[:turn]))
            for member in members:
                encounters[member] = encounter
        self._encounters = encounters

    def _modules(self, robot: RobotSupervisor) -> _Modules:
        found = self._known.get(robot.robot_id)
        if found is None:
            named = {module.name: module for module in robot.modules}
            found = self._known[robot.robot_id] = _Modules(named.get(COLLISION), named.get(BATTERY))
        return found

    def _needs_charge(self, robots: Mapping[int, RobotSupervisor], robot_id: int) -> bool:
        robot = robots.get(robot_id)
        return self._remote_needs_charge(robot_id) if robot is None else needs_charge(robot)


def _groups(pairs: Iterable[tuple[int, int]]) -> list[frozenset[int]]:
    """Return the groups of robots of which each has met another of its group; that with the lowest id first."""
    groups: dict[int, frozenset[int]] = {}
    for one, other in pairs:
        merged = groups.get(one, frozenset((one,))) | groups.get(other, frozenset((other,)))
        groups.update(dict.fromkeys(merged, merged))
    return sorted(set(groups.values()), key=min)


def _of_pairs(module: DecisionModule) -> bool:
    return module.name == COLLISION or module.module.of_pairs


def needs_charge(robot: RobotSupervisor) -> bool:
    """Return whether a robot is low and on its way to charge, and so goes before all others."""
    charge = robot.situation.own.battery
    low = charge is not None and charge < LOW_CHARGE
    return low and any(module.name == BATTERY and module.mode is SC for module in robot.modules)


def _rank(robot_id: int, order: Sequence[tuple[int, _Homing]]) -> int:
    """Return how many robots on their way to charge go before a robot: all, if it is not one of them."""
    return next((rank for rank, (other_id, _) in enumerate(order) if other_id == robot_id), len(order))


def _beginning(line: Sequence[Point], most_m: float) -> tuple[Point, ...]:
    """Return the first `most_m` metres of a line."""
    kept = [line[0]]
    for one, other in pairwise(line):
        leg_m = math.dist(one, other)
        if leg_m > most_m:
            part = most_m / leg_m
            kept.append((one[0] + part * (other[0] - one[0]), one[1] + part * (other[1] - one[1])))
            break
        kept.append(other)
        most_m -= leg_m
    return tuple(kept)


def from_line(x: float, y: float, one: Point, other: Point) -> float:
    """Return the distance of a point from a straight leg."""
    dx, dy = other[0] - one[0], other[1] - one[1]
    length_sq = dx * dx + dy * dy
    along = ((x - one[0]) * dx + (y - one[1]) * dy) / length_sq if length_sq > 0.0 else 0.0
    along = min(max(along, 0.0), 1.0)
    return math.hypot(x - one[0] - along * dx, y - one[1] - along * dy)
