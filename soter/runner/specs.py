"""Which robots a mission asks a backend for, and with which options."""

from __future__ import annotations

import logging

from soter.config import Mission, validate_options
from soter.errors import ConfigError, nearest
from soter.faults import read_faults
from soter.faults.robot import widened
from soter.registry import backend_names
from soter.sdk import Backend, BackendConfig, Capabilities, RobotSpec
from soter.stack.planners.names import check_name
from soter.workspace import Workspace

logger = logging.getLogger(__name__)


def robot_specs(mission: Mission, workspace: Workspace) -> list[RobotSpec]:
    """Return the robots of the workspace, each with the mission's battery."""
    battery = mission.battery
    return [
        RobotSpec(
            place.id, place.x_m, place.y_m, place.heading_rad, mission.initial_charge(place.id),
            battery.drive_s, battery.idle_s, battery.charge_s, f"robot{place.id}",
        )
        for place in workspace.robots
    ]  # fmt: skip


def read_options(backend: type[Backend], mission: Mission, workspace: Workspace) -> BackendConfig:
    """Return the mission's options of a backend, checked by its model.

    Raises:
        ConfigError: an option that the backend does not have or allow; the message names its key. Or a table of
            options for a backend or a planner that there is not.
    """
    _refuse_misspelt_tables(mission)
    return validate_options(
        backend.config_model,
        mission.backends.get(mission.backend, {}),
        mission.source,
        f"backends.{mission.backend}",
        {"workspace": workspace, "seed": mission.seed},
        mission.overridden,
    )


def promises(
    backend: type[Backend], config: BackendConfig, mission: Mission, workspace: Workspace
) -> dict[int, Capabilities]:
    """Return what the robots of a mission promise, by id, under the faults that they are said to have.

    Raises:
        ConfigError: a fault that is not allowed.
    """
    declared = backend.promises(config)
    ids = [place.id for place in workspace.robots]
    faults = read_faults(mission, ids)
    return {
        robot_id: widened(
            declared,
            [each.made_for(robot_id, mission.seed, mission.base_tick_s) for each in faults if each.hits(robot_id)],
        )
        for robot_id in ids
    }


def _refuse_misspelt_tables(mission: Mission) -> None:
    """Look at the options of backends and planners that the mission does not use: nobody else would.

    What they promise would be taken for granted by whoever wrote them. A backend that is not installed here may have a
    table all the same, which is only warned of.

    Raises:
        ConfigError: there is no such planner, or the backend's name is nearly that of another.
    """
    known = backend_names()
    for name in mission.backends:
        if name in known or ":" in name:
            continue
        key, close = f"backends.{name}", nearest(name, known)
        problem = f"no backend of that name is installed{close}; there are {', '.join(known)}"
        if close:
            raise mission.refusal(key, problem)
        logger.warning("%s is not used: %s", key, problem)
    for name in mission.planners:
        try:
            check_name(name)
        except ConfigError as failure:
            raise mission.refusal(f"planners.{name}", str(failure)) from failure
