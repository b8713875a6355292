"""Exchanges statuses between a mission's processes: each publishes its own at every tick, and hears the others'."""

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
"""Statuses under this process's own name for longer than this are not leftovers of an earlier start."""

_FOREIGN: Final = "runs another mission, or another version of its file or of SOTER"

Promised = Mapping[int, tuple[ReachModel, float]]
"""By robot id: the promised reach model and position noise."""


class PeerGroup:
    """Publishes this process's statuses, and hears the others'. Supervisor's thread only; nothing here waits.

    Args:
        bus: the bus, which is closed with this group.
        prefix: of all keys of this mission.
        me: this process's name.
        others: by name of each other process, the promises of its robots.
        mission: this process's mission; statuses of another mission are ignored.
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
        self._duplicate: tuple[int, float, float] | None = None  # epoch, its first sending time, that status's arrival
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
        """Take the received statuses. To be called before a tick."""
        for _, status, received_s in self._inbox.take():
            other = self.others.get(status.process)
            if other is not None:
                other.take(status, received_s)
                self._say_what_changed(other)
            elif status.process == self._me and status.epoch != self._epoch:
                self._look_at_duplicate(status, received_s)

    def tell(self, robots: Sequence[RobotStatus]) -> None:
        """Publish the status of a tick. Never waits."""
        now_s = self._clock.now()
        self._serial += 1
        echoes = tuple(echo for other in self.others.values() for echo in other.echoes(now_s))
        stamps = {robot.state.robot_id: robot.state.stamp_s for robot in robots}
        for other in self.others.values():
            other.note(now_s, stamps)
        status = Status(self._me, self._epoch, self._mission, self._serial, now_s, tuple(robots), echoes)
        self._bus.publish(self._key, encode(status))

    def missing(self, now_s: float, since_s: float = -math.inf) -> dict[str, str]:
        """Return the missing processes, and why, in words: this process and another must hear each other."""
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
        """Return whether another live process with this name was heard: two of them must not run."""
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
