"""Missions: scripts and missions of machines, and the surveillance mission, which is one of these."""

from pathlib import Path
from typing import Final

from soter.missions.mission import Mission
from soter.missions.names import checked, make_mission, mission_class, placed
from soter.missions.script import Arrival, Robot, ScriptFailed
from soter.missions.stage import Stage

ROOM: Final = Path(__file__).parent / "room.toml"
"""The mission file of a run without one: a room without boxes, two robots, and no extra to install."""

__all__ = [
    "ROOM",
    "Arrival",
    "Mission",
    "Robot",
    "ScriptFailed",
    "Stage",
    "checked",
    "make_mission",
    "mission_class",
    "placed",
]
