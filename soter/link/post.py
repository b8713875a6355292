"""The machines' post of one process: a channel to each other process, over one bus."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Iterable
from typing import Final

from soter.link.bus import Bus, Inbox
from soter.link.channel import Came, Channel, Letter, decode_frame, encode_frame

logger = logging.getLogger(__name__)

_EPOCH_BITS: Final = 61


def new_epoch() -> int:
    """Return a number that no other start of any process has."""
    return secrets.randbits(_EPOCH_BITS) + 1


class Post:
    """Sends and delivers letters. One thread, but for what the bus does.

    Args:
        bus: closed with it.
        prefix: of all keys of this mission.
        me: this process's name.
        others: the processes that letters go to and come from.
        mission: what this process runs.
    """

    def __init__(self, bus: Bus, prefix: str, me: str, others: Iterable[str], mission: str) -> None:
        self._bus: Final = bus
        self._prefix: Final = prefix
        self._me: Final = me
        epoch = new_epoch()
        self._channels: Final = {name: Channel(epoch, mission, new_epoch) for name in others}
        self._said_foreign: Final[set[str]] = set()
        self._inbox: Final = Inbox(bus, f"{prefix}/*/letters/{me}", decode_frame, lambda: 0.0)

    def send(self, to: str, letter: Letter) -> None:
        """Have a letter delivered to a process as it lives now; dropped while it has not come."""
        self._channels[to].send(letter)

    def pump(self, now_s: float) -> list[tuple[str, Letter | Came]]:
        """Take what has come and send what is due; return what was delivered, with the process that it is from."""
        delivered: list[tuple[str, Letter | Came]] = []
        for key, frame, _ in self._inbox.take():
            sender = key.removeprefix(f"{self._prefix}/").partition("/")[0]
            channel = self._channels.get(sender)
            if channel is None:
                continue
            for each in channel.take(frame):
                if isinstance(each, Came):
                    logger.info("process '%s' is there", sender)
                delivered.append((sender, each))
            if channel.foreign and sender not in self._said_foreign:
                self._said_foreign.add(sender)
                logger.error("process '%s' runs another mission; letters to and from it are dropped", sender)
        for name, channel in self._channels.items():
            for frame in channel.due(now_s):
                self._bus.publish(f"{self._prefix}/{self._me}/letters/{name}", encode_frame(frame))
        return delivered

    def close(self) -> None:
        """Leave the bus. Idempotent."""
        self._bus.close()
