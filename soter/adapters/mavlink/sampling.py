"""Makes samples from messages: position and attitude at one moment, in the workspace frame.

A vehicle's clock is measured by TIMESYNC, or estimated from its samples if it does not answer.
"""

from __future__ import annotations

import logging
import math
import secrets
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from soter.adapters.mavlink.frames import EarthFrame, Frame
from soter.adapters.mavlink.link import Fields, Inbox
from soter.clock import VehicleClock
from soter.sdk import Controller, Link, RobotState

logger = logging.getLogger(__name__)

_TOKEN: Final = 1 << 12
_KEPT: Final = 20
_QUICK: Final = 1.5
_QUICK_S: Final = 0.0005
_BEHIND_S: Final = 0.02
_REBOOT_S: Final = 1.0
_LATE_S: Final = 10.0
"""A link holds messages back for no longer than this."""

_APART_S: Final = 2.0
_DEAF_REQUESTS: Final = 10
_SETTLED: Final = 5

# No vehicle boots `_OFTEN` times in `_OFTEN_S`.
_OFTEN: Final = 4
_OFTEN_S: Final = 10.0


class TimeSync:
    """The clock of one vehicle.

    A request carries the time at which it was sent, and the answer the vehicle's time in between, so that the offset of
    the two clocks is known within half of the round trip at any speed-up. Only quick answers are used. If a clock shows
    less than it must by then, the vehicle has rebooted or the clock stood still. Samples that a link has held back, and
    that come once later ones have overtaken them, are neither.

    The receiving thread calls the hooks, the supervisor's thread everything else.

    Attributes:
        two: whether the clock jumps to and fro: two vehicles share the id, on a line that does not tell them apart.
        reboots: how often the vehicle's clock went back, or stood still for so long that it may have rebooted.
    """

    def __init__(self, robot_id: int, clock: VehicleClock, inbox: Inbox) -> None:
        self._robot_id: Final = robot_id
        self._clock: Final = clock
        self._token: Final = secrets.randbelow(_TOKEN)
        self._trips_s: Final[deque[float]] = deque(maxlen=_KEPT)
        self._asked = 0
        self._answered = 0
        self._believed = 0
        self._newest_stamp_s = 0.0
        self._held_back_s = math.inf, -math.inf
        self._rebooted_s: Final[deque[float]] = deque(maxlen=_OFTEN)
        self.reboots = 0
        self.two = False
        inbox.hooks["TIMESYNC"] = self._hear
        # Attitudes come long before positions, so that the clock is known when the first position comes.
        inbox.hooks["ATTITUDE"] = inbox.hooks["LOCAL_POSITION_NED"] = self._hear_sample

    @property
    def settled(self) -> bool:
        """Whether the clock is known well enough to begin."""
        return self._believed >= _SETTLED

    def to_fleet_s(self, stamp_s: float) -> float | None:
        """Return the fleet time of a stamp of the vehicle; None while its clock is not known."""
        try:
            return self._clock.to_fleet_s(self._robot_id, stamp_s)
        except LookupError:
            return None

    def to_vehicle_s(self, fleet_s: float) -> float | None:
        """Return the vehicle's time at a fleet time; None while its clock is not known."""
        try:
            return self._clock.to_vehicle_s(self._robot_id, fleet_s)
        except LookupError:
            return None

    def request(self) -> Fields:
        """Return the fields of the next TIMESYNC to send."""
        self._asked += 1
        sent_ns = int(self._clock.steady_s() * 1e9)
        # The last digits are our token. A time some microseconds early does not matter; a late one would be refused.
        return {"tc1": 0, "ts1": sent_ns - sent_ns % _TOKEN - _TOKEN + self._token}

    # --- the receiving thread ------------------------------------------------------------------------------

    def _hear(self, message: Any, received_s: float) -> None:
        if message.tc1 <= 0 or message.ts1 % _TOKEN != self._token:
            return
        trip_s = received_s - message.ts1 * 1e-9
        stamp_s = message.tc1 * 1e-9
        if trip_s < 0.0 or abs(stamp_s - self._newest_stamp_s) > _APART_S:
            # Not an answer, or on another clock than the samples.
            return
        self._answered += 1
        self._trips_s.append(trip_s)
        if trip_s > _QUICK * min(self._trips_s) + _QUICK_S:
            return
        # A first answer may be a slow one. With its whole round trip counted as the way back, samples look a little too
        # old until the next answer comes, and never too young.
        first = self._stood_still(stamp_s, received_s, trip_s) or not self._believed
        self._clock.observe(self._robot_id, stamp_s, received_s, trip_s if first else 0.5 * trip_s)
        self._believed += 1

    def _hear_sample(self, message: Any, received_s: float) -> None:
        stamp_s = message.time_boot_ms * 1e-3
        ahead_s = stamp_s - self._newest_stamp_s
        from_s, until_s = self._held_back_s
        if self.settled and _REBOOT_S < ahead_s <= _LATE_S:
            # What it sent in between may still come, for as long as it was held back.
            self._held_back_s = self._newest_stamp_s, received_s + ahead_s / self._clock.rate
        elif ahead_s < -_REBOOT_S and not (stamp_s >= from_s and received_s <= until_s):
            self._reboot(stamp_s)
        elif stamp_s < self._newest_stamp_s:
            return
        self._newest_stamp_s = stamp_s
        if self._answered == 0 and self._asked > _DEAF_REQUESTS:
            self._clock.observe(self._robot_id, stamp_s, received_s)
            self._believed += 1

    def _stood_still(self, stamp_s: float, received_s: float, trip_s: float) -> bool:
        """Return whether the clock is behind its expected time; if so, forget its offset."""
        expected_s = self.to_vehicle_s(self._clock.now() - (self._clock.steady_s() - received_s) * self._clock.rate)
        if expected_s is None:
            return False
        behind_s = expected_s - trip_s * self._clock.rate - stamp_s
        if behind_s <= _BEHIND_S:
            return False
        logger.info("robot %d: its clock has stood still for %.3f s", self._robot_id, behind_s)
        self._clock.forget(self._robot_id)
        # A vehicle that was away for so long may have rebooted; stamps do not show this if it had booted just before.
        self.reboots += behind_s > _REBOOT_S
        return True

    def _reboot(self, stamp_s: float) -> None:
        now_s = self._clock.steady_s()
        self._rebooted_s.append(now_s)
        often = len(self._rebooted_s) == _OFTEN and now_s - self._rebooted_s[0] < _OFTEN_S
        if not often:
            logger.warning("robot %d: it has rebooted, %.1f s ago", self._robot_id, stamp_s)
        elif not self.two:
            logger.error(
                "robot %d: two vehicles with its system id are heard; give each one of its own", self._robot_id
            )
        self.two = often
        self.reboots += 1
        self._clock.forget(self._robot_id)
        self._trips_s.clear()
        self._asked = self._answered = self._believed = 0


_UNKNOWN_V: Final = 0xFFFF * 1e-3
_TRUSTED: Final = 0.02
"""A reading lower by more than this is taken at once: the battery falls faster than it should."""


class ChargeFilter:
    """Estimates the charge of one battery by the autopilot's reports: whole percents, a voltage, or nothing.

    A percentage that is rounded down jumps by one from time to time. The estimate falls to it no faster than the
    battery can, so that it never exceeds the true charge and has no jumps, which decision modules would take for a
    battery that breaks its promise.


    Args:
        drive_s: time from full to empty at driving power.
        empty_v: voltage of the empty battery, for autopilots that do not count the charge; None if not known.
        full_v: voltage of the full battery.
    """

    def __init__(self, drive_s: float, empty_v: float | None = None, full_v: float | None = None) -> None:
        self._per_s: Final = 1.0 / drive_s
        self._empty_v: Final = empty_v
        self._full_v: Final = full_v
        self._value: float | None = None
        self._stamp_s = -math.inf

    def read(self, sys_status: Any, stamp_s: float) -> float | None:
        """Return the charge from 0 to 1; None if it is not known.

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
    """Makes samples of one vehicle's latest messages, converting them when a sample is read.

    LOCAL_POSITION_NED and ATTITUDE are measured at different times. A sample has the time of the older message; the
    newer one is moved back to that time by its rate.

    Args:
        robot_id: the robot's id.
        inbox: the vehicle's messages.
        time_sync: the vehicle's clock.
        charge: the vehicle's battery.
        who: returns the active controller that the vehicle reports, or None.

    Attributes:
        frame: the vehicle's frame; None until the origin of its EKF is known, and from a reboot, which moves that
            origin, until it is set again. Without it there are no new samples.
        latest: the newest sample.
        flies: whether height is reported; on the ground it is 0, whatever a barometer says.
    """

    def __init__(
        self,
        robot_id: int,
        inbox: Inbox,
        time_sync: TimeSync,
        charge: ChargeFilter,
        who: Callable[[], Controller | None],
    ) -> None:
        self._robot_id: Final = robot_id
        self._inbox: Final = inbox
        self._time_sync: Final = time_sync
        self._charge: Final = charge
        self._who: Final = who
        self._made_of: tuple[Any, Any, Controller | None] | None = None
        self._frame: Frame | EarthFrame | None = None
        self._reboots = 0
        self.latest: RobotState | None = None
        self.flies = False

    @property
    def frame(self) -> Frame | EarthFrame | None:
        return self._frame if self._reboots == self._time_sync.reboots else None

    @frame.setter
    def frame(self, frame: Frame | EarthFrame | None) -> None:
        self._frame, self._reboots = frame, self._time_sync.reboots

    def sample(self) -> RobotState | None:
        """Return the newest sample; the same object until a new message is heard."""
        latest = self._inbox.latest
        position, attitude, frame = latest.get("LOCAL_POSITION_NED"), latest.get("ATTITUDE"), self.frame
        if position is None or attitude is None or frame is None:
            return self.latest
        controller = self._who()
        made_of = (position.message, attitude.message, controller)
        before = self._made_of
        if before is not None and all(new is old for new, old in zip(made_of, before, strict=True)):
            return self.latest
        state = self._make(position.message, attitude.message, frame, controller)
        if state is not None:
            self.latest, self._made_of = state, made_of
        return self.latest

    def _make(
        self, position: Any, attitude: Any, frame: Frame | EarthFrame, controller: Controller | None
    ) -> RobotState | None:
        stamp_ms = min(position.time_boot_ms, attitude.time_boot_ms)
        stamp_s = stamp_ms * 1e-3
        before = self.latest
        if before is not None and before.vehicle_stamp_s == stamp_s:
            # Only one of the two messages is new: a sample of a later moment needs both.
            return before if before.controller is controller else before._replace(controller=controller)
        fleet_s = self._time_sync.to_fleet_s(stamp_s)
        if fleet_s is None:
            return None
        if before is not None and stamp_s > before.vehicle_stamp_s:
            # The clock was corrected by more than the time between two samples: fleet time must not go back.
            fleet_s = max(fleet_s, before.stamp_s)
        back_s = (position.time_boot_ms - stamp_ms) * 1e-3
        x_m, y_m, z_m = frame.from_ned(position.x, position.y, position.z)
        at = x_m, y_m
        vx_m_s, vy_m_s = frame.to_velocity(at, position.vx, position.vy)
        yaw_rad = attitude.yaw - attitude.yawspeed * (attitude.time_boot_ms - stamp_ms) * 1e-3
        sys_status = self._inbox.latest.get("SYS_STATUS")
        return RobotState(
            robot_id=self._robot_id,
            stamp_s=fleet_s,
            vehicle_stamp_s=stamp_s,
            x_m=x_m - vx_m_s * back_s,
            y_m=y_m - vy_m_s * back_s,
            z_m=z_m + position.vz * back_s if self.flies else 0.0,
            heading_rad=frame.to_heading_rad(at, yaw_rad),
            vx_m_s=vx_m_s,
            vy_m_s=vy_m_s,
            yaw_rate_rad_s=-attitude.yawspeed,
            battery=self._charge.read(None if sys_status is None else sys_status.message, fleet_s),
            controller=controller,
            goal_id=None,
            link=Link.UP,
        )
