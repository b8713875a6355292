"""Hearing and saying messages on keys, so that nothing that is wrong with one is lost, and nothing waits."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any, Final, Generic

import zenoh

from soter.adapters.zenoh.messages import Foreign, Message, decode, encode
from soter.errors import RobotUnavailable

logger = logging.getLogger(__name__)

_END_TIMEOUT_S: Final = 2.0


class Ear(Generic[Message]):
    """Hears one key in a thread of its own, and always the newest message: what comes too fast is skipped.

    Zenoh swallows what a callback raises. Here a payload that is no such message is counted and dropped, and so is a
    message that makes `take` raise; the first of each is logged.

    Args:
        session: to hear over; once it is closed, nothing is heard any more.
        key: what to hear.
        kind: the message that it carries.
        take: called with each message, in the ear's thread.
        elsewhere_only: whether to leave out what this session says itself.

    Attributes:
        key: the same.
        heard: how many messages were taken.
        foreign: how many payloads were no such message.
        failed: how many messages `take` could not take.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        kind: type[Message],
        take: Callable[[Message], object],
        *,
        elsewhere_only: bool = False,
    ) -> None:
        self.key: Final = key
        self.heard = self.foreign = self.failed = 0
        self._kind: Final[type[Message]] = kind
        self._take: Final[Callable[[Message], object]] = take
        origin = zenoh.Locality.REMOTE if elsewhere_only else zenoh.Locality.ANY
        self._subscriber: Final = session.declare_subscriber(key, zenoh.handlers.RingChannel(1), allowed_origin=origin)
        # By itself: while somebody waits at the subscriber, it cannot be ended.
        self._samples: Final = self._subscriber.handler
        self._thread: Final = threading.Thread(target=self._listen, name=f"hears {key}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hear no more, and wait for the thread unless this is it. Idempotent."""
        undeclare(self._subscriber)
        if threading.current_thread() is not self._thread:
            self._thread.join(_END_TIMEOUT_S)

    def _listen(self) -> None:
        while True:
            try:
                sample = self._samples.recv()
            except zenoh.ZError:
                # The ear, or its session, was closed.
                return
            if sample.kind == zenoh.SampleKind.PUT:
                self._hear(sample.payload.to_bytes())

    def _hear(self, payload: bytes) -> None:
        try:
            message = decode(self._kind, payload)
        except Foreign as failure:
            self.foreign += 1
            if self.foreign == 1:
                logger.warning("%s: dropped what is no %s: %s", self.key, self._kind.__name__, failure)
            return
        try:
            self._take(message)
            self.heard += 1
        except Exception:
            self.failed += 1
            if self.failed == 1:
                logger.exception("%s: dropped a message that could not be taken", self.key)


class Voice:
    """Says messages on one key, each at once or never: what a congested link cannot take is dropped. From any thread.

    Args:
        session: to say it over.
        key: where.
    """

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.key: Final = key
        self._publisher: Final = session.declare_publisher(
            key, express=True, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.REAL_TIME
        )

    def say(self, message: Any) -> None:
        """Say a message, one of `messages.KINDS`.

        Raises:
            RobotUnavailable: the session is closed.
            ValueError: a value does not fit the message.
        """
        payload = encode(message)
        try:
            self._publisher.put(payload)
        except zenoh.ZError as failure:
            raise RobotUnavailable(
                f"{self.key}: nothing can be said over a session that is closed: {failure}"
            ) from failure

    def close(self) -> None:
        """Say no more. Idempotent."""
        undeclare(self._publisher)


def undeclare(declared: Any) -> None:
    """End what a session has declared; nothing if that is over, or the session."""
    try:
        declared.undeclare()
    except zenoh.ZError as failure:
        # It was before, or its session is closed.
        logger.debug("undeclared before: %s", failure)
