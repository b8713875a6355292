"""What robots have to assume of each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from soter.sdk import Capabilities
from soter.stack.reach import MotionLimits
from soter.stack.recovery import extent_m


@dataclass(frozen=True, slots=True)
class PeerBounds:
    """What every robot of a fleet is assumed to respect: the worst that any of them promises.

    Attributes:
        v_max_m_s: top speed.
        brake_m_s2: deceleration.
        noise_m: error of a reported position.
        sample_age_s: age of a sample.
        latency_s: the least until any of them acts on a command.
        extent_m: how far a leg of a safe controller may take any of them.
        limits: whatever else bounds their motion.
    """

    v_max_m_s: float
    brake_m_s2: float
    noise_m: float
    sample_age_s: float
    latency_s: float
    extent_m: float
    limits: MotionLimits

    @classmethod
    def of(cls, fleet: Sequence[Capabilities], base_tick_s: float) -> Self:
        """Return the bounds of a fleet that is ticked every `base_tick_s`."""
        return cls(
            max(each.v_max_m_s for each in fleet),
            min(each.brake_m_s2 for each in fleet),
            max(each.position_noise_m for each in fleet),
            max(each.sample_age_s for each in fleet),
            min(each.latency_s for each in fleet),
            max(extent_m(each, base_tick_s) for each in fleet),
            MotionLimits.of(*fleet),
        )


@dataclass(frozen=True, slots=True)
class Peers:
    """The other robots of a fleet, as one of them has to take them.

    Attributes:
        worst: what every robot respects, this one included.
        each: by other robot, what that one respects.
        speeds: how many of the others have each top speed, in m/s.
    """

    worst: PeerBounds
    each: Mapping[int, PeerBounds]
    speeds: Mapping[float, int]

    @classmethod
    def of(cls, robot_id: int, fleet: Mapping[int, Capabilities], base_tick_s: float) -> Self:
        """Return what a robot has to assume of a fleet, in which it is itself, ticked every `base_tick_s`."""
        others = {other: each for other, each in fleet.items() if other != robot_id}
        # Robots that promise the same are the same to it.
        known = {each: PeerBounds.of((each,), base_tick_s) for each in set(others.values())}
        return cls(
            PeerBounds.of([*fleet.values()], base_tick_s),
            {other: known[each] for other, each in others.items()},
            Counter(each.v_max_m_s for each in others.values()),
        )

    @property
    def unlike(self) -> Mapping[int, PeerBounds]:
        """Bounds by peer, as `each`; empty if those of all peers are `worst`."""
        return {} if all(each == self.worst for each in self.each.values()) else self.each
