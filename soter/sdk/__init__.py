"""The narrow interface between SOTER and robots."""

from soter.sdk.backend import (
    INTERFACE_VERSION,
    RULES,
    Backend,
    BackendConfig,
    Fleet,
    Truth,
    TruthReport,
    Violation,
)
from soter.sdk.capabilities import Capabilities
from soter.sdk.goal import Goal, Switch
from soter.sdk.robot import Robot
from soter.sdk.values import (
    MAX_COORDINATE_M,
    Controller,
    FaultReport,
    GoalStatus,
    HeldMission,
    Link,
    RobotSpec,
    RobotState,
    RuleLimits,
    Waypoint,
)

__all__ = [
    "INTERFACE_VERSION",
    "MAX_COORDINATE_M",
    "RULES",
    "Backend",
    "BackendConfig",
    "Capabilities",
    "Controller",
    "FaultReport",
    "Fleet",
    "Goal",
    "GoalStatus",
    "HeldMission",
    "Link",
    "Robot",
    "RobotSpec",
    "RobotState",
    "RuleLimits",
    "Switch",
    "Truth",
    "TruthReport",
    "Violation",
    "Waypoint",
]
