"""Time as the stack sees it: one narrow clock, so that a mission runs in virtual or in vehicle time unchanged."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable


class Clock(ABC):
    """Fleet time in seconds, the only time that missions, modules and recordings know."""

    @abstractmethod
    def now(self) -> float:
        """Return fleet time in seconds. It never goes back."""

    @abstractmethod
    def sleep_until(self, time_s: float) -> None:
        """Return when `now()` is at least `time_s`; at once if that is already so."""

    def steady_s(self) -> float:
        """Return the host's monotonic time in seconds, for watchdogs over code that runs on the host."""
        return time.perf_counter()


class VirtualClock(Clock):
    """A clock that stands still until somebody sleeps; sleeping steps the physics.

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
