"""Simulated robots that stand in for those of a mission in trials: they promise what those promise, and no more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

from pydantic import InstanceOf

from soter.config import Mission
from soter.faults import Command, Fault, FaultOptions, FaultTable, Passage, read_faults
from soter.registry import load_backend
from soter.runner.specs import read_options
from soter.sdk import Capabilities
from soter.workspace import Workspace

_LARGEST = (
    "latency_s", "sample_age_s", "jitter_s", "setpoint_period_s", "lease_s", "tube_m", "overshoot_m",
    "position_noise_m", "body_radius_m", "yaw_rate_max_rad_s", "accel_m_s2", "speed_noise_m_s", "heading_noise_rad",
)  # fmt: skip
_BOTH = ("reverses", "reports_battery", "reports_controller", "pivots_first")


class PromiseOptions(FaultOptions):
    """What a robot is to promise.

    Attributes:
        promise: that of the robot that it stands in for.
    """

    promise: InstanceOf[Capabilities]


class Promise(Fault[PromiseOptions]):
    """Spoils nothing: the robot promises the worse of its own figures and another's, and drives no faster than that."""

    options_model: ClassVar[type[FaultOptions]] = PromiseOptions

    def widened(self, capabilities: Capabilities) -> Capabilities:
        promise = self.options.promise
        changes: dict[str, Any] = {name: getattr(capabilities, name) and getattr(promise, name) for name in _BOTH}
        for name in _LARGEST:
            both = (getattr(capabilities, name), getattr(promise, name))
            changes[name] = None if None in both else max(both)
        brake_m_s2 = min(capabilities.brake_m_s2, promise.brake_m_s2)
        return replace(capabilities, v_max_m_s=promise.v_max_m_s, brake_m_s2=brake_m_s2, **changes)

    def command(self, time_s: float, command: Command) -> Sequence[Passage]:
        target, most_m_s = command.target, self.options.promise.v_max_m_s
        if target is None or (target.speed_m_s or math.inf) <= most_m_s:
            return (Passage(command),)
        return (Passage(replace(command, target=target._replace(speed_m_s=most_m_s))),)


def stand_ins(mission: Mission, workspace: Workspace, robot: Capabilities) -> Sequence[FaultTable]:
    """Return what has to stand before simulated robots so that they promise what a mission's own robots promise.

    The mission's declared faults are among it, since what they widen is part of the promise. Those that are not
    declared are left out: a trial is about robots that keep their promises.

    Args:
        mission: the mission.
        workspace: its robots.
        robot: what the simulated robots promise.

    Raises:
        ConfigError: an option of the backend, or a fault, that is not allowed.
        BackendError: the mission's backend cannot be loaded.
    """
    backend = load_backend(mission.backend, to_open=False)
    promise = backend.promises(read_options(backend, mission, workspace))
    faults = read_faults(mission, [place.id for place in workspace.robots])
    declared = [table for table in faults if table.options.declared]
    if _differs(promise, robot):
        options = PromiseOptions(kind="promise", promise=promise)
        return (FaultTable(len(mission.fault), Promise, options), *declared)
    return declared


def _differs(promise: Capabilities, robot: Capabilities) -> bool:
    names = ("v_max_m_s", "brake_m_s2", *_BOTH, *_LARGEST)
    return any(getattr(promise, name) != getattr(robot, name) for name in names)
