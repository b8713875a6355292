"""The ports between the supervisor's process and the mission's: what crosses, and one end for each side."""

from soter.link.clock import FollowedClock
from soter.link.messages import (
    Ask,
    Begin,
    Busy,
    Failed,
    Garbage,
    Moved,
    Refused,
    Started,
    TargetEnded,
    TargetGiven,
    Tick,
    Turn,
)
from soter.link.mission_end import MissionEnd
from soter.link.supervisor_end import SupervisorEnd

__all__ = [
    "Ask",
    "Begin",
    "Busy",
    "Failed",
    "FollowedClock",
    "Garbage",
    "MissionEnd",
    "Moved",
    "Refused",
    "Started",
    "SupervisorEnd",
    "TargetEnded",
    "TargetGiven",
    "Tick",
    "Turn",
]
