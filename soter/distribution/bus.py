"""The bus between the processes of one mission: bytes under keys, without guarantees. Channels add reliability.

A bus is chosen by name, as backends are; the code for a vendor's protocol is in an adapter, which is imported only
for a mission that uses it.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, Generic, NamedTuple, Protocol, Self, TypeVar

from pydantic import BaseModel

from soter.errors import Garbage
from soter.loading import Refused, known_target, load_named

Hear = Callable[[str, bytes], None]
"""Called with a key and a payload published under it, in a thread of the bus; must be quick and must not raise."""


class Bus(Protocol):
    """Carries small messages to all subscribers of their key. Messages may be lost, late, doubled, reordered.

    Keys are names with slashes between them: `soter/alpha/status`.

    Attributes:
        options_model: the class of `open`'s options, which are checked when a mission is read.
    """

    options_model: ClassVar[type[BaseModel]]

    @classmethod
    def open(cls, options: Any) -> Self:
        """Return an open bus; other processes may not be there yet, and may come and go.

        Args:
            options: an instance of `options_model`.

        Raises:
            BackendUnavailable: a library is missing.
            RobotUnavailable: the bus cannot be opened; the message says why, and what to do.
        """

    def publish(self, key: str, payload: bytes) -> None:
        """Send a payload to all subscribers. Never waits and never raises; if it cannot be sent, it is lost."""

    def subscribe(self, key: str, hear: Hear) -> None:
        """Call `hear` from now on with payloads published under a key. A `*` stands for any one part of a key."""

    def close(self) -> None:
        """Leave the bus. Nothing is heard afterwards. Idempotent."""


BUILT_IN: Final[Mapping[str, str]] = {"zenoh": "soter.adapters.zenoh.bus:ZenohBus"}


def bus_class(name: str, refused: Refused) -> type[Bus]:
    """Import and return the class of a bus, given by a built-in name or as `module:Class`; `refused` makes the error.

    Raises:
        ConfigError: there is no bus of that name.
    """
    found: Any = load_named(known_target(name, BUILT_IN, "bus", refused), refused)
    model = getattr(found, "options_model", None)
    calls = ("open", "publish", "subscribe", "close")
    if not (isinstance(model, type) and issubclass(model, BaseModel) and all(hasattr(found, call) for call in calls)):
        raise refused(f"it is '{name}', which is no bus; allowed: a class with options_model, {', '.join(calls)}")
    kind: type[Bus] = found
    return kind


logger = logging.getLogger(__name__)

M = TypeVar("M")

MAX_HELD: Final = 256
"""Most messages that wait to be read; of a sender that is faster than its reader the oldest are lost."""


class Received(NamedTuple, Generic[M]):
    """A message, its key, and the time of its arrival on the listener's clock."""

    key: str
    message: M
    received_s: float


class BusInbox(Generic[M]):
    """Keeps messages with their times of arrival, until the reading thread takes them.

    Args:
        decode: decodes a payload; raises `Garbage` if it is no message.
        now: the listener's clock; called in the bus's thread.

    Attributes:
        garbage: how many payloads were no messages. The first is logged.
    """

    def __init__(self, bus: Bus, key: str, decode: Callable[[bytes], M], now: Callable[[], float]) -> None:
        self.garbage = 0
        self._decode: Final = decode
        self._now: Final = now
        self._held: Final[deque[tuple[str, bytes, float]]] = deque(maxlen=MAX_HELD)
        bus.subscribe(key, self._hear)

    def take(self) -> list[Received[M]]:
        """Return the messages since the last call, oldest first; without those that arrive during this call."""
        heard = []
        for _ in range(len(self._held)):
            key, data, received_s = self._held.popleft()
            try:
                heard.append(Received(key, self._decode(data), received_s))
            except Garbage as garbage:
                self.garbage += 1
                if self.garbage == 1:
                    logger.warning("what came under '%s' is no message of SOTER and was ignored: %s", key, garbage)
        return heard

    def _hear(self, key: str, data: bytes) -> None:
        self._held.append((key, data, self._now()))
