"""SOTER: run-time assurance for robots.

The names below are loaded when they are first used, so that importing the package costs nothing and needs no robot's
library.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from soter.config import load_mission
    from soter.controllers import Controller, Velocity, VelocityController
    from soter.errors import ConfigError, IllFormedModule, SoterError
    from soter.interactive import run
    from soter.machine import Event, Goto, Machine, Runtime, State, Stay
    from soter.missions import Mission, Robot
    from soter.registry import load_backend
    from soter.rta import Node, Region, RTAModule, Situation, SpeedBound, Timing, Topic
    from soter.runner import RunResult, run_mission
    from soter.sdk import Backend, Capabilities, Waypoint
    from soter.stack.static_rules import Fence

_HOMES = {
    "soter.config": ("load_mission",),
    "soter.controllers": ("Controller", "Velocity", "VelocityController"),
    "soter.errors": ("ConfigError", "IllFormedModule", "SoterError"),
    "soter.interactive": ("run",),
    "soter.machine": ("Event", "Goto", "Machine", "Runtime", "State", "Stay"),
    "soter.missions": ("Mission", "Robot"),
    "soter.registry": ("load_backend",),
    "soter.rta": ("Node", "RTAModule", "Region", "Situation", "SpeedBound", "Timing", "Topic"),
    "soter.runner": ("RunResult", "run_mission"),
    "soter.sdk": ("Backend", "Capabilities", "Waypoint"),
    "soter.stack.static_rules": ("Fence",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Backend",
    "Capabilities",
    "ConfigError",
    "Controller",
    "Event",
    "Fence",
    "Goto",
    "IllFormedModule",
    "Machine",
    "Mission",
    "Node",
    "RTAModule",
    "Region",
    "Robot",
    "RunResult",
    "Runtime",
    "Situation",
    "SoterError",
    "SpeedBound",
    "State",
    "Stay",
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


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module 'soter' has no attribute '{name}'")
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
