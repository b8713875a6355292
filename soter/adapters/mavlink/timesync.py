"""What a vehicle's clock shows, measured by TIMESYNC, or where it does not answer learned from its samples."""

from __future__ import annotations

import logging
import secrets
from collections import deque
from typing import Any, Final

from soter.adapters.mavlink.link import Fields, Inbox
from soter.clock import VehicleClock

logger = logging.getLogger(__name__)

_TOKEN: Final = 1 << 12
_KEPT: Final = 20
_QUICK: Final = 1.5
_QUICK_S: Final = 0.0005
_BEHIND_S: Final = 0.02
_REBOOT_S: Final = 1.0
_APART_S: Final = 2.0
_DEAF_REQUESTS: Final = 10
_SETTLED: Final = 5


class TimeSync:
    """The clock of one vehicle.

    A request carries the time at which it was sent and the answer the vehicle's time in between, so that the offset of
    the two clocks is known within half of the round trip, whatever the speed-up. Only quick answers are believed. A
    vehicle whose clock is not where it must be by that has rebooted, or its clock stood still.

    The receiving thread calls the hooks, the supervisor's everything else.

    Args:
        robot_id: whose clock.
        clock: fleet time; told of every measurement.
        inbox: of the vehicle.

    Attributes:
        reboots: how often the vehicle's clock went back.
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
        self.reboots = 0
        inbox.hooks["TIMESYNC"] = self._hear
        inbox.hooks["LOCAL_POSITION_NED"] = self._hear_sample

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
        """Return what the vehicle's clock shows at a fleet time; None while it is not known."""
        try:
            return self._clock.to_vehicle_s(self._robot_id, fleet_s)
        except LookupError:
            return None

    def request(self) -> Fields:
        """Return the fields of the next TIMESYNC to send."""
        self._asked += 1
        sent_ns = int(self._clock.steady_s() * 1e9)
        # The last digits say that it is ours: some microseconds too early do not matter, too late would be no answer.
        return {"tc1": 0, "ts1": sent_ns - sent_ns % _TOKEN - _TOKEN + self._token}

    # --- the receiving thread ------------------------------------------------------------------------------

    def _hear(self, message: Any, received_s: float) -> None:
        if message.tc1 <= 0 or message.ts1 % _TOKEN != self._token:
            return
        trip_s = received_s - message.ts1 * 1e-9
        stamp_s = message.tc1 * 1e-9
        if trip_s < 0.0 or abs(stamp_s - self._newest_stamp_s) > _APART_S:
            # Not an answer, or on another clock than that of the samples.
            return
        self._answered += 1
        self._trips_s.append(trip_s)
        if trip_s > _QUICK * min(self._trips_s) + _QUICK_S:
            return
        # A first answer may be a slow one. Taken as if all of that was on its way back, it makes samples look too old
        # by a little until the next one comes, and never too young.
        first = self._stood_still(stamp_s, received_s, trip_s) or not self._believed
        self._clock.observe(self._robot_id, stamp_s, received_s, trip_s if first else 0.5 * trip_s)
        self._believed += 1

    def _hear_sample(self, message: Any, received_s: float) -> None:
        stamp_s = message.time_boot_ms * 1e-3
        if stamp_s < self._newest_stamp_s - _REBOOT_S:
            self._reboot(stamp_s)
        elif stamp_s < self._newest_stamp_s:
            return
        self._newest_stamp_s = stamp_s
        if self._answered == 0 and self._asked > _DEAF_REQUESTS:
            self._clock.observe(self._robot_id, stamp_s, received_s)
            self._believed += 1

    def _stood_still(self, stamp_s: float, received_s: float, trip_s: float) -> bool:
        """Return whether the clock is behind what it must show by now; what was known of it is then forgotten."""
        expected_s = self.to_vehicle_s(self._clock.now() - (self._clock.steady_s() - received_s) * self._clock.rate)
        if expected_s is None:
            return False
        behind_s = expected_s - trip_s * self._clock.rate - stamp_s
        if behind_s <= _BEHIND_S:
            return False
        logger.info("robot %d: its clock has stood still for %.3f s", self._robot_id, behind_s)
        self._clock.forget(self._robot_id)
        return True

    def _reboot(self, stamp_s: float) -> None:
        logger.warning("robot %d: it has rebooted, %.1f s ago", self._robot_id, stamp_s)
        self.reboots += 1
        self._clock.forget(self._robot_id)
        self._trips_s.clear()
        self._asked = self._answered = self._believed = 0
