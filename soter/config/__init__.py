"""The mission file and its tables, what robots promise, and TOML."""

from soter.config.mission_file import MissionFile, draw_charge, load_mission, make_mission, parse_mission
from soter.config.options import validate_options

__all__ = ["MissionFile", "draw_charge", "load_mission", "make_mission", "parse_mission", "validate_options"]
