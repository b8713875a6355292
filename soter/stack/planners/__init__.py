"""Motion planners by name; `service` runs them in processes of their own, where they can do no harm."""

from soter.stack.planners.base import Planner, PlanRequest, PlanResult
from soter.stack.planners.names import PlannerSpec

__all__ = [
    "PlanRequest",
    "PlanResult",
    "Planner",
    "PlannerSpec",
]
