"""What a decision module knows at a tick: this robot's sample, the peers' samples, the time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Sample(Protocol):
    """A robot's latest state. Workspace frame, ENU, metres, radians; the battery from 0 to 1.

    None means not reported: the charge, or the vertical speed.
    """

    @property
    def robot_id(self) -> int: ...
    @property
    def stamp_s(self) -> float: ...
    @property
    def x_m(self) -> float: ...
    @property
    def y_m(self) -> float: ...
    @property
    def z_m(self) -> float: ...
    @property
    def heading_rad(self) -> float: ...
    @property
    def vx_m_s(self) -> float: ...
    @property
    def vy_m_s(self) -> float: ...
    @property
    def vz_m_s(self) -> float | None: ...
    @property
    def battery(self) -> float | None: ...


class Situation:
    """One robot's view at one tick. The supervisor keeps one per robot and refreshes it.

    Attributes:
        robot_id: this robot.
        now_s: fleet time of the tick.
        own: this robot's latest sample.
        age_s: how old that sample is.
        peers: the latest samples of the robots that are near enough to matter.
    """

    __slots__ = ("age_s", "now_s", "own", "peers", "robot_id")

    def __init__(self, robot_id: int, own: Sample, now_s: float) -> None:
        self.robot_id = robot_id
        self.own = own
        self.now_s = now_s
        self.age_s = now_s - own.stamp_s
        self.peers: Sequence[Sample] = ()

    def copy(self) -> Situation:
        """Return a copy for foreign code, which may change it without affecting others."""
        made = Situation(self.robot_id, self.own, self.now_s)
        made.age_s, made.peers = self.age_s, tuple(self.peers)
        return made
