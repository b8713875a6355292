"""The bus between processes of one mission, over Zenoh: see `soter.distribution.bus`, whose `Bus` this is."""

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
    """Keys and bytes, to all other subscribers on the network. Its own messages do not come back to it.

    What is heard under a key is heard in a thread of that key's own, one message after another; what has not been heard
    when 1000 newer messages are there is lost. Whatever fails there is counted, the first time logged, and concerns no
    other message.

    Args:
        session: an open session, which from now on is this bus's own.

    Attributes:
        options_model: what `open` takes.
        lost: messages that could not even be handed to Zenoh.
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
        """Open a session for it; others may not be there yet, except for a client, which waits for its router.

        Raises:
            BackendUnavailable: Zenoh is not installed.
            ConfigError: there is no password where it should be.
            RobotUnavailable: it cannot be opened; the message says why, and what to do.
        """
        return cls(open_session(options))

    @property
    def failed(self) -> int:
        """How many messages were not taken by whoever should hear them."""
        return sum(listener.failed for listener in self._listeners)

    def publish(self, key: str, payload: bytes) -> None:
        """Send it to all subscribers. From any thread. Never waits and never raises; it may get lost."""
        import zenoh

        try:
            # Nothing waits for others. Not express: each message would fill one of the few places of the queue by
            # itself, and of five in a row three would be lost.
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
        """Hear what is published under a key from now on, until it is closed. A `*` stands for any one part of a key.

        Raises:
            ValueError: it is no key.
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
        """Leave. Nothing is heard afterwards. Idempotent; not to be called from where messages are heard."""
        self._closed = True
        for listener in self._listeners:
            listener.close()
        close_session(self._session)
