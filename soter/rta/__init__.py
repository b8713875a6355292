"""Run-time assurance: topics, nodes, declared safety modules, decision modules, ports, the supervisor."""

from soter.rta.actuator import Actuator
from soter.rta.assumptions import Assumption, AssumptionLog, Breach, Worst
from soter.rta.decision import BEGINS_S, DecisionModule, Drivers
from soter.rta.fleet import PEER_SILENT_S, RemotePeer, StillPeers, Supervisor
from soter.rta.models import (
    Directed,
    DirectedReach,
    DischargeBound,
    Motion,
    PairBound,
    PairsBound,
    PointMassBound,
    ReachModel,
    SpeedAccelerationBound,
    SpeedBound,
    Threat,
    UnicycleBound,
)
from soter.rta.module import Region, RTAModule, Timing
from soter.rta.monitors import Assumed, ModuleMonitor, PeerMonitor
from soter.rta.port import ControlReport, GoalReport, Port, Report, Request
from soter.rta.situation import Sample, Situation
from soter.rta.supervisor import RobotSupervisor
from soter.rta.topics import Node, Topic
from soter.rta.watch import SUPERVISOR, SwitchRecord, Watch

__all__ = [
    "BEGINS_S",
    "PEER_SILENT_S",
    "SUPERVISOR",
    "Actuator",
    "Assumed",
    "Assumption",
    "AssumptionLog",
    "Breach",
    "ControlReport",
    "DecisionModule",
    "Directed",
    "DirectedReach",
    "DischargeBound",
    "Drivers",
    "GoalReport",
    "ModuleMonitor",
    "Motion",
    "Node",
    "PairBound",
    "PairsBound",
    "PeerMonitor",
    "PointMassBound",
    "Port",
    "RTAModule",
    "ReachModel",
    "Region",
    "RemotePeer",
    "Report",
    "Request",
    "RobotSupervisor",
    "Sample",
    "Situation",
    "SpeedAccelerationBound",
    "SpeedBound",
    "StillPeers",
    "Supervisor",
    "SwitchRecord",
    "Threat",
    "Timing",
    "Topic",
    "UnicycleBound",
    "Watch",
    "Worst",
]
