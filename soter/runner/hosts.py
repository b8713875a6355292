"""Makes the mission host that a mission asks for, and tries whether it can be made."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from soter import missions
from soter.config import MissionFile
from soter.controllers import MISSION, refuse_unknown_tables
from soter.geometry.workspace import Workspace
from soter.registry import in_virtual_time
from soter.runner.controller_host import ControllerHost
from soter.runner.machine_host import MachineHost
from soter.runner.mission_host import MissionHost
from soter.runner.part import Part
from soter.specs import promises_of
from soter.stack.planners.names import PlannerUnavailable, planner_class


def make_host(
    mission: MissionFile,
    workspace: Workspace,
    body_radius_m: Mapping[int, float],
    *,
    virtual_time: bool,
    part: Part | None = None,
) -> MissionHost:
    """Return the mission host of a mission, not yet begun.

    Args:
        mission: its `ac` says what the ACs are.
        workspace: fence, boxes, chargers.
        body_radius_m: body radii of the robots, by id.
        virtual_time: whether the run is in virtual time, where results must not depend on the host's speed.
        part: this process's part of the mission; None for all of it.

    Raises:
        ConfigError: there is no such AC, or it does not allow an option; nothing has moved.
        BackendError: the bus between the processes cannot be opened.
    """
    if mission.ac != MISSION:
        return ControllerHost(mission, workspace, part)
    return MachineHost(mission, workspace, body_radius_m, virtual_time=virtual_time, part=part)


def check_acs(mission: MissionFile) -> None:
    """Make what a mission names for its ACs, as a run does, and drop it: its script or controllers, and its planner.

    Of a distributed mission on a wire every process's part is made, but the bus between them is not opened. A planner
    whose library is not installed here passes.

    Raises:
        ConfigError: there is no such mission, controller, adversary, planner or bus, one does not allow an option or
            cannot be made, or the mission cannot be done in the workspace.
        BackendError: the mission's backend cannot be loaded, or the planner's worker cannot be started.
    """
    refuse_unknown_tables(mission)
    workspace = mission.read_workspace()
    parts: list[Part | None] = [None]
    if mission.distribution.processes and not in_virtual_time(mission.backend):
        processes = mission.distribution.processes.items()
        acting = [name for name, table in processes if table.robots or mission.ac == MISSION]
        parts = [Part.of(mission, workspace, name) for name in acting]
    for part in parts:
        if part is not None:
            part.bus_options()
        if mission.ac != MISSION:
            ControllerHost(mission, workspace, part).close()
    if mission.ac != MISSION:
        return
    promised = promises_of(mission, workspace)
    radii_m = {robot_id: each.body_radius_m for robot_id, each in promised.items()}
    try:
        planner_class(mission.planner, partial(mission.refusal, "planner"))
    except PlannerUnavailable:
        missions.make_mission(mission, workspace, radii_m)
        return
    host = MachineHost(mission, workspace, radii_m, virtual_time=True)
    try:
        host.ready()
    finally:
        host.close()
