"""Samples from messages: position and attitude that were measured at one moment, in the workspace frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from soter.adapters.mavlink.charge import Charge
from soter.adapters.mavlink.frames import Frame, turned_rad
from soter.adapters.mavlink.link import Inbox
from soter.adapters.mavlink.timesync import TimeSync
from soter.sdk import Controller, Link, RobotState


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
