"""What the machines of one robot work with: its port, the others' ports, the planner."""

from __future__ import annotations

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
        robot_id: whose.
        port: the AC's rights on this robot.
        peers: the ports of the other robots, read for where they are.
        submit: asks the planner; the answer comes as `PathPlanned` to the machine named.
        subscribe: names a machine that is to be told of what a robot's port reports, and of which events;
            it also says whose machine it is, should it fail.
        seed: of the run.
        disc_m: distance that plans keep from robots that stand in the way.
        target_timeout_s: time with the AC in control after which a target is given up.
        arrival_radius_m: how near is reached.
        promised: what the robot promises.
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
