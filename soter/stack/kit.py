"""What a robot's machines work with: its port, the other robots' ports, the planner."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from soter.machine import Event, MachineRef
from soter.rta import Port
from soter.sdk import Capabilities, RobotState, Waypoint
from soter.stack.planners import PlanRequest

RobotPort = Port[Waypoint, RobotState]


@dataclass(frozen=True)
class RobotKit:
    """Handed to a robot's machines when they are created.

    Attributes:
        robot_id: the robot.
        port: the AC's access to this robot.
        peers: the ports of the other robots, which are only read for their states.
        submit: sends a request to the planner; the answer comes as `PathPlanned` to the given machine.
        subscribe: has a machine receive the given events of a robot's port; it also says which robot's AC has failed
            if the machine fails.
        seed: the run's seed.
        disc_m: distance that plans keep from robots that stand in the way.
        target_timeout_s: time with the AC in control after which a target is given up.
        arrival_radius_m: distance at which a target counts as reached.
        promised: the robot's capabilities.
        peers_v_max_m_s: top speed of the fastest of the other robots; infinite if that is not known.
    """

    robot_id: int
    port: RobotPort
    peers: Mapping[int, RobotPort]
    submit: Callable[[PlanRequest, MachineRef], None]
    subscribe: Callable[[int, MachineRef, tuple[type[Event], ...]], None]
    seed: int
    disc_m: float
    target_timeout_s: float
    arrival_radius_m: float
    promised: Capabilities
    peers_v_max_m_s: float = math.inf
