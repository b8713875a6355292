"""Converts samples to their recorded form and back, and changes of control and transitions to theirs."""

from __future__ import annotations

import math
from typing import Final

from msgspec import UNSET

from soter.machine import Transition
from soter.record.messages import AC, StateMessage, SwitchEvent, TransitionEvent
from soter.rta import SwitchRecord
from soter.sdk import Controller, Link, RobotState

DETAIL_CHARACTERS: Final = 200

_LINKS: Final = {link.value: link for link in Link}
_CONTROLLERS: Final = {"": None, **{controller.value: controller for controller in Controller}}


def state_of(sample: RobotState) -> StateMessage:
    """Return a sample as it is recorded."""
    vehicle_stamp_s = sample.vehicle_stamp_s
    return StateMessage(
        sample.stamp_s, sample.x_m, sample.y_m, sample.z_m, sample.heading_rad, sample.vx_m_s, sample.vy_m_s,
        sample.yaw_rate_rad_s, sample.link.value,
        vehicle_stamp_s if math.isfinite(vehicle_stamp_s) else UNSET,
        UNSET if sample.battery is None else sample.battery,
        "" if sample.controller is None else sample.controller.value,
        UNSET if sample.goal_id is None else sample.goal_id,
        UNSET if sample.vz_m_s is None else sample.vz_m_s,
    )  # fmt: skip


def sample_of(state: StateMessage, robot_id: int) -> RobotState:
    """Return the sample that was recorded as a state.

    Raises:
        ValueError: the state names an unknown link or controller.
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


def in_words(transition: Transition) -> TransitionEvent:
    """Return a transition as it is recorded."""
    event, machine = transition.event, transition.machine
    return TransitionEvent(
        transition.time_s, machine.name, machine.id, machine.node, transition.source or "", transition.target or "",
        "" if event is None else type(event).__name__, "" if event is None else repr(event)[:DETAIL_CHARACTERS],
    )  # fmt: skip


def switch_of(record: SwitchRecord) -> SwitchEvent:
    """Return a change of control as it is recorded."""
    return SwitchEvent(
        record.time_s, record.robot_id, record.before or AC, record.after or AC, record.module, record.cause,
        record.joined,
    )  # fmt: skip
