"""What a bus has brought and nobody has looked at yet."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar

from soter.link.bus import Bus
from soter.link.messages import Garbage

logger = logging.getLogger(__name__)

M = TypeVar("M")

MAX_HELD: Final = 256
"""Messages that wait to be looked at, the newest: whoever sends more often than others look loses some."""


class Heard(NamedTuple, Generic[M]):
    """A message.

    Attributes:
        key: what it was published under.
        message: decoded.
        received_s: when it came, on the clock of whoever listens.
    """

    key: str
    message: M
    received_s: float


class Inbox(Generic[M]):
    """Keeps what comes, with the time at which it came, until the thread that it is for takes it.

    Args:
        bus: where from.
        key: of what to hear, as the bus takes it.
        decode: raises `Garbage` for what is no message.
        now: the listener's clock; asked in the bus's thread.

    Attributes:
        garbage: how many messages were none. The first is logged.
    """

    def __init__(self, bus: Bus, key: str, decode: Callable[[bytes], M], now: Callable[[], float]) -> None:
        self.garbage = 0
        self._decode: Final = decode
        self._now: Final = now
        self._held: Final[deque[tuple[str, bytes, float]]] = deque(maxlen=MAX_HELD)
        bus.subscribe(key, self._hear)

    def take(self) -> list[Heard[M]]:
        """Return what has come since the last time, oldest first; no more than was there at the beginning."""
        heard = []
        for _ in range(len(self._held)):
            key, data, received_s = self._held.popleft()
            try:
                heard.append(Heard(key, self._decode(data), received_s))
            except Garbage as garbage:
                self.garbage += 1
                if self.garbage == 1:
                    logger.warning("what came under '%s' is no message of SOTER and was ignored: %s", key, garbage)
        return heard

    def _hear(self, key: str, data: bytes) -> None:
        self._held.append((key, data, self._now()))
