"""Which robots a mission asks a backend for."""

from __future__ import annotations

from soter.config import Mission
from soter.sdk import RobotSpec
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
