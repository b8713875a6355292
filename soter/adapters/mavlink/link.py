"""What the adapter needs of a MAVLink library: the latest messages of each autopilot, and a way to send."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from soter.clock import Clock

logger = logging.getLogger(__name__)

AUTOPILOT: Final = 1
"""The component id of autopilots. Other components of a vehicle, such as cameras, say nothing of interest here."""

Fields = Mapping[str, Any]
"""The fields of a message by name. A message that was heard has them as attributes."""


class Heard(NamedTuple):
    """A message, its fields as attributes, and the steady time at which it was received."""

    message: Any
    received_s: float


class DuplicateVehicle(NamedTuple):
    """Two who say to be one vehicle.

    Attributes:
        agreed: the address of the one that is heard, and told what to do.
        other: that of the one that is not.
        messages: how many of its messages were dropped.
        last_s: steady time of the last of them.
    """

    agreed: str
    other: str
    messages: int
    last_s: float

    def __str__(self) -> str:
        return f"two say to be it, at {self.agreed}, which is obeyed, and at {self.other}"


class Inbox:
    """What one autopilot has said: the latest message of each kind; nothing is queued.

    The receiving thread writes, anybody reads. A hook is called by the receiving thread with every message of its kind:
    it is for what must not be missed, and has to be quick.
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

    What a system that nobody asked for says is ignored, so that a foreign heartbeat never changes who is commanded.

    Attributes:
        system: the same.
        inboxes: by system id, of the vehicles that are listened to; filled before `start`.
        strangers: system ids of other autopilots that were heard, to say so.
        duplicates: by system id, those who say to be a vehicle that is at another address already; they are not heard.
        failed: how many messages could not be dealt with. The first is logged.
    """

    def __init__(self, clock: Clock, system: int) -> None:
        self.clock: Final = clock
        self.system: Final = system
        self.inboxes: Final[dict[int, Inbox]] = {}
        self.strangers: Final[set[int]] = set()
        self.duplicates: Final[dict[int, DuplicateVehicle]] = {}
        self.failed = 0

    def send(self, system: int, component: int, name: str, fields: Fields) -> None:
        """Send a message to a vehicle in the name of one of our components; never wait.

        What cannot be sent is dropped: the sender repeats it.

        Args:
            system: to which vehicle.
            component: our component id, one of those that the link was opened with.
            name: of the message.
            fields: all of its fields.

        Raises:
            ValueError: a number is not finite; there are autopilots that crash of one.
        """
        for key, value in fields.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name}.{key} is {value}, allowed: finite")
        self._send(system, component, name, fields)

    def _dropped(self, what: str, failure: Exception) -> None:
        """Note that a message could not be dealt with: what arrives is anybody's, and must not deafen the others."""
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
