"""The bus between processes of one mission: keys and bytes, nothing promised. What must not get lost goes by a channel.

A bus is chosen by name, as backends are; the code that speaks a vendor's protocol lives in an adapter, of which nothing
is imported before a mission asks for it.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, Generic, NamedTuple, Protocol, Self, TypeVar

from pydantic import BaseModel

from soter.config import validate_options
from soter.errors import ConfigError, Garbage
from soter.loading import known_target, load_named

Hear = Callable[[str, bytes], None]
"""Called with a key and what was published under it, in a thread of the bus; it must be quick and must not raise."""


class Bus(Protocol):
    """Carries small messages to all subscribers of their key. Messages may be lost, late, doubled, reordered.

    Keys are names with slashes between, without a leading one: `soter/alpha/status`.

    Attributes:
        options_model: what `open` takes, checked where a mission is read.
    """

    options_model: ClassVar[type[BaseModel]]

    @classmethod
    def open(cls, options: Any) -> Self:
        """Open it; others may not be there yet, and may come and go.

        Args:
            options: an instance of `options_model`.

        Raises:
            BackendUnavailable: a library is missing.
            RobotUnavailable: it cannot be opened; the message says why, and what to do.
        """

    def publish(self, key: str, payload: bytes) -> None:
        """Send it to all subscribers. Never waits and never raises; where it cannot be sent, it is lost."""

    def subscribe(self, key: str, hear: Hear) -> None:
        """Hear what is published under a key from now on. A `*` stands for any one part of a key."""

    def close(self) -> None:
        """Leave. Nothing is heard afterwards. Idempotent."""


BUILT_IN: Final[Mapping[str, str]] = {"zenoh": "soter.adapters.zenoh.bus:ZenohBus"}


def bus_class(name: str, source: str | None = None) -> type[Bus]:
    """Import and return a bus.

    Args:
        name: a built-in name, or `module:Class`.
        source: the mission file, for error messages.

    Raises:
        ConfigError: there is none of that name, or what is there is none.
    """

    def refused(why: str) -> ConfigError:
        return ConfigError(why, source=source, key="distribution.via")

    found: Any = load_named(known_target(name, BUILT_IN, "bus", refused), refused)
    model = getattr(found, "options_model", None)
    calls = ("open", "publish", "subscribe", "close")
    if not (isinstance(model, type) and issubclass(model, BaseModel) and all(hasattr(found, call) for call in calls)):
        raise refused(f"it is '{name}', which is no bus; allowed: a class with options_model, {', '.join(calls)}")
    kind: type[Bus] = found
    return kind


def open_bus(name: str, common: Mapping[str, Any], own: Mapping[str, Any], process: str, source: str | None) -> Bus:
    """Open a bus for one process, with the options of all and those that it has in their place.

    Raises:
        ConfigError: an option that the bus does not have or allow.
        BackendError: it cannot be opened.
    """
    kind = bus_class(name, source)
    key = f"distribution.processes.{process}.bus" if own else "distribution.bus"
    return kind.open(validate_options(kind.options_model, {**common, **own}, source, key))


logger = logging.getLogger(__name__)

M = TypeVar("M")

MAX_HELD: Final = 256
"""Messages that wait to be looked at, the newest: a sender that is faster than its reader loses some."""


class Received(NamedTuple, Generic[M]):
    """A message, the key it was published under, and when it came, on the listener's clock."""

    key: str
    message: M
    received_s: float


class BusInbox(Generic[M]):
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

    def take(self) -> list[Received[M]]:
        """Return what has come since the last time, oldest first; no more than was there at the beginning."""
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
