"""What open pages are told, one part after the other; each of them is somewhere in it."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final

MOST_BYTES: Final = 8 << 20
"""What is kept for those who are slow. Who has fallen behind by more has to begin anew."""


class FellBehind(Exception):
    """What comes next for this viewer is not kept any more."""


class EventBuffer:
    """Numbered parts, of which the last ones are kept. Viewers take them at their own pace and hold nobody up.

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
        """Add a part, and forget those that are too old."""
        with self._changed:
            self._parts.append(part)
            self._bytes += len(part)
            self._count += 1
            while self._bytes > self._most_bytes and len(self._parts) > 1:
                self._bytes -= len(self._parts.popleft())
            self._changed.notify_all()

    def end(self) -> None:
        """Say that there will be no more."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def after(self, number: int, limit_s: float) -> tuple[list[bytes], bool]:
        """Return the parts behind one, and whether there will be no more; wait for them for at most so long.

        Args:
            number: of the last part that is known; 0 for none.
            limit_s: host time.

        Raises:
            FellBehind: the next one is not kept any more, or there never was such a part.
        """
        until_s = time.monotonic() + limit_s
        with self._changed:
            while number == self._count and not self._ended and time.monotonic() < until_s:
                self._changed.wait(max(0.0, until_s - time.monotonic()))
            first = self._count - len(self._parts)
            if not first <= number <= self._count:
                raise FellBehind
            return [self._parts[at - first] for at in range(number, self._count)], self._ended
