"""The adapter's interface to a MAVLink library: the latest messages of each autopilot, and a way to send."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from soter.clock import Clock

logger = logging.getLogger(__name__)

AUTOPILOT: Final = 1
"""The component id of autopilots. Messages of other components, such as cameras, are ignored."""

Fields = Mapping[str, Any]
"""The fields of a message by name. A received message has them as attributes."""


class Heard(NamedTuple):
    """A message with its fields as attributes, and the steady time at which it was received."""

    message: Any
    received_s: float


class DuplicateVehicle(NamedTuple):
    """Two vehicles with one system id.

    Attributes:
        agreed: the address of the vehicle that is heard and commanded.
        other: the address of the vehicle that is ignored.
        messages: how many messages of the ignored vehicle were dropped.
        last_s: steady time of the last dropped message.
    """

    agreed: str
    other: str
    messages: int
    last_s: float

    def __str__(self) -> str:
        return f"two vehicles have its system id: one at {self.agreed}, which is used, and one at {self.other}"


class Inbox:
    """The latest message of each kind from one autopilot; nothing is queued.

    The receiving thread writes, any thread reads. The receiving thread calls a hook with every message of its kind:
    hooks are for messages that must not be missed, and have to be quick.
    """

    __slots__ = ("counts", "hooks", "latest")

    def __init__(self) -> None:
        self.latest: Final[dict[str, Heard]] = {}
        self.counts: Final[dict[str, int]] = {}
        self.hooks: Final[dict[str, Callable[[Any, float], None]]] = {}

    def put(self, name: str, message: Any, received_s: float) -> None:
        """Take a message. Called by the receiving thread."""
        self.latest[name] = Heard(message, received_s)
        self.counts[name] = self.counts.get(name, 0) + 1
        hook = self.hooks.get(name)
        if hook is not None:
            hook(message, received_s)


class MavlinkLink(ABC):
    """A connection over which any number of vehicles are reached, each by its system id.

    Messages of systems without an inbox are ignored, so that a foreign heartbeat never changes which one is commanded.

    Attributes:
        system: our system id.
        inboxes: by system id, for each vehicle to listen to; filled before `start`.
        strangers: system ids of other autopilots that were heard, for messages to users.
        duplicates: by system id, vehicles whose id is in use at another address already; they are ignored.
        failed: how many messages could not be processed. The first is logged.
    """

    def __init__(self, clock: Clock, system: int) -> None:
        self.clock: Final = clock
        self.system: Final = system
        self.inboxes: Final[dict[int, Inbox]] = {}
        self.strangers: Final[set[int]] = set()
        self.duplicates: Final[dict[int, DuplicateVehicle]] = {}
        self.failed = 0

    def send(self, system: int, component: int, name: str, fields: Fields) -> None:
        """Send a message to a vehicle as one of our components, without waiting.

        A message that cannot be sent is dropped: the caller repeats it.

        Args:
            system: the vehicle's system id.
            component: one of our component ids, with which the link was opened.
            name: the message's name.
            fields: all of its fields.

        Raises:
            ValueError: a number is not finite; some autopilots crash on such numbers.
        """
        for key, value in fields.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name}.{key} is {value}, allowed: finite")
        self._send(system, component, name, fields)

    def _dropped(self, what: str, failure: Exception) -> None:
        """Count a message that could not be processed: anybody can send one, and the others must still be heard."""
        self.failed += 1
        if self.failed == 1:
            logger.error("dropped %s", what, exc_info=failure)

    @abstractmethod
    def start(self) -> None:
        """Begin to listen.

        Raises:
            RobotUnavailable: the connection cannot be opened.
        """

    @abstractmethod
    def _send(self, system: int, component: int, name: str, fields: Fields) -> None:
        """Send a message whose fields have been checked."""

    @abstractmethod
    def beat(self, system: int) -> None:
        """Send a HEARTBEAT, unless the library does so by itself."""

    @abstractmethod
    def close(self) -> None:
        """Stop listening and free the connection. Idempotent; may be called before `start`."""
