"""Samples from messages: position and attitude that were measured at one moment, in the workspace frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from soter.adapters.mavlink.frames import Frame, turned_rad
from soter.adapters.mavlink.link import Inbox
from soter.adapters.mavlink.timesync import TimeSync
from soter.sdk import Controller, Link, RobotState

_UNKNOWN_V: Final = 0xFFFF * 1e-3
_TRUSTED: Final = 0.02
"""A reading that is further below than this is believed at once: the battery falls faster than it should."""


class Charge:
    """Follows one battery by what autopilots say of it: whole percents, or nothing, or a voltage.

    A percentage that is rounded down jumps by one from time to time. What is returned falls to it no faster than the
    battery can, so that it is never more than the true charge and has no jumps: decision modules take a jump for a
    battery that breaks its promise.

    Args:
        drive_s: time from full to empty at driving power.
        empty_v: voltage at which it is empty, for autopilots that do not count; None where that is not known.
        full_v: voltage at which it is full.
    """

    def __init__(self, drive_s: float, empty_v: float | None = None, full_v: float | None = None) -> None:
        self._per_s: Final = 1.0 / drive_s
        self._empty_v: Final = empty_v
        self._full_v: Final = full_v
        self._value: float | None = None
        self._stamp_s = -math.inf

    def read(self, sys_status: Any, stamp_s: float) -> float | None:
        """Return the charge from 0 to 1 at some time; None where it is not known.

        Args:
            sys_status: the latest SYS_STATUS, or None.
            stamp_s: fleet time of the sample that the charge is for.
        """
        said = None if sys_status is None else self._said(sys_status)
        if said is None or self._value is None or said < self._value - _TRUSTED:
            self._value = said
        else:
            self._value = max(said, self._value - max(0.0, stamp_s - self._stamp_s) * self._per_s)
        self._stamp_s = max(self._stamp_s, stamp_s)
        return self._value

    def _said(self, sys_status: Any) -> float | None:
        percent: int = sys_status.battery_remaining
        if 0 <= percent <= 100:
            return percent / 100.0
        volts: float = sys_status.voltage_battery * 1e-3
        if self._empty_v is None or self._full_v is None or not 0.0 < volts < _UNKNOWN_V:
            return None
        return min(max((volts - self._empty_v) / (self._full_v - self._empty_v), 0.0), 1.0)


class Sampler:
    """Makes samples of what one vehicle has said last. Conversions happen when they are read, not when it is heard.

    LOCAL_POSITION_NED and ATTITUDE are measured at times of their own. A sample is of the older of the two; what is
    newer is moved back to then by its rate.

    Args:
        robot_id: whose.
        inbox: what it has said.
        time_sync: its clock.
        charge: its battery.
        who: returns the controller that the vehicle reports in charge, or None.

    Attributes:
        frame: where its EKF has its origin; None until that is known.
        flies: whether its height is reported; what stands on the ground has height 0, whatever a barometer says.
    """

    def __init__(
        self,
        robot_id: int,
        inbox: Inbox,
        time_sync: TimeSync,
        charge: Charge,
        who: Callable[[], Controller | None],
    ) -> None:
        self._robot_id: Final = robot_id
        self._inbox: Final = inbox
        self._time_sync: Final = time_sync
        self._charge: Final = charge
        self._who: Final = who
        self._made_of: tuple[Any, Any, Controller | None] | None = None
        self._latest: RobotState | None = None
        self.frame: Frame | None = None
        self.flies = False

    def sample(self) -> RobotState | None:
        """Return the newest sample; the same object while nothing new was heard."""
        latest = self._inbox.latest
        position, attitude, frame = latest.get("LOCAL_POSITION_NED"), latest.get("ATTITUDE"), self.frame
        if position is None or attitude is None or frame is None:
            return self._latest
        controller = self._who()
        made_of = (position.message, attitude.message, controller)
        before = self._made_of
        if before is not None and all(new is old for new, old in zip(made_of, before, strict=True)):
            return self._latest
        state = self._make(position.message, attitude.message, frame, controller)
        if state is not None:
            self._latest, self._made_of = state, made_of
        return self._latest

    def _make(self, position: Any, attitude: Any, frame: Frame, controller: Controller | None) -> RobotState | None:
        stamp_ms = min(position.time_boot_ms, attitude.time_boot_ms)
        stamp_s = stamp_ms * 1e-3
        fleet_s = self._time_sync.to_fleet_s(stamp_s)
        if fleet_s is None:
            return None
        back_s = (position.time_boot_ms - stamp_ms) * 1e-3
        x_m, y_m, z_m = frame.from_ned(
            position.x - position.vx * back_s, position.y - position.vy * back_s, position.z - position.vz * back_s
        )
        yaw_rad = attitude.yaw - attitude.yawspeed * (attitude.time_boot_ms - stamp_ms) * 1e-3
        sys_status = self._inbox.latest.get("SYS_STATUS")
        return RobotState(
            robot_id=self._robot_id,
            stamp_s=fleet_s,
            vehicle_stamp_s=stamp_s,
            x_m=x_m,
            y_m=y_m,
            z_m=z_m if self.flies else 0.0,
            heading_rad=turned_rad(yaw_rad),
            vx_m_s=position.vy,
            vy_m_s=position.vx,
            yaw_rate_rad_s=-attitude.yawspeed,
            battery=self._charge.read(None if sys_status is None else sys_status.message, fleet_s),
            controller=controller,
            goal_id=None,
            link=Link.UP,
        )
