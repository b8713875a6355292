"""The mission file and its tables, what robots promise, and TOML.

`mission_file` is imported on first use, so that robots and planners in processes of their own start without it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.config.options import validate_options
from soter.lazy import lazily

if TYPE_CHECKING:
    from soter.config.mission_file import MissionFile, draw_charge
    from soter.config.reading import load_mission, make_mission, parse_mission

__all__ = ["MissionFile", "draw_charge", "load_mission", "make_mission", "parse_mission", "validate_options"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "soter.config.mission_file": ("MissionFile", "draw_charge"),
            "soter.config.reading": ("load_mission", "make_mission", "parse_mission"),
        },
    )
