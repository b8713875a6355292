"""Fleet time in the mission's process: it follows what the supervisor tells with every tick."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Final

from soter.clock import Clock

_SHORTEST_SLEEP_S: Final = 1e-3
_LONGEST_SLEEP_S: Final = 0.25


class FollowedClock(Clock):
    """Goes on from the time that was told last, at the rate between the last two; never back.

    Both processes run on one host, whose steady clock they share.

    Args:
        steady: the host's monotonic time in seconds.
        sleep: sleeps for so many seconds of the host.
    """

    def __init__(
        self, *, steady: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._steady: Final = steady
        self._sleep: Final = sleep
        self._told_s = 0.0
        self._told_steady_s = math.nan
        self._rate = 1.0
        self._shown_s = 0.0

    def follow(self, fleet_s: float, steady_s: float) -> None:
        """Take what the fleet's clock showed at one moment of the host's steady time."""
        passed_s = steady_s - self._told_steady_s
        if passed_s > 0.0:
            self._rate = max(0.0, (fleet_s - self._told_s) / passed_s)
        self._told_s, self._told_steady_s = fleet_s, steady_s

    def now(self) -> float:
        if math.isfinite(self._told_steady_s):
            self._shown_s = max(
                self._shown_s, self._told_s + max(0.0, self._steady() - self._told_steady_s) * self._rate
            )
        return self._shown_s

    def sleep_until(self, time_s: float) -> None:
        while (left_s := time_s - self.now()) > 0.0:
            self._sleep(min(max(left_s, _SHORTEST_SLEEP_S), _LONGEST_SLEEP_S))

    def steady_s(self) -> float:
        return self._steady()
