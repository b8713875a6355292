"""Makes the mission host that a mission asks for."""

from __future__ import annotations

from collections.abc import Mapping

from soter.config import MissionFile
from soter.controllers import MISSION
from soter.geometry.workspace import Workspace
from soter.runner.controller_host import ControllerHost
from soter.runner.machine_host import MachineHost
from soter.runner.mission_host import MissionHost
from soter.runner.part import Part


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
