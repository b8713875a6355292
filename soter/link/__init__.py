"""Between processes: the ports of a mission beside its supervisor, and the processes of a distributed mission."""

from soter.link.messages import (
    Ask,
    Begin,
    Busy,
    Failed,
    Garbage,
    Moved,
    PeerSeen,
    Refused,
    Started,
    TargetEnded,
    TargetGiven,
    Tick,
    Turn,
)
from soter.link.mission_end import FollowedClock, MissionEnd
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
    "PeerSeen",
    "Refused",
    "Started",
    "SupervisorEnd",
    "TargetEnded",
    "TargetGiven",
    "Tick",
    "Turn",
]
