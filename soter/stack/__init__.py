"""The stack: the mission's machines on one side of the ports, safety modules and safe controllers on the other."""

from soter.stack.actuator import PortForwarder, RobotActuator
from soter.stack.assembly import HOME_CLEARANCE_M, ORDER, SafetySide, assemble, enabled
from soter.stack.kit import RobotKit
from soter.stack.task_planner import TaskPlanner, Tasks

__all__ = [
    "HOME_CLEARANCE_M",
    "ORDER",
    "PortForwarder",
    "RobotActuator",
    "RobotKit",
    "SafetySide",
    "TaskPlanner",
    "Tasks",
    "assemble",
    "enabled",
]
