"""The bus between processes of one mission, over Zenoh: see `soter.link.bus`, whose `Bus` this is."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Self

from pydantic import BaseModel

from soter.adapters.zenoh.session import SessionOptions, close_session, open_session

if TYPE_CHECKING:
    import zenoh

_log = logging.getLogger(__name__)


class ZenohBus:
    """Keys and bytes, to everybody else on the network who subscribes. Its own messages do not come back to it.

    What is heard is heard in a thread of Zenoh, one message after another. Whatever fails there is counted and logged,
    the first time for each key as a whole, and concerns no other message.

    Args:
        session: an open session, which from now on is this bus's own.

    Attributes:
        options_model: what `open` takes.
        lost: messages that could not even be handed to Zenoh.
        failed: messages at which whoever should hear them raised something.
    """

    options_model: ClassVar[type[BaseModel]] = SessionOptions

    def __init__(self, session: zenoh.Session) -> None:
        import zenoh

        self._session = session
        self._error = zenoh.ZError
        # Nothing waits for others, and nothing is heard in the thread that publishes it. Not express: each message
        # would fill one of the few places of the queue by itself, and of five in a row three would be lost.
        self._how: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.DROP,
            "priority": zenoh.Priority.REAL_TIME,
            "express": False,
            "allowed_destination": zenoh.Locality.REMOTE,
        }
        self._put = zenoh.SampleKind.PUT
        self._lock = threading.Lock()
        self._told: set[str] = set()
        self._closed = False
        self.lost = 0
        self.failed = 0

    @classmethod
    def open(cls, options: SessionOptions) -> Self:
        """Open a session for it; others may not be there yet, except for a client, which waits for its router.

        Raises:
            BackendUnavailable: Zenoh is not installed.
            ConfigError: there is no password where it should be.
            RobotUnavailable: it cannot be opened; the message says why, and what to do.
        """
        return cls(open_session(options))

    def publish(self, key: str, payload: bytes) -> None:
        """Send it to whoever subscribes. From any thread. Never waits and never raises; it may get lost."""
        try:
            self._session.put(key, payload, **self._how)
        except self._error as failure:
            with self._lock:
                self.lost += 1
            if not self._closed and self._first_time(f"{key} out"):
                _log.warning("nothing can be published under '%s': %s", key, failure)

    def subscribe(self, key: str, hear: Callable[[str, bytes], None]) -> None:
        """Hear what is published under a key from now on, until it is closed. A `*` stands for any one part of a key.

        Raises:
            ValueError: it is no key.
        """

        def heard(sample: zenoh.Sample) -> None:
            if self._closed or sample.kind != self._put:
                return
            name = str(sample.key_expr)
            try:
                hear(name, sample.payload.to_bytes())
            except Exception:  # noqa: BLE001 - Zenoh would drop it without a word
                with self._lock:
                    self.failed += 1
                if self._first_time(f"{name} in"):
                    _log.exception("a message under '%s' could not be taken in; further ones are only counted", name)

        try:
            self._session.declare_subscriber(key, heard)
        except self._error as failure:
            raise ValueError(f"'{key}' is no key to subscribe to: {failure}") from failure

    def close(self) -> None:
        """Leave. Nothing is heard afterwards. Idempotent; not to be called from where messages are heard."""
        self._closed = True
        close_session(self._session)

    def _first_time(self, what: str) -> bool:
        with self._lock:
            first = what not in self._told
            self._told.add(what)
        return first
