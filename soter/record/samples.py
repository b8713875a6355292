"""Samples of the narrow interface as recorded states, and back."""

from __future__ import annotations

import math
from typing import Final

from msgspec import UNSET

from soter.record.messages import State
from soter.sdk import Controller, Link, RobotState

_LINKS: Final = {link.value: link for link in Link}
_CONTROLLERS: Final = {"": None, **{controller.value: controller for controller in Controller}}


def state_of(sample: RobotState) -> State:
    """Return a sample as it is recorded."""
    vehicle_stamp_s = sample.vehicle_stamp_s
    return State(
        sample.stamp_s, sample.x_m, sample.y_m, sample.z_m, sample.heading_rad, sample.vx_m_s, sample.vy_m_s,
        sample.yaw_rate_rad_s, sample.link.value,
        vehicle_stamp_s if math.isfinite(vehicle_stamp_s) else UNSET,
        UNSET if sample.battery is None else sample.battery,
        "" if sample.controller is None else sample.controller.value,
        UNSET if sample.goal_id is None else sample.goal_id,
        UNSET if sample.vz_m_s is None else sample.vz_m_s,
    )  # fmt: skip


def sample_of(state: State, robot_id: int) -> RobotState:
    """Return a recorded state as the sample that it was.

    Raises:
        ValueError: it names a link or a controller that there is not.
    """
    if state.link not in _LINKS or state.controller not in _CONTROLLERS:
        raise ValueError(f"no sample has the link '{state.link}' and the controller '{state.controller}'")
    return RobotState(
        robot_id, state.stamp_s, math.nan if state.vehicle_stamp_s is UNSET else state.vehicle_stamp_s, state.x_m,
        state.y_m, state.z_m, state.heading_rad, state.vx_m_s, state.vy_m_s, state.yaw_rate_rad_s,
        None if state.battery is UNSET else state.battery, _CONTROLLERS[state.controller],
        None if state.goal_id is UNSET else state.goal_id, _LINKS[state.link],
        None if state.vz_m_s is UNSET else state.vz_m_s,
    )  # fmt: skip
