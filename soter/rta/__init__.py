"""Run-time assurance: topics, nodes, declared safety modules, decision modules, ports, the supervisor."""

from soter.rta.assumptions import Assumption, AssumptionLog, Breach
from soter.rta.decision import DecisionModule, Permission
from soter.rta.fleet import Supervisor
from soter.rta.models import DischargeBound, PairBound, ReachModel, SpeedBound
from soter.rta.module import Region, RTAModule, Timing
from soter.rta.monitors import ModuleMonitor, PeerMonitor
from soter.rta.port import ControlReport, GoalReport, Port, Report, Request
from soter.rta.situation import Mode, Sample, Situation
from soter.rta.supervisor import SUPERVISOR, Actuator, RobotSupervisor, SwitchRecord, Watch
from soter.rta.topics import Node, Topic

__all__ = [
    "SUPERVISOR",
    "Actuator",
    "Assumption",
    "AssumptionLog",
    "Breach",
    "ControlReport",
    "DecisionModule",
    "DischargeBound",
    "GoalReport",
    "Mode",
    "ModuleMonitor",
    "Node",
    "PairBound",
    "PeerMonitor",
    "Permission",
    "Port",
    "RTAModule",
    "ReachModel",
    "Region",
    "Report",
    "Request",
    "RobotSupervisor",
    "Sample",
    "Situation",
    "SpeedBound",
    "Supervisor",
    "SwitchRecord",
    "Timing",
    "Topic",
    "Watch",
]
