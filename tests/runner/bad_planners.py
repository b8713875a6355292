"""Planners that nobody should trust; loaded by name in a worker process."""

from __future__ import annotations

from typing import Any

from soter.stack.planners import Planner, PlanRequest, PlanResult


class Raises(Planner):
    """Fails at every request."""

    def plan(self, request: PlanRequest) -> PlanResult:
        raise RuntimeError("no")


class Garbage(Planner):
    """Answers with what is no plan."""

    def plan(self, request: PlanRequest) -> Any:
        return "left, then right"


class Outside(Planner):
    """Plans to far outside the fence, through whatever is on the way."""

    def plan(self, request: PlanRequest) -> PlanResult:
        return PlanResult(request.request_id, ((-50.0, 50.0),), 1)
