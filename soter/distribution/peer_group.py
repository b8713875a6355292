"""The processes of a mission among each other: each tells its statuses at every tick and hears those of the others."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from typing import Final

from soter.clock import Clock
from soter.distribution.bus import Bus, BusInbox
from soter.distribution.channel import new_epoch
from soter.distribution.peers import OtherProcess, RemoteRobot
from soter.distribution.status import RobotStatus, Status, decode_status
from soter.isolation.messages import encode
from soter.rta import PEER_SILENT_S, ReachModel

logger = logging.getLogger(__name__)

_DUPLICATE_S: Final = 0.3
"""What a process of one's own name says for so long is not only what an earlier start of oneself has left behind."""

_FOREIGN: Final = "runs another mission, or another version of its file or of SOTER"

Promised = Mapping[int, tuple[ReachModel, float]]
"""By robot: the reach model and the position noise that are promised for it."""


class PeerGroup:
    """What this process tells, and what it hears. Belongs to the supervisor's thread; nothing here waits.

    Args:
        bus: closed with it.
        prefix: of all keys of this mission.
        me: this process's name.
        others: the other processes with what is promised for their robots.
        mission: what this process runs; statuses of another mission are ignored.
        clock: this process's fleet time; thread-safe.
    """

    def __init__(
        self, bus: Bus, prefix: str, me: str, others: Mapping[str, Promised], mission: str, clock: Clock
    ) -> None:
        self._bus: Final = bus
        self._me: Final = me
        self._epoch: Final = new_epoch()
        self._mission: Final = mission
        self._clock: Final = clock
        self._key: Final = f"{prefix}/{me}/status"
        self._serial = 0
        self._duplicate: tuple[int, float, float] | None = None  # epoch, its first sending time, when that was received
        self._has_duplicate = False
        self._restarts: Final[dict[str, int]] = {}
        self._foreign: Final[set[str]] = set()
        self.others: Final = {
            name: OtherProcess(name, robots, me, self._epoch, mission) for name, robots in others.items()
        }
        self.peers: Final[tuple[RemoteRobot, ...]] = tuple(
            robot for other in self.others.values() for robot in other.robots.values()
        )
        self._inbox: Final = BusInbox(bus, f"{prefix}/*/status", decode_status, clock.now)

    def look(self) -> None:
        """Take what has come. To be called before a tick."""
        for _, status, received_s in self._inbox.take():
            other = self.others.get(status.process)
            if other is not None:
                other.take(status, received_s)
                self._say_what_changed(other)
            elif status.process == self._me and status.epoch != self._epoch:
                self._look_at_duplicate(status, received_s)

    def tell(self, robots: Sequence[RobotStatus]) -> None:
        """Tell the others of a tick. Never waits."""
        now_s = self._clock.now()
        self._serial += 1
        echoes = tuple(echo for other in self.others.values() for echo in other.echoes(now_s))
        stamps = {robot.state.robot_id: robot.state.stamp_s for robot in robots}
        for other in self.others.values():
            other.note(now_s, stamps)
        status = Status(self._me, self._epoch, self._mission, self._serial, now_s, tuple(robots), echoes)
        self._bus.publish(self._key, encode(status))

    def missing(self, now_s: float, since_s: float = -math.inf) -> dict[str, str]:
        """Return which processes are not there, and why, in words: both have to hear the other, after some time."""
        missing = {}
        for name, other in self.others.items():
            if other.foreign:
                missing[name] = f"it {_FOREIGN}"
            elif not other.has_heard_us:
                missing[name] = "it has not been heard yet" if not other.heard_at_all else "it does not hear this one"
            elif other.heard_s < max(since_s, now_s - PEER_SILENT_S):
                missing[name] = f"it has not been heard for {now_s - other.heard_s:.1f} s"
        return missing

    def has_duplicate(self) -> bool:
        """Return whether another process of this name was heard that lives: two of them must not run."""
        return self._has_duplicate

    def close(self) -> None:
        """Leave the bus. Idempotent."""
        self._bus.close()

    def _say_what_changed(self, other: OtherProcess) -> None:
        if other.starts > self._restarts.get(other.name, 1):
            self._restarts[other.name] = other.starts
            logger.warning("process '%s' has been started anew", other.name)
        if other.foreign and other.name not in self._foreign:
            logger.error("process '%s' %s", other.name, _FOREIGN)
        (self._foreign.add if other.foreign else self._foreign.discard)(other.name)

    def _look_at_duplicate(self, status: Status, received_s: float) -> None:
        if self._duplicate is None or self._duplicate[0] != status.epoch:
            self._duplicate = (status.epoch, status.sent_s, received_s)
        _, sent_s, since_s = self._duplicate
        self._has_duplicate |= status.sent_s - sent_s >= _DUPLICATE_S and received_s - since_s >= _DUPLICATE_S
