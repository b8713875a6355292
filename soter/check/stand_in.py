"""Simulated stand-ins for a mission's robots in trials, which promise what those promise, and no more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from soter.config import MissionFile
from soter.faults import FaultTable, read_faults
from soter.geometry.workspace import Workspace
from soter.registry import load_backend
from soter.sdk import Capabilities
from soter.specs import asked, read_options

_BUILT = ("v_max_m_s", "brake_m_s2", "yaw_rate_max_rad_s", "body_radius_m")
_LARGEST = (
    "latency_s", "sample_age_s", "jitter_s", "setpoint_period_s", "lease_s", "tube_m", "overshoot_m",
    "position_noise_m", "accel_m_s2", "speed_noise_m_s", "heading_noise_rad",
)  # fmt: skip
_BOTH = ("reverses", "reports_battery", "reports_controller", "pivots_first")


def stand_ins(mission: MissionFile, workspace: Workspace, robot: Capabilities) -> dict[int, Capabilities]:
    """Return the promises for simulated robots that stand in for a mission's robots, by id.

    The stand-ins are built like the mission's robots; each other figure is the worse of theirs and those robots'.

    Raises:
        ConfigError: the backend does not allow an option.
        BackendError: the mission's backend cannot be loaded.
    """
    backend = load_backend(mission.backend, to_open=False)
    promised = asked(backend, read_options(backend, mission, workspace), mission, workspace)
    return {robot_id: _worse(each, robot) for robot_id, each in promised.items()}


def _worse(promise: Capabilities, robot: Capabilities) -> Capabilities:
    changes: dict[str, Any] = {name: getattr(promise, name) for name in _BUILT}
    changes |= {name: getattr(robot, name) and getattr(promise, name) for name in _BOTH}
    for name in _LARGEST:
        both = (getattr(robot, name), getattr(promise, name))
        changes[name] = None if None in both else max(both)
    return replace(robot, **changes)


def declared_faults(mission: MissionFile, workspace: Workspace) -> Sequence[FaultTable]:
    """Return the faults of a mission that its robots' promises allow for.

    Undeclared faults are left out: a trial is about robots that keep their promises.

    Raises:
        ConfigError: a fault is not allowed.
    """
    faults = read_faults(mission, [place.id for place in workspace.robots])
    return [table for table in faults if table.options.declared]
