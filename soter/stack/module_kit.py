"""The kit that safety modules are declared from, shipped modules and the user's own alike."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from soter.config.tables import BatteryTable, MotionModel
from soter.geometry.workspace import Workspace
from soter.rta import Motion, Node, Situation, SpeedBound, Timing, Topic
from soter.sdk import Capabilities, Waypoint
from soter.stack.battery import Dock, GoHome
from soter.stack.peers import Peers
from soter.stack.reach import MotionLimits
from soter.stack.recovery import RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.retreat import Retreat
from soter.stack.right_of_way import RightOfWay
from soter.stack.safe_controller import WAYPOINT
from soter.stack.terrain import Point, Terrain

BLOCKED_S: Final = 5.0
"""A robot that has stood still beside another for this long is blocked by it."""

REFUGE_PEER_M: Final = 0.5
"""How far from peers the refuges of modules about static rules are."""

_STEP_M: Final = 0.1


@dataclass(frozen=True)
class ModuleKit:
    """What a safety module is made from: one robot and its world.

    Attributes:
        name: the module's name in the mission, which the declaration gets in place of its own.
        robot_id: the robot that it guards.
        capabilities: what that robot promises.
        workspace: fence, boxes, chargers.
        terrain: distances to fence and boxes.
        ac: the AC's node.
        waypoint: topic on which the module's safe controller publishes where to go, however far, or None to hold.
        recovery: makes certified legs; whatever a safe controller publishes is driven by these.
        refuges: finds places that are safer for every static rule.
        dock: the robot's charging station.
        home: drives the return path to it, by certified legs.
        model: the robot's speed bound: R(T) of any margin that is a distance to something at rest.
        peers: what the other robots are assumed to respect.
        right_of_way: the fleet's arbiter.
        battery: the mission's table of that name.
        timing: what the robot adds to every horizon.
        tick_s: the base tick, a period for nodes.
        contracts_s: how long the modules declared before this one may keep the robot from charging, in total.
        shut_in_by: how many other robots' stations, while occupied, shut this robot off from its own somewhere.
        pairs_m: distance at which the mission's own rules about pairs give robots back; 0 without any.
        motions: the motion bounds that the modules share, by model.
    """

    name: str
    robot_id: int
    capabilities: Capabilities
    workspace: Workspace
    terrain: Terrain
    ac: Node
    waypoint: Topic[Any]
    recovery: RecoveryPlanner
    refuges: RefugeFinder
    dock: Dock
    home: GoHome
    model: SpeedBound
    peers: Peers
    right_of_way: RightOfWay
    battery: BatteryTable
    timing: Timing
    tick_s: float
    contracts_s: float = 0.0
    shut_in_by: int = 0
    pairs_m: float = 0.0
    motions: dict[MotionModel, Motion] = field(default_factory=dict)

    def motion(self, model: MotionModel) -> Motion:
        """Return the robot's motion bound of the given model.

        All modules share one of each kind, so that a robot's samples are tested against each of them once.

        Raises:
            IllFormedModule: the robot does not promise what the model needs.
        """
        if model == "speed":
            return self.model
        if model not in self.motions:
            self.motions[model] = MotionLimits.of(self.capabilities).motion(self.name, model)
        return self.motions[model]

    @property
    def peer_model(self) -> SpeedBound:
        """The speed bound that every other robot respects, for a rule about pairs.

        `PairBound(kit.model, kit.peer_model)` is the model of such a rule.
        """
        return SpeedBound(self.peers.worst.v_max_m_s, self.peers.worst.brake_m_s2)

    def retreat(self, name: str) -> Node:
        """Return a safe controller that goes to the nearest refuge, or home if none is in reach."""
        return Retreat(
            name, self.tick_s, self.waypoint, self.recovery, self.refuges, REFUGE_PEER_M, self.home, self.dock
        )

    def place_ahead(self, situation: Situation, fits: Callable[[float, float], bool]) -> Point:
        """Return the nearest fitting place, preferring directions near the heading; the robot's own place if none fits.

        Args:
            situation: where the robot is, and its heading.
            fits: returns whether a place, x and y in metres, will do. The place returned is also in sight, a refuge
                from fence and boxes, and the way there breaks no rule of a user's module.
        """
        own, recovery = situation.own, self.recovery
        turns = [own.heading_rad + side * step * math.pi / 8.0 for step in range(9) for side in (1, -1)]
        leg_m = recovery.leg_m(situation.age_s)
        # Where no leg may begin it does not get away at all; if none may, wait in the best direction.
        begins = [
            recovery.certify(situation, own.x_m + leg_m * math.cos(turn), own.y_m + leg_m * math.sin(turn)) >= 0.0
            for turn in turns
        ]
        for wanted in (True, False):
            for turn, may_begin in zip(turns, begins, strict=True):
                if may_begin is wanted and (place := self._fitting(situation, turn, fits)) is not None:
                    return place
        return own.x_m, own.y_m

    def _fitting(self, situation: Situation, heading_rad: float, fits: Callable[[float, float], bool]) -> Point | None:
        """Return the nearest fitting place in a direction, as `place_ahead` has it."""
        own, refuges, recovery, terrain = situation.own, self.refuges, self.recovery, self.recovery.terrain
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        low_x, low_y, high_x, high_y = terrain.bounds
        for step in range(1, math.ceil(math.hypot(high_x - low_x, high_y - low_y) / _STEP_M)):
            x_m, y_m = own.x_m + step * _STEP_M * cos, own.y_m + step * _STEP_M * sin
            if (
                fits(x_m, y_m)
                and terrain.fence_m(x_m, y_m) >= refuges.fence_m
                and terrain.clearance_m(x_m, y_m) >= refuges.clearance_m
                and recovery.sees(situation, x_m, y_m, refuges.clearance_m)
            ):
                # What lies beyond is on the same way.
                allowed = all(rule.allows_way(own, x_m, y_m) for rule in recovery.own_rules)
                return (x_m, y_m) if allowed else None
        return None

    def go_to(self, choose: Callable[[Situation], Point], speed_m_s: float | None = None) -> Node:
        """Return a safe controller that chooses a place when it takes control, goes there, and chooses again if stuck.

        Args:
            choose: returns the place.
            speed_m_s: top speed on the way, above 0; None for the robot's own.

        Raises:
            ValueError: the speed is not above 0 and finite.
        """
        Waypoint(0.0, 0.0, speed_m_s=speed_m_s).check()
        return GoTo(self, choose, speed_m_s)


class GoTo(Node):
    """A node that chooses a place when it takes control or has stood for a while; see `ModuleKit.go_to`."""

    name = "go-to"
    publishes = (WAYPOINT,)

    def __init__(self, kit: ModuleKit, choose: Callable[[Situation], Point], speed_m_s: float | None) -> None:
        self.period_s = kit.tick_s
        self._waypoint: Final = kit.waypoint
        self._recovery: Final = kit.recovery
        self._choose: Final = choose
        self._speed_m_s: Final = speed_m_s
        self._place: Point = (math.nan, math.nan)
        self._moved_s = 0.0

    def engage(self, situation: Situation) -> None:
        # Until one is chosen: what chooses may fail, and has to say so each time that it is asked.
        self._place = (math.nan, math.nan)
        self._place = self._choose(situation)
        self._moved_s = situation.now_s

    def step(self, situation: Situation) -> None:
        moves = self._recovery.moves(situation.own)
        if moves:
            self._moved_s = situation.now_s
        if math.isnan(self._place[0]) or (not moves and situation.now_s - self._moved_s > BLOCKED_S):
            # There may have been no place before, or a peer in the way.
            self.engage(situation)
        self._waypoint.publish(Waypoint(*self._place, speed_m_s=self._speed_m_s))
