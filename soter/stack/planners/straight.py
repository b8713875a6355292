"""The simplest planner: drive at the goal."""

from __future__ import annotations

from soter.stack.planners.base import Planner, PlanRequest, PlanResult


class StraightLine(Planner):
    """Answers every request with its goal, whatever stands in the way; it costs one check.

    The safety modules are the only thing between the robot and the boxes, which is what makes it useful: the
    cheapest application, and one that needs its protection.
    """

    def plan(self, request: PlanRequest) -> PlanResult:
        return PlanResult(request.request_id, (request.goal,), checks=1)
