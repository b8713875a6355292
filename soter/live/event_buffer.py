"""The buffer of events for open pages, each of which reads at its own position."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final

MOST_BYTES: Final = 8 << 20
"""Most bytes kept for slow viewers. A viewer that has fallen behind by more has to begin anew."""


class FellBehind(Exception):
    """The next part for a viewer is no longer kept."""


class EventBuffer:
    """Numbered parts, of which the last ones are kept. Viewers take them at their own pace, and hold up no others.

    Any thread may use it.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes: Final = most_bytes
        self._changed: Final = threading.Condition()
        self._parts: Final[deque[bytes]] = deque()
        self._bytes = 0
        self._count = 0
        self._ended = False

    @property
    def count(self) -> int:
        """How many parts there have been; also the number of the last one."""
        return self._count

    def add(self, part: bytes) -> None:
        """Add a part, and drop the oldest ones beyond `MOST_BYTES`."""
        with self._changed:
            self._parts.append(part)
            self._bytes += len(part)
            self._count += 1
            while self._bytes > self._most_bytes and len(self._parts) > 1:
                self._bytes -= len(self._parts.popleft())
            self._changed.notify_all()

    def end(self) -> None:
        """Mark that there will be no more parts."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def after(self, number: int, limit_s: float) -> tuple[list[bytes], bool]:
        """Return the parts after one, waiting for them if there are none yet, and whether there will be no more.

        Args:
            number: number of the last part that the viewer has; 0 for none.
            limit_s: longest host time to wait.

        Raises:
            FellBehind: the next part is no longer kept, or there never was a part `number`.
        """
        until_s = time.monotonic() + limit_s
        with self._changed:
            while number == self._count and not self._ended and time.monotonic() < until_s:
                self._changed.wait(max(0.0, until_s - time.monotonic()))
            first = self._count - len(self._parts)
            if not first <= number <= self._count:
                raise FellBehind
            return [self._parts[at - first] for at in range(number, self._count)], self._ended
