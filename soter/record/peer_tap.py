"""Writes down what a supervisor learns of a robot of another process, and changes none of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from msgspec import UNSET

from soter.record.messages import Heard, Peer
from soter.record.samples import state_of
from soter.rta import RemotePeer, Sample
from soter.rta.monitors import Finding
from soter.sdk import RobotState


class PeerTap:
    """A `RemotePeer` in front of another one. What it says at a tick is settled when it is asked for a sample.

    Args:
        inner: the other one.
        robot_ids: the robots of this process.
    """

    def __init__(self, inner: RemotePeer, robot_ids: Sequence[int]) -> None:
        self.robot_id = inner.robot_id
        self._inner: Final = inner
        self._robot_ids: Final = tuple(robot_ids)
        self._sample: Sample | None = None
        self._heard: dict[int, float] = {}
        self._needs_charge = False
        self._found: Finding | None = None

    def sample(self) -> Sample | None:
        inner = self._inner
        self._sample, self._found = inner.sample(), inner.found()
        self._heard = {robot_id: inner.heard_of(robot_id) for robot_id in self._robot_ids}
        self._needs_charge = inner.needs_charge()
        return self._sample

    def heard_of(self, robot_id: int) -> float:
        return self._heard.get(robot_id, -math.inf)

    def needs_charge(self) -> bool:
        return self._needs_charge

    def found(self) -> Finding | None:
        return self._found

    def message(self, now_s: float) -> Peer:
        """Return what was said at the tick at `now_s`."""
        sample, found = self._sample, self._found
        assert sample is None or isinstance(sample, RobotState)
        return Peer(
            now_s,
            self.robot_id,
            UNSET if sample is None else state_of(sample),
            tuple(Heard(robot_id, stamp_s) for robot_id, stamp_s in self._heard.items() if math.isfinite(stamp_s)),
            self._needs_charge,
            "" if found is None else found.assumption.id,
            "" if found is None else found.cause,
        )
