"""The mission file and its tables, what robots promise, and TOML.

`mission_file` is imported on first use, so that robots and planners in processes of their own start without it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from soter.config.options import validate_options

if TYPE_CHECKING:
    from soter.config.mission_file import MissionFile, draw_charge, load_mission, make_mission, parse_mission

__all__ = ["MissionFile", "draw_charge", "load_mission", "make_mission", "parse_mission", "validate_options"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'soter.config' has no attribute '{name}'")
    return getattr(importlib.import_module("soter.config.mission_file"), name)
