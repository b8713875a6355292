"""Planners that misbehave for robot 1 and serve the others: what such a planner may cost is a plan, not safety."""

from __future__ import annotations

import time
from typing import cast

from soter.stack.planners import Planner, PlanRequest, PlanResult

VICTIM = 1
SLOW_S = 12.0


class _Misbehaving(Planner):
    """A straight-line planner with a grudge."""

    def plan(self, request: PlanRequest) -> PlanResult:
        if request.robot_id == VICTIM:
            return self.misbehave(request)
        return PlanResult(request.request_id, (request.goal,), checks=1)

    def misbehave(self, request: PlanRequest) -> PlanResult:
        """Do what a planner must not do."""
        raise NotImplementedError


class Raises(_Misbehaving):
    """Raises."""

    def misbehave(self, request: PlanRequest) -> PlanResult:
        raise RuntimeError("this planner never works")


class Garbage(_Misbehaving):
    """Returns what is no plan."""

    def misbehave(self, request: PlanRequest) -> PlanResult:
        nonsense = {"path": [float("nan"), "north", None], "request_id": -request.request_id}
        return cast(PlanResult, nonsense)


class Slow(_Misbehaving):
    """Answers, after longer than anybody waits."""

    def misbehave(self, request: PlanRequest) -> PlanResult:
        time.sleep(SLOW_S)
        return PlanResult(request.request_id, (request.goal,), checks=1)


class NeverReturns(_Misbehaving):
    """Computes for ever."""

    def misbehave(self, request: PlanRequest) -> PlanResult:
        while True:
            pass
