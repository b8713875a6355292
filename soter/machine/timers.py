"""Timers: events that are sent when the runtime's clock reaches a time."""

from __future__ import annotations

import heapq
import math
from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.machine.events import Event, MachineRef


class Timer:
    """An event that will be sent at a time. Used from the runtime's thread only.

    Attributes:
        time_s: When it is due, in seconds on the runtime's clock.
        active: Whether it is still going to be sent; false once it was sent or cancelled.
    """

    __slots__ = ("active", "event", "time_s", "to")

    def __init__(self, time_s: float, to: MachineRef, event: Event) -> None:
        self.time_s = time_s
        self.to = to
        self.event = event
        self.active = True

    def cancel(self) -> bool:
        """Do not send the event. An event that was sent already is in a queue and cannot be called back.

        Returns:
            True if this prevented the event; false if it was sent or cancelled before.
        """
        was_active, self.active = self.active, False
        return was_active


class TimerQueue:
    """Timers by time, and by age where the times are equal."""

    __slots__ = ("_count", "heap")

    def __init__(self) -> None:
        self.heap: list[tuple[float, int, Timer]] = []
        self._count = count()

    def add(self, time_s: float, to: MachineRef, event: Event) -> Timer:
        """Add a timer.

        Raises:
            ValueError: The time is not a finite number.
        """
        if not math.isfinite(time_s):
            raise ValueError(f"a timer's time must be a finite number of seconds, not {time_s!r}")
        timer = Timer(time_s, to, event)
        heapq.heappush(self.heap, (time_s, next(self._count), timer))
        return timer

    def next_s(self) -> float | None:
        """Return the time of the first active timer, and forget the cancelled ones before it."""
        heap = self.heap
        while heap and not heap[0][2].active:
            heapq.heappop(heap)
        return heap[0][0] if heap else None

    def pop_due(self, now_s: float) -> Timer | None:
        """Return the first active timer that is due, no longer active; None if none is due."""
        next_s = self.next_s()
        if next_s is None or next_s > now_s:
            return None
        timer = heapq.heappop(self.heap)[2]
        timer.active = False
        return timer
