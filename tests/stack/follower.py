"""One robot and one safe controller, without an engine: it is at the end of every leg at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from soter.geometry.workspace import Box
from soter.rta import Situation, Topic
from soter.sdk import Capabilities, Waypoint
from soter.stack.battery import GoHome
from soter.stack.collision import BackAway
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.refuge import RefugeFinder
from soter.stack.retreat import Retreat
from soter.stack.right_of_way import RightOfWay
from soter.stack.safe_controller import SafeController
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.sdk.fake import CAPABILITIES
from tests.stack.ground import CASE, TERRAIN, TICK_S, dock, seen

FENCE_M, CLEAR_M, PEER_M = 0.52, 0.12, 0.5


class Says(RightOfWay):
    """An order that the test sets."""

    def __init__(self, first: bool, held: bool = False) -> None:
        super().__init__()
        self.answer = first
        self.held = held

    def is_held(self, robot_id: int) -> bool:
        return self.held

    def first(self, robot_id: int) -> bool:
        return self.answer


class Controllers:
    """The safe controllers of one robot, and what they share.

    Args:
        terrain: where.
        capabilities: of the robot.
        station: where it charges.
        occupied: rectangles that its path keeps out of.
        fence_m: what a refuge keeps from the fence.
        clear_m: what it keeps from boxes.
        rules: the enabled ones.
    """

    def __init__(
        self,
        terrain: Terrain = TERRAIN,
        capabilities: Capabilities = CAPABILITIES,
        station: Box = CASE.robots[0].charger,
        occupied: Sequence[Rectangle] = (),
        fence_m: float = FENCE_M,
        clear_m: float = CLEAR_M,
        rules: RecoveryRules | None = None,
    ) -> None:
        self.out: Topic[Any] = Topic("waypoint")
        self.recovery = RecoveryPlanner(terrain, capabilities, rules or RecoveryRules(), TICK_S)
        self.dock = dock(self.recovery, station, occupied)
        self.refuges = RefugeFinder(terrain, self.recovery, fence_m, clear_m)
        self.home = GoHome(TICK_S, self.out, self.recovery, self.dock)
        self.retreat = Retreat(
            "retreat", TICK_S, self.out, self.recovery, self.refuges, PEER_M, self.home, self.dock
        )  # fmt: skip

    def back_away(self, rule: RightOfWay) -> BackAway:
        """Return the collision module's."""
        return BackAway(TICK_S, self.out, self.recovery, self.refuges, self.home, self.dock, rule)


class Follower:
    """A robot that goes to the end of every leg at once, driven by one safe controller, with peers that stand."""

    def __init__(self, robot: Controllers, controller: SafeController, place: Point, *peers: Point) -> None:
        self.robot = robot
        self.controller = controller
        self.out = robot.out
        self.place = place
        self.peers = peers
        self.now_s = 0.0
        self.published = 0
        robot.dock.path.track(*place)
        controller.engage(self.look())

    def look(self) -> Situation:
        peers = [At(*place, self.now_s, number) for number, place in enumerate(self.peers, start=2)]
        return seen(At(*self.place, self.now_s, 1), peers, self.now_s)

    def step(self) -> Waypoint | None:
        count = self.out.count
        self.robot.dock.path.track(*self.place)
        self.controller.step(self.look())
        self.now_s += TICK_S
        self.published += self.out.count - count
        leg: Waypoint | None = self.out.value if self.out.count > count else None
        if leg is not None:
            assert self.controller.recovery.certify(self.look(), leg.x_m, leg.y_m) >= 0.0
            self.place = (leg.x_m, leg.y_m)
        return leg

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.step()

    def home_m(self) -> float:
        """Return how far the robot is from the middle of its station."""
        return math.dist(self.place, self.robot.dock.place)
