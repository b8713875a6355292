"""SOTER: run-time assurance for robots.

The names below are loaded when they are first used, so that importing the package costs nothing and needs no robot's
library.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from soter.config import Mission, load_mission
    from soter.errors import ConfigError, IllFormedModule, SoterError
    from soter.machine import Event, Goto, Halt, Machine, Raise, Runtime, Spec, State, Stay
    from soter.registry import load_backend
    from soter.rta import Node, PairBound, Region, RTAModule, Situation, SpeedBound, Timing, Topic
    from soter.runner import Run, RunResult, run_mission
    from soter.sdk import Backend, Capabilities, Robot
    from soter.stack.static_rules import Fence

_HOMES = {
    "soter.config": ("Mission", "load_mission"),
    "soter.errors": ("ConfigError", "IllFormedModule", "SoterError"),
    "soter.machine": ("Event", "Goto", "Halt", "Machine", "Raise", "Runtime", "Spec", "State", "Stay"),
    "soter.registry": ("load_backend",),
    "soter.rta": ("Node", "PairBound", "RTAModule", "Region", "Situation", "SpeedBound", "Timing", "Topic"),
    "soter.runner": ("Run", "RunResult", "run_mission"),
    "soter.sdk": ("Backend", "Capabilities", "Robot"),
    "soter.stack.static_rules": ("Fence",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Backend",
    "Capabilities",
    "ConfigError",
    "Event",
    "Fence",
    "Goto",
    "Halt",
    "IllFormedModule",
    "Machine",
    "Mission",
    "Node",
    "PairBound",
    "RTAModule",
    "Raise",
    "Region",
    "Robot",
    "Run",
    "RunResult",
    "Runtime",
    "Situation",
    "SoterError",
    "Spec",
    "SpeedBound",
    "State",
    "Stay",
    "Timing",
    "Topic",
    "load_backend",
    "load_mission",
    "run_mission",
]


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module 'soter' has no attribute '{name}'")
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
