"""What a safety module is declared from, shipped or a user's own, whichever robot it guards."""

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
"""A robot that has stood still for so long beside another is blocked by it."""

REFUGE_PEER_M: Final = 0.5
"""How far from peers the places are that modules about what does not move retreat to."""

_STEP_M: Final = 0.1


@dataclass(frozen=True)
class ModuleKit:
    """What a safety module is made from: one robot and its world.

    Attributes:
        name: the module's name in the mission; the declaration gets it whatever it calls itself.
        robot_id: which robot it guards.
        capabilities: what that robot promises.
        workspace: fence, boxes, chargers.
        terrain: the same, as distances.
        ac: the AC's node.
        waypoint: where the module's safe controller publishes where to go, as far away as it likes, or None to hold.
        recovery: certified motions; what a safe controller publishes is driven by them in any case.
        refuges: finds places that are safer for every static rule.
        dock: the robot's charging station.
        home: drives the return path to it, by certified legs.
        model: the robot's speed bound, R(T) of any margin that is a distance to something at rest.
        peers: what the other robots are assumed to respect.
        right_of_way: the fleet's arbiter.
        battery: the mission's table of that name.
        timing: what the robot adds to every horizon.
        tick_s: the base tick, a period for nodes.
        contracts_s: how long the modules declared before this one may keep the robot from charging, all together.
        motions: how the robot moves, by model, as the modules share it.
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
    motions: dict[MotionModel, Motion] = field(default_factory=dict)

    def motion(self, model: MotionModel) -> Motion:
        """Return how the robot moves, as a model sees it.

        There is one of each kind for all modules, so that a robot's samples are tested against each of them once.

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
        """Return a safe controller that goes to the nearest refuge, or home where there is none in reach."""
        return Retreat(
            name, self.tick_s, self.waypoint, self.recovery, self.refuges, REFUGE_PEER_M, self.home, self.dock
        )

    def place_ahead(self, situation: Situation, fits: Callable[[float, float], bool]) -> Point:
        """Return the nearest place ahead that fits; else one less and less ahead, last behind, or where the robot is.

        Args:
            situation: where the robot is, and its heading.
            fits: what else is asked of a place, x and y in metres. It is a refuge for fence and boxes in any case, and
                in sight.
        """
        own, refuges, terrain = situation.own, self.refuges, self.recovery.terrain
        low_x, low_y, high_x, high_y = terrain.bounds
        for turn in (side * step * math.pi / 8.0 for step in range(9) for side in (1, -1)):
            cos, sin = math.cos(own.heading_rad + turn), math.sin(own.heading_rad + turn)
            for step in range(1, math.ceil(math.hypot(high_x - low_x, high_y - low_y) / _STEP_M)):
                x_m, y_m = own.x_m + step * _STEP_M * cos, own.y_m + step * _STEP_M * sin
                if (
                    fits(x_m, y_m)
                    and terrain.fence_m(x_m, y_m) >= refuges.fence_m
                    and terrain.clearance_m(x_m, y_m) >= refuges.clearance_m
                    and self.recovery.sees(situation, x_m, y_m, refuges.clearance_m)
                ):
                    return x_m, y_m
        return own.x_m, own.y_m

    def go_to(self, choose: Callable[[Situation], Point], speed_m_s: float | None = None) -> Node:
        """Return a safe controller that chooses a place when it takes charge, and goes there; anew if it gets stuck.

        Args:
            choose: returns the place.
            speed_m_s: how fast at most, above 0, or None for the robot's own.

        Raises:
            ValueError: the speed is no speed to drive at: it is seen here, before anything moves.
        """
        Waypoint(0.0, 0.0, speed_m_s=speed_m_s).check()
        return GoTo(self, choose, speed_m_s)


class GoTo(Node):
    """A node that chooses a place when it takes charge, or has stood for a while; see `ModuleKit.go_to`."""

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
        self._place = self._choose(situation)
        self._moved_s = situation.now_s

    def step(self, situation: Situation) -> None:
        if self._recovery.moves(situation.own):
            self._moved_s = situation.now_s
        elif situation.now_s - self._moved_s > BLOCKED_S:
            # There may have been no place at all then, or somebody in the way to it.
            self.engage(situation)
        self._waypoint.publish(Waypoint(*self._place, speed_m_s=self._speed_m_s))
