"""Makes the ACs' side that a mission asks for."""

from __future__ import annotations

from collections.abc import Mapping

from soter.config import MissionFile
from soter.controllers import MISSION
from soter.geometry.workspace import Workspace
from soter.runner.ac_side import AcSide
from soter.runner.controller_side import ControllerSide
from soter.runner.mission_side import MissionSide
from soter.runner.part import Part


def make_ac_side(
    mission: MissionFile,
    workspace: Workspace,
    body_radius_m: Mapping[int, float],
    *,
    virtual_time: bool,
    process: str | None = None,
) -> AcSide:
    """Return the ACs' side of a mission, not yet begun.

    Args:
        mission: its `ac` says who the ACs are.
        workspace: where.
        body_radius_m: of the robots, by id.
        virtual_time: time does not pass by itself, so that what is worked out may not depend on the host.
        process: which process of a distributed mission this is; None for a mission in one process.

    Raises:
        ConfigError: no such AC, or options that it does not allow; nothing has moved.
        BackendError: what joins the processes cannot be opened.
    """
    if process is not None:
        part = Part.of(mission, workspace, process)
        return MissionSide(
            mission, workspace, body_radius_m, virtual_time=virtual_time, part=part, bus=part.open_bus()
        )  # fmt: skip
    if mission.ac != MISSION:
        return ControllerSide(mission, workspace)
    return MissionSide(mission, workspace, body_radius_m, virtual_time=virtual_time)
