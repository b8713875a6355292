"""The clocks of missions: one narrow interface, so that a mission runs unchanged in virtual or in vehicle time."""

import math
import statistics
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Final

_LONGEST_SLEEP_S: Final = 0.25
_SHORTEST_SLEEP_S: Final = 1e-6

# Old stamps in a row that mean a reboot: on a link that reorders, a newer sample follows a late one before that.
_REBOOT_SAMPLES: Final = 5

_BUCKETS: Final = 10


class Clock(ABC):
    """Fleet time in seconds, the only time in missions, modules and recordings."""

    @abstractmethod
    def now(self) -> float:
        """Return fleet time in seconds. It never goes back."""

    @abstractmethod
    def sleep_until(self, time_s: float) -> None:
        """Wait until `now()` is at least `time_s`; return at once if it is already."""

    def steady_s(self) -> float:
        """Return the host's monotonic time in seconds, for watchdogs over code that runs on the host."""
        return time.perf_counter()


class VirtualClock(Clock):
    """A clock that stands still until its thread sleeps, which steps the physics.

    Not thread-safe: it belongs to the thread that runs the mission.

    Args:
        advance: called with the time in seconds to which the simulated world must be stepped, before the
            clock shows that time. None for a world without physics (tests of machines and modules).
    """

    def __init__(self, advance: Callable[[float], None] | None = None) -> None:
        self._now_s = 0.0
        self._advance = advance

    def now(self) -> float:
        return self._now_s

    def sleep_until(self, time_s: float) -> None:
        if time_s <= self._now_s:
            return
        if self._advance is not None:
            self._advance(time_s)
        self._now_s = time_s


class VehicleClock(Clock):
    """Fleet time of robots that keep their own time: the host's steady time, at the rate of the vehicles' clocks.

    It begins at 0 and depends on no link: samples of the vehicles change only its rate, within `rate_tolerance`. So it
    never stops and never goes back, and a dead link cannot stop a decision module.

    The offset between a vehicle's clock and fleet time is estimated as TIMESYNC filters do, from the samples with the
    shortest delay. A quicker sample lowers it at once. It rises no faster than clocks drift apart, so that a link that
    becomes slow makes samples look old, and is not taken for a clock that went back. If the shortest delay is not
    measured it is not in the offset: it belongs to the declared latency.

    A vehicle whose stamps go back and stay back has rebooted: its offset is estimated anew. If a robot reports its
    reboots, `forget` does so at once. Thread-safe.

    Args:
        rate: nominal rate in vehicle seconds per host second; the speed-up of a simulated vehicle.
        rate_tolerance: how far the rate may be off, as a part of `rate`. The default is more than quartz clocks need.
        window_s: the time over which the rate is estimated, in host seconds.
        steady: the host's monotonic time in seconds.
        sleep: sleeps for a number of host seconds.
    """

    def __init__(
        self,
        *,
        rate: float = 1.0,
        rate_tolerance: float = 2e-4,
        window_s: float = 10.0,
        steady: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not 0.0 < rate < math.inf:
            raise ValueError(f"rate is {rate}, allowed: finite and above 0")
        if not 0.0 <= rate_tolerance < 1.0:
            raise ValueError(f"rate_tolerance is {rate_tolerance}, allowed: 0 or more, below 1")
        if not 0.0 < window_s < math.inf:
            raise ValueError(f"window_s is {window_s}, allowed: finite and above 0")
        self._steady: Final = steady
        self._sleep: Final = sleep
        self._nominal: Final = rate
        self._tolerance: Final = rate_tolerance
        self._window_s: Final = window_s
        self._lock: Final = threading.Lock()
        self._vehicles: Final[dict[int, _Vehicle]] = {}
        self._rate = rate
        self._since_steady_s = steady()
        self._since_s = 0.0

    @property
    def rate(self) -> float:
        """Estimated rate in vehicle seconds per host second; at first the nominal one."""
        return self._rate

    def now(self) -> float:
        # The host's time is read under the lock, so that threads agree on fleet time while the rate changes.
        with self._lock:
            return self._fleet_s(self._steady())

    def steady_s(self) -> float:
        return self._steady()

    def sleep_until(self, time_s: float) -> None:
        if not math.isfinite(time_s):
            raise ValueError(f"time_s is {time_s}, allowed: finite")
        while (left_s := time_s - self.now()) > 0.0:
            self._sleep(min(max(left_s / self._rate, _SHORTEST_SLEEP_S), _LONGEST_SLEEP_S))

    def observe(
        self,
        robot_id: int,
        vehicle_stamp_s: float,
        received_steady_s: float,
        delay_s: float = 0.0,
        *,
        anew: bool = False,
    ) -> bool:
        """Take note of a sample's stamp. Called by the receiver, for every sample.

        Args:
            robot_id: the robot.
            vehicle_stamp_s: the sample's stamp in vehicle time; one that is not finite is ignored.
            received_steady_s: `steady_s()` when the sample was received.
            delay_s: the sample's delay in host time if it was measured, such as half a round trip.
            anew: whether to forget earlier samples, because the robot's clock is known to be another one. In between,
                other threads never find the robot's clock unknown.

        Returns:
            Whether this sample shows that the vehicle has rebooted.
        """
        if not math.isfinite(vehicle_stamp_s + received_steady_s + delay_s):
            return False
        sent_steady_s = received_steady_s - delay_s
        with self._lock:
            vehicle = None if anew else self._vehicles.get(robot_id)
            offset_s = self._fleet_s(sent_steady_s) - vehicle_stamp_s
            if vehicle is None:
                self._vehicles[robot_id] = _Vehicle(vehicle_stamp_s, sent_steady_s, offset_s, self._window_s)
                return False
            drift_s = self._tolerance * self._rate * max(0.0, sent_steady_s - vehicle.heard_steady_s)
            rebooted = vehicle.take(vehicle_stamp_s, sent_steady_s, offset_s, drift_s, self._nominal)
            if vehicle.rate is not None:
                self._follow(received_steady_s)
            return rebooted

    def forget(self, robot_id: int) -> None:
        """Forget the clock of a robot that is known to have rebooted. The next sample begins anew."""
        with self._lock:
            self._vehicles.pop(robot_id, None)

    def to_fleet_s(self, robot_id: int, vehicle_stamp_s: float) -> float:
        """Return the fleet time of a vehicle's stamp; for an observed sample, never later than its reception.

        Raises:
            LookupError: no sample of that robot has been observed.
        """
        with self._lock:
            return vehicle_stamp_s + self._offset_s(robot_id)

    def to_vehicle_s(self, robot_id: int, fleet_s: float) -> float:
        """Return the estimated time of a vehicle's clock at a fleet time.

        Raises:
            LookupError: no sample of that robot has been observed.
        """
        with self._lock:
            return fleet_s - self._offset_s(robot_id)

    # --- under the lock ------------------------------------------------------------------------------------

    def _fleet_s(self, steady_s: float) -> float:
        return self._since_s + (steady_s - self._since_steady_s) * self._rate

    def _offset_s(self, robot_id: int) -> float:
        vehicle = self._vehicles.get(robot_id)
        if vehicle is None:
            raise LookupError(f"no sample of robot {robot_id} has been observed, so its clock is not known")
        return vehicle.offset_s

    def _follow(self, steady_s: float) -> None:
        """Go on from the present fleet time at the rate of the vehicles that were heard recently."""
        since_s = steady_s - self._window_s
        rates = [
            each.rate for each in self._vehicles.values() if each.rate is not None and each.heard_steady_s >= since_s
        ]
        slack = self._nominal * self._tolerance
        rate = min(max(statistics.median(rates), self._nominal - slack), self._nominal + slack) if rates else self._rate
        if rate != self._rate:
            here_s = self._steady()
            self._since_s, self._since_steady_s = self._fleet_s(here_s), here_s
            self._rate = rate


class _Vehicle:
    """The estimate of one vehicle's clock.

    Attributes:
        offset_s: fleet time minus vehicle time.
        heard_steady_s: when the newest sample was sent, in host time.
        rate: vehicle seconds per host second; None before there are enough samples.
    """

    __slots__ = ("_back", "_back_offset_s", "_back_s", "_best", "_bucket_s", "_newest_s", "heard_steady_s",
                 "offset_s", "rate")  # fmt: skip

    def __init__(self, stamp_s: float, steady_s: float, offset_s: float, window_s: float) -> None:
        self._bucket_s = window_s / _BUCKETS
        self._begin(stamp_s, steady_s, offset_s)

    def _begin(self, stamp_s: float, steady_s: float, offset_s: float) -> None:
        self.offset_s = offset_s
        self.heard_steady_s = steady_s
        self.rate: float | None = None
        self._newest_s = stamp_s
        self._back = 0
        self._back_s = -math.inf
        self._back_offset_s = math.inf
        # By interval of time, the host's and the vehicle's time of the sample with the shortest delay.
        self._best: deque[tuple[float, float]] = deque([(steady_s, stamp_s)], maxlen=_BUCKETS)

    def take(self, stamp_s: float, steady_s: float, offset_s: float, drift_s: float, nominal: float) -> bool:
        """Take one more sample; return whether it shows a reboot."""
        if stamp_s < self._newest_s:
            return self._take_back(stamp_s, steady_s, offset_s)
        self._back, self._back_s, self._back_offset_s = 0, -math.inf, math.inf
        self._newest_s = stamp_s
        self.heard_steady_s = max(self.heard_steady_s, steady_s)
        self.offset_s = min(offset_s, self.offset_s + drift_s)
        best = self._best
        best_steady_s, best_stamp_s = best[-1]
        if int(steady_s / self._bucket_s) != int(best_steady_s / self._bucket_s):
            best.append((steady_s, stamp_s))
            (first_steady_s, first_stamp_s), (last_steady_s, last_stamp_s) = best[0], best[-2]
            span_s = last_steady_s - first_steady_s
            if span_s >= 0.5 * _BUCKETS * self._bucket_s:
                self.rate = (last_stamp_s - first_stamp_s) / span_s
        elif stamp_s - best_stamp_s > nominal * (steady_s - best_steady_s):
            best[-1] = (steady_s, stamp_s)
        return False

    def _take_back(self, stamp_s: float, steady_s: float, offset_s: float) -> bool:
        """Take a sample that is older than the newest: it came late, or the vehicle has rebooted."""
        rising = stamp_s > self._back_s
        self._back = self._back + 1 if rising else 1
        self._back_offset_s = min(offset_s, self._back_offset_s) if rising else offset_s
        self._back_s = stamp_s
        if self._back < _REBOOT_SAMPLES:
            return False
        self._begin(stamp_s, steady_s, self._back_offset_s)
        return True
