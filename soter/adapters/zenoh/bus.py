"""The bus between the processes of one mission, over Zenoh: implements `soter.distribution.bus.Bus`."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Final, Self

from pydantic import BaseModel

from soter.adapters.zenoh.session import SessionOptions, close_session, open_session

if TYPE_CHECKING:
    import zenoh

    from soter.adapters.zenoh.talk import Listener

_MOST_WAITING: Final = 1000

_log = logging.getLogger(__name__)


class ZenohBus:
    """Sends bytes under keys to all other subscribers on the network. Its own messages do not come back to it.

    Each subscription hears its messages in a thread of its own, one after another; a message that waits behind 1000
    newer ones is lost. Failures there are counted, the first is logged, and no other message is affected.

    Args:
        session: an open session, which belongs to the bus from now on.

    Attributes:
        options_model: the class of `open`'s options.
        lost: how many messages could not be handed to Zenoh.
    """

    options_model: ClassVar[type[BaseModel]] = SessionOptions

    def __init__(self, session: zenoh.Session) -> None:
        self._session: Final = session
        self._listeners: Final[list[Listener]] = []
        self._lock: Final = threading.Lock()
        self._refused: Final[set[str]] = set()
        self._closed = False
        self.lost = 0

    @classmethod
    def open(cls, options: SessionOptions) -> Self:
        """Open a bus with a session of its own; only a client waits, for its router.

        Raises:
            BackendUnavailable: Zenoh is not installed.
            ConfigError: a password is missing.
            RobotUnavailable: the session cannot be opened; the message says why, and what to do.
        """
        return cls(open_session(options))

    @property
    def failed(self) -> int:
        """How many messages the subscribed functions failed on."""
        return sum(listener.failed for listener in self._listeners)

    def publish(self, key: str, payload: bytes) -> None:
        """Send a message to all subscribers. From any thread. Never waits and never raises; messages may get lost."""
        import zenoh

        try:
            # Dropped instead of waiting. Not express: each message would fill one of the few places of the queue, and
            # of five in a row three would be lost.
            self._session.put(
                key,
                payload,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME,
                express=False,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        except zenoh.ZError as failure:
            with self._lock:
                self.lost += 1
                first = not self._closed and key not in self._refused
                self._refused.add(key)
            if first:
                _log.warning("nothing can be published under '%s': %s", key, failure)

    def subscribe(self, key: str, hear: Callable[[str, bytes], None]) -> None:
        """Call `hear` with each message under a key, until the bus is closed. A `*` stands for any one part of a key.

        Raises:
            ValueError: the key is not valid.
        """
        import zenoh

        from soter.adapters.zenoh.talk import Listener

        def take(sample: zenoh.Sample) -> None:
            if not self._closed and sample.kind == zenoh.SampleKind.PUT:
                hear(str(sample.key_expr), sample.payload.to_bytes())

        newest: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(_MOST_WAITING)
        try:
            subscriber = self._session.declare_subscriber(key, newest)
        except zenoh.ZError as failure:
            raise ValueError(f"'{key}' is no key to subscribe to: {failure}") from failure
        self._listeners.append(Listener(subscriber, take))

    def close(self) -> None:
        """End all subscriptions, and close the session. Idempotent; not to be called from a subscription's thread."""
        self._closed = True
        for listener in self._listeners:
            listener.close()
        close_session(self._session)
