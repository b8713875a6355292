"""SOTER: run-time assurance for robots.

The names below are loaded when they are first used, so that importing the package costs nothing and needs no robot's
library.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.lazy import lazily

__version__ = "0.1.0"

if TYPE_CHECKING:
    from soter.config import load_mission
    from soter.controllers import Controller, Velocity, VelocityController
    from soter.errors import ConfigError, IllFormedModule, SoterError
    from soter.interactive import FinishedRun, run
    from soter.missions import Mission, Robot
    from soter.registry import load_backend
    from soter.rta import Node, PairBound, Region, RTAModule, Situation, SpeedBound, Timing, Topic
    from soter.runner import Run, RunResult, run_mission
    from soter.sdk import Backend, Capabilities, Waypoint
    from soter.stack.module_kit import ModuleKit
    from soter.stack.static_rules import Fence
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "soter.config": ("load_mission",),
            "soter.controllers": ("Controller", "Velocity", "VelocityController"),
            "soter.errors": ("ConfigError", "IllFormedModule", "SoterError"),
            "soter.interactive": ("FinishedRun", "run"),
            "soter.missions": ("Mission", "Robot"),
            "soter.registry": ("load_backend",),
            "soter.rta": ("Node", "PairBound", "RTAModule", "Region", "Situation", "SpeedBound", "Timing", "Topic"),
            "soter.runner": ("Run", "RunResult", "run_mission"),
            "soter.sdk": ("Backend", "Capabilities", "Waypoint"),
            "soter.stack.module_kit": ("ModuleKit",),
            "soter.stack.static_rules": ("Fence",),
        },
    )

__all__ = [
    "Backend",
    "Capabilities",
    "ConfigError",
    "Controller",
    "Fence",
    "FinishedRun",
    "IllFormedModule",
    "Mission",
    "ModuleKit",
    "Node",
    "PairBound",
    "RTAModule",
    "Region",
    "Robot",
    "Run",
    "RunResult",
    "Situation",
    "SoterError",
    "SpeedBound",
    "Timing",
    "Topic",
    "Velocity",
    "VelocityController",
    "Waypoint",
    "load_backend",
    "load_mission",
    "run",
    "run_mission",
]
