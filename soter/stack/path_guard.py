"""The protected planner: a module on the topic `path`; its AC is an untrusted planner, its SC finds certified paths.

Its outputs are disjoint from the actuator's, so the composition theorem of the original SOTER paper (Desai et al., DSN
2019) applies to it as it stands. A path does not change by itself: its margin cannot fall between decisions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from soter.rta import DecisionModule, Node, ReachModel, Region, RTAModule, Sample, Situation, Timing, Topic
from soter.sdk import Controller
from soter.stack.planners import PlanRequest, PlanResult
from soter.stack.routes import Routes
from soter.stack.terrain import Point, Terrain

PATH: Final = "path"
_SEARCH_M: Final = 0.05


class PathSituation(Situation):
    """What the path's decision module judges: a request, and the path that the untrusted planner offers for it."""

    __slots__ = ("offered", "request")

    def __init__(self, robot_id: int, own: Sample, now_s: float, request: PlanRequest, offered: PlanResult) -> None:
        super().__init__(robot_id, own, now_s)
        self.request = request
        self.offered = offered


class PathClearance(Region):
    """Paths along which the body stays at least `least_m` clear of every box, the leg from the start included.

    If the start itself is nearer to a box, the path must come no nearer than the start.
    """

    def __init__(self, terrain: Terrain, least_m: float) -> None:
        self.terrain: Final = terrain
        self.least_m: Final = least_m

    def margin(self, situation: Situation) -> float:
        if not isinstance(situation, PathSituation) or not situation.offered.ok:
            return -math.inf
        start = situation.request.start
        wanted = min(self.least_m, self.terrain.clearance_m(*start))
        places = [start, *situation.offered.path]
        if not all(math.isfinite(x + y) for x, y in places):
            # Comparisons with NaN are false: such a path would be near to nothing.
            return -math.inf
        clear = min(
            (self.terrain.segment_clearance_m(*a, *b) for a, b in pairwise(places)),
            default=-math.inf,
        )
        return clear - wanted

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, PathClearance):
            raise TypeError(f"phi_safer of a path's clearance has to be one too, it is a {type(safer).__name__}")
        return safer.least_m - self.least_m


class StandsStill(ReachModel):
    """A path does not move: R(T) = 0."""

    def bound(self, time_s: float) -> float:
        return 0.0

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        return True


class OfferedPath(Node):
    """The AC: publishes the untrusted planner's path."""

    name = "planner"
    subscribes = ("request",)
    publishes = (PATH,)

    def __init__(self, topic: Topic[PlanResult], period_s: float) -> None:
        self.period_s = period_s
        self._topic: Final = topic

    def step(self, situation: Situation) -> None:
        if isinstance(situation, PathSituation):
            self._topic.publish(situation.offered)


class CertifiedPath(Node):
    """The SC: publishes the shortest path over the corners of the grown boxes.

    A goal where the body does not fit is replaced by the nearest place where it does.
    """

    name = "certified-planner"
    subscribes = ("request",)
    publishes = (PATH,)

    def __init__(self, topic: Topic[PlanResult], period_s: float, terrain: Terrain, clearance_m: float) -> None:
        self.period_s = period_s
        self._topic: Final = topic
        self._terrain: Final = terrain
        self._clearance_m: Final = clearance_m

    def step(self, situation: Situation) -> None:
        if not isinstance(situation, PathSituation):
            return
        request = situation.request
        goal = self._free(request.goal)
        legs: Sequence[Point] = ()
        if goal is not None:
            legs = Routes(self._terrain, goal, self._clearance_m, -math.inf).legs(*request.start)
        if legs:
            result = PlanResult(request.request_id, tuple(legs), situation.offered.checks, None, goal == request.goal)
        else:
            result = PlanResult.failed(request.request_id, "there is no certified way", situation.offered.checks)
        self._topic.publish(result)

    def _free(self, goal: Point) -> Point | None:
        """Return the goal, or the nearest place around it, ring by ring, with the clearance of the certified paths."""
        if self._terrain.clearance_m(*goal) >= self._clearance_m:
            return goal
        low_x, low_y, high_x, high_y = self._terrain.bounds
        for ring in range(1, round(max(high_x - low_x, high_y - low_y) / _SEARCH_M)):
            radius = ring * _SEARCH_M
            for step in range(16):
                angle = step * math.pi / 8
                place = (goal[0] + radius * math.cos(angle), goal[1] + radius * math.sin(angle))
                if self._terrain.clearance_m(*place) >= self._clearance_m:
                    return place
        return None


class PathGuard:
    """The module `path` of one robot, asked whenever a plan arrives.

    Args:
        terrain: the boxes.
        delta_s: the module's period; a plan is judged when it is delivered, at most a tick old.
        phi_safe_m: body clearance that every path keeps.
        phi_safer_m: body clearance from which the untrusted planner is used again.
        clearance_m: body clearance of the certified paths.

    Raises:
        IllFormedModule: the numbers do not fit together.
    """

    def __init__(
        self, terrain: Terrain, delta_s: float, phi_safe_m: float, phi_safer_m: float, clearance_m: float
    ) -> None:
        self._topic: Topic[PlanResult] = Topic(PATH)
        self.module: Final = RTAModule(
            PATH, OfferedPath(self._topic, delta_s), CertifiedPath(self._topic, delta_s, terrain, clearance_m),
            delta_s, PathClearance(terrain, phi_safe_m), PathClearance(terrain, phi_safer_m), StandsStill(),
            dwell_s=0.0,
        )  # fmt: skip
        self.module.check(Timing(), delta_s)
        self._decision: Final = DecisionModule(self.module, Timing(), delta_s)
        self.replaced = 0
        """Number of the untrusted planner's paths that were replaced."""

    @property
    def mode(self) -> Controller:
        """The controller whose paths are used."""
        return self._decision.mode

    def judge(self, own: Sample, now_s: float, request: PlanRequest, offered: PlanResult) -> PlanResult:
        """Return the path to use: the offered one, or the certified one."""
        situation = PathSituation(request.robot_id, own, now_s, request, offered)
        self._decision.decide(situation)
        node = self.module.ac if self._decision.mode is Controller.AC else self.module.sc
        self.replaced += node is self.module.sc
        node.step(situation)
        assert self._topic.value is not None
        return self._topic.value
