"""The sampling-based planners of OMPL. The only module that imports it."""

from __future__ import annotations

import itertools
import math
from abc import abstractmethod
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import ompl.base as ob
import ompl.geometric as og
import ompl.util as ou
from pydantic import Field

from soter.geometry.workspace import Workspace
from soter.stack.planners.base import Planner, PlannerOptions, PlanRequest, PlanResult, Point
from soter.stack.planners.space import FreeSpace, space_of

ou.setLogLevel(ou.LOG_NONE)

MAX_ASKED = 100
"""A search ends when OMPL has polled its stop condition this many times its number of checks."""

SHORT_M = 0.01
"""A first or last leg shorter than this is left out, in metres."""


class SamplingOptions(PlannerOptions):
    """Options of every OMPL planner.

    Attributes:
        checks: number of validity checks after which the planner returns what it has.
    """

    checks: int = Field(default=2000, ge=1, le=1_000_000)


class OptimisingOptions(SamplingOptions):
    """Options of the planners that go on improving a path.

    Attributes:
        settle_checks: a path that has not become shorter by `settle_share` over this many checks is good enough.
        settle_share: share of its length, from 0 to 1. With 0 the planner stops only if nothing improves.
    """

    settle_checks: int = Field(default=150, ge=1, le=1_000_000)
    settle_share: float = Field(default=0.02, ge=0.0, le=1.0)


class BITstarOptions(OptimisingOptions):
    """Options of `ompl-bitstar`.

    Attributes:
        samples_per_batch: few samples give a first path soon, many search more evenly.
    """

    samples_per_batch: int = Field(default=30, ge=1, le=100_000)


class RangeOptions(SamplingOptions):
    """Options of `ompl-rrtconnect`.

    Attributes:
        range_m: longest motion that is added to a tree, in metres; 0 leaves it to OMPL.
    """

    range_m: float = Field(default=0.0, ge=0.0, le=1000.0)


class RRTstarOptions(OptimisingOptions, RangeOptions):
    """Options of `ompl-rrtstar`."""


class _MotionValidator(ob.MotionValidator):
    """Tests the whole segment exactly, as one check: cheaper than sampling points on it, and it misses no corner."""

    def __init__(self, info: ob.SpaceInformation, space: FreeSpace) -> None:
        super().__init__(info)
        self._space = space

    def checkMotion(self, start: ob.RealVectorStateType, end: ob.RealVectorStateType) -> bool:  # noqa: N802
        return self._space.is_open(start[0], start[1], end[0], end[1])


class SamplingPlanner(Planner):
    """Base of OMPL's planners: the free space, the repair of starts and goals, the counting of checks, the seed.

    The planning region is the inside of the fence without the boxes grown by the body's radius and `clearance_m`, and
    without the request's discs. A start that is not free gets a first leg to its nearest free point. A goal that is
    not free is replaced by its nearest free point and a straight last leg to the goal itself: forbidden areas are up to
    the safety modules. Only a goal inside a disc gets no last leg, because a robot stands there, and driving at it
    would only disengage both; the path ends beside it and the result says so.

    If the straight line is free it is the plan, as nothing can be shorter.

    Searches end by counting only, so they do not depend on the host's speed. OMPL seeds random number generators from a
    global one when they are made. That one is reset for each request, and everything that holds a generator is made
    anew, so a plan does not depend on earlier ones.
    """

    options_model: ClassVar[type[PlannerOptions]] = SamplingOptions
    options: SamplingOptions

    def __init__(self, workspace: Workspace, body_radius_m: float, options: PlannerOptions) -> None:
        super().__init__(workspace, body_radius_m, options)
        self._space = space_of(workspace, body_radius_m + options.clearance_m)
        plane = ob.RealVectorStateSpace(2)
        bounds = ob.RealVectorBounds(2)
        low_x, low_y, high_x, high_y = workspace.bounds
        for axis, (low, high) in enumerate(((low_x, high_x), (low_y, high_y))):
            bounds.setLow(axis, low)
            bounds.setHigh(axis, high)
        plane.setBounds(bounds)
        self._plane = plane
        self._info = ob.SpaceInformation(plane)
        is_free = self._space.is_free
        self._info.setStateValidityChecker(lambda state: is_free(state[0], state[1]))
        self._info.setMotionValidator(_MotionValidator(self._info, self._space))
        self._info.setup()

    def plan(self, request: PlanRequest) -> PlanResult:
        space = self._space
        space.begin(request.discs)
        start, goal = self._freed(request.start), self._freed(request.goal)
        if start is None or goal is None:
            place = "start" if start is None else "goal"
            return PlanResult.failed(request.request_id, f"no free point near the {place}", space.checks)
        middle: Sequence[Point] | None = (start, goal)
        if not space.is_open(*start, *goal):
            middle = self._search(start, goal, request.random_seed())
        if middle is None:
            reason = f"no path found within {self.options.checks} checks"
            return PlanResult.failed(request.request_id, reason, space.checks)
        reaches = goal == request.goal or not space.in_disc(*request.goal)
        path = _joined(request.start, middle, request.goal if reaches else goal)
        return PlanResult(request.request_id, path, space.checks, None, reaches)

    @abstractmethod
    def _make(self) -> ob.Planner:
        """Return a new planner; its seed is drawn when it is made."""

    def _begin(self) -> None:
        """Prepare for a search; called before each."""

    def _settled(self, planner: Any) -> bool:
        """Return whether to end the search early; called often."""
        return False

    def _freed(self, point: Point) -> Point | None:
        return point if self._space.is_free(*point) else self._space.nearest_free(*point)

    def _search(self, start: Point, goal: Point, seed: int) -> Sequence[Point] | None:
        space, budget = self._space, self.options.checks
        ou.RNG.setSeed(seed)
        problem = ob.ProblemDefinition(self._info)
        problem.setStartAndGoalStates(self._state(start), self._state(goal))
        problem.setOptimizationObjective(ob.PathLengthOptimizationObjective(self._info))
        planner = self._make()
        planner.setProblemDefinition(problem)
        planner.setup()
        self._begin()
        settled = self._settled
        # The second count ends a planner that spins without checking anything.
        asked = itertools.count()

        def stop() -> bool:
            return space.checks >= budget or settled(planner) or next(asked) >= MAX_ASKED * budget

        planner.solve(ob.PlannerTerminationCondition(stop))
        if not problem.hasExactSolution():
            return None
        found = problem.getSolutionPath()
        points = [(state[0], state[1]) for state in map(found.getState, range(found.getStateCount()))]
        # OMPL copies both ends exactly, but what it interpolates may differ by rounding.
        return space.shortened([start, *points[1:-1], goal])

    def _state(self, point: Point) -> ob.RealVectorStateType:
        state = self._plane.allocState()
        state[0], state[1] = point
        return state


class _OptimisingPlanner(SamplingPlanner):
    """Also stops when a path no longer becomes shorter, judged at checkpoints `settle_checks` apart."""

    options_model: ClassVar[type[PlannerOptions]] = OptimisingOptions
    options: OptimisingOptions

    def _begin(self) -> None:
        self._checkpoint, self._cost = 0, math.inf

    def _settled(self, planner: Any) -> bool:
        if self._space.checks < self._checkpoint:
            return False
        self._checkpoint = self._space.checks + self.options.settle_checks
        cost: float = planner.bestCost().value()
        if math.isinf(cost):
            self._still_nothing(planner)
            return False
        settled = cost >= self._cost * (1.0 - self.options.settle_share)
        self._cost = cost
        return settled

    def _still_nothing(self, planner: Any) -> None:
        """React to having no path yet; called at checkpoints."""


class BITstar(_OptimisingPlanner):
    """Batch Informed Trees (Gammell, Srinivasa and Barfoot, 2015): `ompl-bitstar`."""

    options_model: ClassVar[type[PlannerOptions]] = BITstarOptions
    options: BITstarOptions

    def _make(self) -> ob.Planner:
        planner = og.BITstar(self._info)
        planner.setSamplesPerBatch(self.options.samples_per_batch)
        return planner

    def _still_nothing(self, planner: Any) -> None:
        # Each batch costs the time of all before it: without a path, small batches would take quadratic time.
        planner.setSamplesPerBatch(max(self.options.samples_per_batch, self._space.checks // 2))


class RRTstar(_OptimisingPlanner):
    """RRT* (Karaman and Frazzoli, 2011): `ompl-rrtstar`."""

    options_model: ClassVar[type[PlannerOptions]] = RRTstarOptions
    options: RRTstarOptions

    def _make(self) -> ob.Planner:
        planner = og.RRTstar(self._info)
        planner.setRange(self.options.range_m)
        return planner


class RRTConnect(SamplingPlanner):
    """RRT-Connect (Kuffner and LaValle, 2000), its first path shortened: `ompl-rrtconnect`."""

    options_model: ClassVar[type[PlannerOptions]] = RangeOptions
    options: RangeOptions

    def _make(self) -> ob.Planner:
        planner = og.RRTConnect(self._info)
        planner.setRange(self.options.range_m)
        return planner


def _joined(start: Point, middle: Sequence[Point], goal: Point) -> tuple[Point, ...]:
    """Return the waypoints from start to goal along the free path between, without the start and needless ones.

    Only short legs into or out of space that is not free are left out: the path moves by less than `SHORT_M` there,
    while the free path keeps its clearance exactly.
    """
    inner = list(middle)
    if math.dist(start, inner[0]) < SHORT_M:
        inner.pop(0)
    if inner and math.dist(inner[-1], goal) < SHORT_M:
        inner.pop()
    path = [start, *inner, goal]
    kept = [start]
    for point, after in pairwise(path[1:]):
        if not _between(kept[-1], point, after):
            kept.append(point)
    return (*kept[1:], goal)


def _between(a: Point, b: Point, c: Point) -> bool:
    """Return whether b lies on the straight line from a to c."""
    return math.dist(a, b) + math.dist(b, c) - math.dist(a, c) < 1e-9
