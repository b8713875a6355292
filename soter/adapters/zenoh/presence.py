"""Who says to be there: tokens that Zenoh takes away when their owner's session ends or its link breaks.

Tells people who is missing and who has gone. No decision rests on it: the token of a program that hangs stays.
"""

from __future__ import annotations

import logging
import threading
from typing import Final

import zenoh

from soter.adapters.zenoh.talk import undeclare

logger = logging.getLogger(__name__)

_ALIVE: Final = "soter/alive"
_END_TIMEOUT_S: Final = 2.0
_AT_ONCE: Final = 64


def announce(session: zenoh.Session, namespace: str, who: str) -> zenoh.LivelinessToken:
    """Say that somebody, such as the "mux", is there for a robot, for as long as the session lives."""
    return session.liveliness().declare_token(f"{namespace}/{_ALIVE}/{who}")


class Presence:
    """Who is there for one robot, heard of in a thread of its own.

    Args:
        session: to hear over.
        namespace: of the robot.

    Attributes:
        there: their names, such as "mux" and "base".
    """

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        self.there: frozenset[str] = frozenset()
        self._namespace: Final = namespace
        self._subscriber: Final = session.liveliness().declare_subscriber(
            f"{namespace}/{_ALIVE}/*", zenoh.handlers.FifoChannel(_AT_ONCE), history=True
        )
        self._changes: Final = self._subscriber.handler
        self._thread: Final = threading.Thread(target=self._listen, name=f"who is at {namespace}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hear no more. Idempotent."""
        undeclare(self._subscriber)
        self._thread.join(_END_TIMEOUT_S)

    def _listen(self) -> None:
        while True:
            try:
                change = self._changes.recv()
            except zenoh.ZError:
                return
            who = str(change.key_expr).rpartition("/")[2]
            if change.kind == zenoh.SampleKind.PUT:
                self.there |= {who}
            elif who in self.there:
                self.there -= {who}
                logger.warning("%s: its %s has gone, or the link to it", self._namespace, who)
