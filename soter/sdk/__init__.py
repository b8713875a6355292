"""The narrow interface between SOTER and robots.

Its names are loaded when they are first used: a process that needs to know a sample starts without all the rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.lazy import lazily

if TYPE_CHECKING:
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
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "soter.sdk.backend": (
                "INTERFACE_VERSION",
                "RULES",
                "Backend",
                "BackendConfig",
                "Fleet",
                "Truth",
                "TruthReport",
                "Violation",
            ),
            "soter.sdk.capabilities": ("Capabilities",),
            "soter.sdk.goal": (
                "Goal",
                "Switch",
            ),
            "soter.sdk.robot": ("Robot",),
            "soter.sdk.values": (
                "MAX_COORDINATE_M",
                "Controller",
                "FaultReport",
                "GoalStatus",
                "HeldMission",
                "Link",
                "RobotSpec",
                "RobotState",
                "RuleLimits",
                "Waypoint",
            ),
        },
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
