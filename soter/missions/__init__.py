"""What robots are to do: scripts and missions of machines, and the surveillance mission, which is one of these."""

from pathlib import Path
from typing import Final

from soter.missions.mission import Mission
from soter.missions.names import BUILT_IN, make_mission, mission_class
from soter.missions.script import Arrival, Peer, Robot, ScriptFailed
from soter.missions.stage import Stage

ROOM: Final = Path(__file__).parent / "room.toml"
"""The mission file of a run that has none: a room without boxes, two robots, and nothing that has to be installed."""

__all__ = [
    "BUILT_IN",
    "ROOM",
    "Arrival",
    "Mission",
    "Peer",
    "Robot",
    "ScriptFailed",
    "Stage",
    "make_mission",
    "mission_class",
]
