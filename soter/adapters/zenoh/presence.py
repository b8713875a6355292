"""Who says to be there: tokens that Zenoh takes away when their owner's session ends or its link breaks.

Tells people who is missing and who has gone. No decision rests on it: the token of a program that hangs stays.
"""

from __future__ import annotations

import logging
from typing import Final

import zenoh

from soter.adapters.zenoh.talk import Listener

logger = logging.getLogger(__name__)

_ALIVE: Final = "soter/alive"
_AT_ONCE: Final = 64


def announce(session: zenoh.Session, namespace: str, who: str) -> zenoh.LivelinessToken:
    """Say that somebody, such as the "mux", is there for a robot, for as long as the session lives."""
    return session.liveliness().declare_token(f"{namespace}/{_ALIVE}/{who}")


class Presence:
    """Who is there for one robot, heard of in a thread of its own.

    Args:
        session: to hear over; once it is closed, nothing is heard any more.
        namespace: of the robot.

    Attributes:
        there: their names, such as "mux" and "base".
    """

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        self.there: frozenset[str] = frozenset()
        self._namespace: Final = namespace
        changes: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(_AT_ONCE)
        subscriber = session.liveliness().declare_subscriber(f"{namespace}/{_ALIVE}/*", changes, history=True)
        self._listener: Final = Listener(subscriber, self._note)

    def _note(self, change: zenoh.Sample) -> None:
        who = str(change.key_expr).rpartition("/")[2]
        if change.kind == zenoh.SampleKind.PUT:
            self.there |= {who}
        elif who in self.there:
            self.there -= {who}
            logger.warning("%s: its %s has gone, or the link to it", self._namespace, who)
