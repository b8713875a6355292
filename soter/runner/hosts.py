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
        mission: its `ac` says who the ACs are.
        workspace: where.
        body_radius_m: of the robots, by id.
        virtual_time: time does not pass by itself, so that what is worked out may not depend on the host.
        part: which part of the mission is in this process; None for all of it.

    Raises:
        ConfigError: no such AC, or options that it does not allow; nothing has moved.
        BackendError: what joins the processes cannot be opened.
    """
    if mission.ac != MISSION:
        return ControllerHost(mission, workspace, part)
    return MachineHost(mission, workspace, body_radius_m, virtual_time=virtual_time, part=part)
