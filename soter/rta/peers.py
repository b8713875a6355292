"""Robots of other supervisors: what is heard of them, and what they are known to have heard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

from soter.rta.monitors import Finding
from soter.rta.situation import Sample

PEER_SILENT_S: Final = 0.5
"""A robot that is not heard of for longer may not be driven, nor may those that have not heard of it."""


class RemotePeer(Protocol):
    """A robot that another process supervises. Asked in the supervisor's thread, at every tick; never waits."""

    robot_id: int

    def sample(self) -> Sample | None:
        """Return the latest sample, or None while there is none.

        Its stamp is in this process's fleet time, never later than the sample really was taken, and never goes back.
        """

    def heard_of(self, robot_id: int) -> float:
        """Return the stamp of the latest sample of one of this process's robots that the peer has said it heard.

        In this process's fleet time; minus infinity while it has said nothing.
        """

    def needs_charge(self) -> bool:
        """Return whether it is on its way to charge, and low."""

    def found(self) -> Finding | None:
        """Return what is wrong with what it reports of itself, if anything, and forget it."""


@dataclass(frozen=True, slots=True)
class StillSample:
    """The last sample of a robot that has come to rest unheard, with a later stamp.

    At its top speed from the stamp on it could get as far as it can really have got; see `StillPeers`.
    """

    robot_id: int
    stamp_s: float
    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float | None
    battery: float | None


class StillPeers:
    """Bounds the whereabouts of robots that are silent.

    A robot that its supervisor does not hear of is not driven on, its lease runs out, and it stands. A robot of another
    supervisor holds when it does not know that it is heard. So both come to rest, and however long they
    stay silent they are no farther from their last sample than top speed takes them in `still_s`.

    Args:
        still_s: how long a silent robot moves on at most after its last sample, if braking counts as half.
    """

    def __init__(self, still_s: float) -> None:
        self.still_s: Final = still_s

    def bounded(self, now_s: float, sample: Sample) -> Sample:
        """Return a sample that bounds where the robot is now, the same one while the robot may still move."""
        least_s = now_s - self.still_s
        if sample.stamp_s >= least_s:
            return sample
        return StillSample(
            sample.robot_id, least_s, sample.x_m, sample.y_m, sample.z_m, sample.heading_rad,
            sample.vx_m_s, sample.vy_m_s, sample.vz_m_s, sample.battery,
        )  # fmt: skip
