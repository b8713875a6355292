"""Motion planners by name; `service` runs them where they can do no harm."""

from soter.stack.planners.base import (
    CHECK_COST_S,
    MAX_COST_S,
    MAX_WAYPOINTS,
    Planner,
    PlannerOptions,
    PlanRequest,
    PlanResult,
    Point,
)
from soter.stack.planners.names import (
    BUILT_IN,
    DEFAULT_PLANNER,
    PlannerSpec,
    PlannerUnavailable,
    check_name,
    planner_class,
)

__all__ = [
    "BUILT_IN",
    "CHECK_COST_S",
    "DEFAULT_PLANNER",
    "MAX_COST_S",
    "MAX_WAYPOINTS",
    "PlanRequest",
    "PlanResult",
    "Planner",
    "PlannerOptions",
    "PlannerSpec",
    "PlannerUnavailable",
    "Point",
    "check_name",
    "planner_class",
]
