"""Makes the mission host that a mission asks for, and says before that whether there is one."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from soter import controllers, missions
from soter.config import MissionFile, validate_options
from soter.controllers import MISSION
from soter.geometry.workspace import Workspace
from soter.problems import dotted
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


def check_names(mission: MissionFile) -> None:
    """Check what a mission names for its ACs: its script or controller, its planner, and their options.

    Nothing is made of them. A planner whose library is not installed here passes.

    Raises:
        ConfigError: there is no such mission, controller or planner, it does not allow an option, or the mission cannot
            be done in the workspace.
        BackendError: the mission's backend cannot be loaded.
    """
    if mission.ac != MISSION:
        controllers.options_of(mission, controllers.controller_class(mission))
        return
    workspace = mission.read_workspace()
    promised = promises_of(mission, workspace)
    missions.checked(mission, workspace, {robot_id: each.body_radius_m for robot_id, each in promised.items()})
    try:
        planner = planner_class(mission.planner, partial(mission.refusal, "planner"))
    except PlannerUnavailable:
        return
    validate_options(
        planner.options_model, mission.planners.get(mission.planner, {}), mission.source,
        dotted("planners", mission.planner), overridden=mission.overridden,
    )  # fmt: skip
