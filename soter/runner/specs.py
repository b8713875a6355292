"""Which robots a mission asks a backend for, and with which options."""

from __future__ import annotations

from soter.config import Mission, validate_options
from soter.faults import read_faults
from soter.faults.robot import widened
from soter.sdk import Backend, BackendConfig, Capabilities, RobotSpec
from soter.workspace import Workspace


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
        ConfigError: an option that the backend does not have or allow; the message names its key.
    """
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
