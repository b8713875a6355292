"""Figures of robots that modules need: an implementation of docs/assurance.md's conditions for drawing only."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soter.sdk import Capabilities


@dataclass(frozen=True)
class Figures:
    """The worst of a fleet's promises, and its base tick.

    Attributes:
        promise: the worst speed, brakes, latency, age, jitter, noise, lease, radius.
        slowest_m_s: top speed of the slowest robot.
    """

    promise: Capabilities
    tick_s: float
    slowest_m_s: float

    def reach_m(self, delta_s: float) -> float:
        """Return how far a robot gets within a module's horizon and while it then brakes."""
        p = self.promise
        ahead_s = max(2.0 * delta_s, delta_s - self.tick_s + p.lease_s)
        return p.v_max_m_s * (ahead_s + p.latency_s + p.sample_age_s + p.jitter_s) + self.braking_m

    @property
    def braking_m(self) -> float:
        """The braking distance from top speed."""
        return self.promise.v_max_m_s**2 / (2.0 * self.promise.brake_m_s2)

    @property
    def leg_m(self) -> float:
        """Length of a safe controller's longest leg."""
        p = self.promise
        return p.v_max_m_s * (self.tick_s + p.latency_s + p.sample_age_s) + self.braking_m

    @property
    def early_s(self) -> float:
        """How much earlier the AC has to lose control if two robots meet, so that both can stop."""
        p = self.promise
        aside_m = p.v_max_m_s * (self.tick_s + p.latency_s) / 2.0
        return p.v_max_m_s / (2.0 * p.brake_m_s2) - math.sqrt(aside_m / p.brake_m_s2)

    def spare_m(self, delta_s: float) -> float:
        """Return the distance that a module with this Delta needs between phi_safe and phi_safer, noise included."""
        return self.reach_m(delta_s) + self.promise.position_noise_m


def worst(promises: list[Capabilities]) -> Capabilities:
    """Return one promise with the worst of several in each figure used here."""
    first = promises[0]
    values = {name: getattr(first, name) for name in Capabilities.__slots__}
    for name in (
        "v_max_m_s", "body_radius_m", "latency_s", "sample_age_s", "jitter_s", "lease_s", "position_noise_m", "tube_m",
        "overshoot_m",
    ):  # fmt: skip
        values[name] = max(getattr(each, name) for each in promises)
    values["brake_m_s2"] = min(each.brake_m_s2 for each in promises)
    for name in ("accel_m_s2", "speed_noise_m_s", "heading_noise_rad"):
        given = [getattr(each, name) for each in promises]
        values[name] = None if None in given else max(given)
    return Capabilities(**values)
