"""Describes a run for its recording: the mission, the robots' promises, the modules, the versions."""

from __future__ import annotations

import dataclasses
import math
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

import msgspec

from soter.config import MissionFile
from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter.problems import MAX_FILE_BYTES
from soter.record.attachments import MISSION_TOML, SITE_JSON, WORKSPACE_XML, About, ModuleAbout, PeerAbout, RobotAbout
from soter.record.messages import VERSION
from soter.record.samples import state_of
from soter.rta import RobotSupervisor, RTAModule, Timing
from soter.sdk import Capabilities, RobotState

DISTRIBUTIONS: Final = ("soter-rta", "mcap", "msgspec", "numpy", "pydantic", "pybullet", "ompl")


@dataclasses.dataclass(frozen=True)
class Setup:
    """A run, before its first tick.

    Attributes:
        mission: the effective mission.
        robots: the robots' supervisors, each with its tap.
        modules: the declared modules, by robot id.
        capabilities: what the robots promise, by id.
        timings: what these promises add to every horizon, by id.
        peers: what robots of other processes promise, by id.
        accepted_unproved: what the user accepted without proof.
    """

    mission: MissionFile
    workspace: Workspace
    robots: Sequence[RobotSupervisor]
    modules: Mapping[int, Sequence[RTAModule]]
    capabilities: Mapping[int, Capabilities]
    timings: Mapping[int, Timing]
    peers: Mapping[int, Capabilities]
    accepted_unproved: tuple[str, ...] = ()


def describe(setup: Setup) -> About:
    """Return the description of a run before its first tick, with robots by id."""
    mission, modules, capabilities = setup.mission, setup.modules, setup.capabilities
    names = tuple(module.name for module in next(iter(modules.values()), ()))
    return About(
        VERSION,
        mission.model_dump(mode="json", exclude_none=True),
        mission.source or "",
        mission.backend,
        mission.seed,
        mission.base_tick_s,
        all(each.in_process for each in capabilities.values()),
        datetime.now(UTC).isoformat(timespec="seconds"),
        names,
        tuple(
            _robot(each, capabilities[each.robot_id], setup.timings[each.robot_id], modules[each.robot_id])
            for each in setup.robots
        ),
        versions(),
        tuple(PeerAbout(robot_id, _promises(each)) for robot_id, each in setup.peers.items()),
        accepted_unproved=setup.accepted_unproved,
    )


def files(mission: MissionFile, workspace: Workspace) -> dict[str, bytes]:
    """Return the mission file and the workspace file as they are now; unreadable files are left out."""
    polygons = isinstance(workspace, Site)
    found = {SITE_JSON: msgspec.json.encode(workspace.plan)} if isinstance(workspace, Site) else {}
    for name, path in ((MISSION_TOML, mission.source), (WORKSPACE_XML, mission.workspace)):
        if path is None or (polygons and name == WORKSPACE_XML):
            continue
        try:
            with Path(path).open("rb") as stream:
                found[name] = stream.read(MAX_FILE_BYTES)
        except OSError:
            continue
    return found


def versions() -> dict[str, str]:
    """Return the versions of a run's dependencies, by name; those that are not installed are left out."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def capabilities_of(robot: PeerAbout) -> Capabilities:
    """Return what a recorded robot promised.

    Raises:
        ValueError: a promise is missing or unknown.
    """
    given = {name: float(value) if isinstance(value, str) else value for name, value in robot.capabilities.items()}
    try:
        return Capabilities(**given)  # type: ignore[arg-type]
    except TypeError as failure:
        raise ValueError(f"robot {robot.robot_id}: its capabilities are not those of this version: {failure}") from None


def _robot(
    supervisor: RobotSupervisor, capabilities: Capabilities, timing: Timing, modules: Sequence[RTAModule]
) -> RobotAbout:
    sample = supervisor.situation.own
    if not isinstance(sample, RobotState):
        raise TypeError(f"robot {supervisor.robot_id}: a sample is a RobotState, not a {type(sample).__name__}")
    return RobotAbout(
        supervisor.robot_id,
        _promises(capabilities),
        state_of(sample),
        tuple(_module(module, timing) for module in modules),
    )


def _promises(capabilities: Capabilities) -> dict[str, float | bool | str]:
    return {name: _plain(value) for name, value in dataclasses.asdict(capabilities).items() if value is not None}


def _module(module: RTAModule, timing: Timing) -> ModuleAbout:
    edge = module.edge_margin()
    reach = module.reach(timing)
    return ModuleAbout(
        module.name,
        module.delta_s,
        module.dwell_s,
        "" if module.phi_safe is None else module.phi_safe.unit,
        edge if math.isfinite(edge) else None,
        reach if math.isfinite(reach) else None,
    )


def _plain(value: float | bool) -> float | bool | str:
    """Return a promise as a value that JSON can hold."""
    return value if math.isfinite(value) else str(value)
