"""What robots assume of each other."""

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
    """Bounds that every robot of a fleet is assumed to respect: the worst that any of them promises.

    Attributes:
        v_max_m_s: top speed.
        brake_m_s2: deceleration.
        noise_m: error of a reported position.
        sample_age_s: age of a sample.
        latency_s: the least of their latencies.
        extent_m: how far a leg of a safe controller may take any of them.
        limits: all limits of their motion.
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
    """What one robot of a fleet assumes of the others.

    Attributes:
        worst: the bounds that every robot respects, this one included.
        each: by other robot, the bounds that it respects.
        speeds: by top speed in m/s, the number of other robots that have it.
    """

    worst: PeerBounds
    each: Mapping[int, PeerBounds]
    speeds: Mapping[float, int]

    @classmethod
    def of(cls, robot_id: int, fleet: Mapping[int, Capabilities], base_tick_s: float) -> Self:
        """Return what a robot assumes of the fleet that it belongs to, ticked every `base_tick_s`."""
        others = {other: each for other, each in fleet.items() if other != robot_id}
        # Robots with equal promises share one value.
        known = {each: PeerBounds.of((each,), base_tick_s) for each in set(others.values())}
        return cls(
            PeerBounds.of([*fleet.values()], base_tick_s),
            {other: known[each] for other, each in others.items()},
            Counter(each.v_max_m_s for each in others.values()),
        )

    @property
    def unlike(self) -> Mapping[int, PeerBounds]:
        """Bounds by peer, as `each`; empty if the bounds of all peers equal `worst`."""
        return {} if all(each == self.worst for each in self.each.values()) else self.each
