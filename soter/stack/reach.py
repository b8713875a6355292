"""Makes the reach model that a mission chooses for a module from what robots promise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

from soter.config.tables import MotionModel
from soter.errors import IllFormedModule
from soter.rta import (
    Directed,
    DirectedReach,
    Motion,
    PairBound,
    PairsBound,
    ReachModel,
    SpeedAccelerationBound,
    SpeedBound,
    UnicycleBound,
)
from soter.sdk import Capabilities


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """The limits of a robot's motion, or the worst limits of several robots.

    Attributes:
        v_max_m_s: top speed.
        brake_m_s2: guaranteed deceleration.
        reverse_m_s: top speed backwards.
        yaw_rate_max_rad_s: top turn rate.
        accel_m_s2: how fast the speed grows, at most; None if not promised.
        speed_noise_m_s: largest error of a reported velocity; None if not promised.
        heading_noise_rad: largest error of a reported heading; None if not promised.
        period_s: control period.
    """

    v_max_m_s: float
    brake_m_s2: float
    reverse_m_s: float
    yaw_rate_max_rad_s: float
    accel_m_s2: float | None
    speed_noise_m_s: float | None
    heading_noise_rad: float | None
    period_s: float

    @classmethod
    def of(cls, *robots: Capabilities) -> Self:
        """Return the worst limits that any of the robots promises."""
        return cls(
            max(each.v_max_m_s for each in robots),
            min(each.brake_m_s2 for each in robots),
            max(each.v_max_m_s if each.reverses else 0.0 for each in robots),
            max(each.yaw_rate_max_rad_s for each in robots),
            _worst([each.accel_m_s2 for each in robots]),
            _worst([each.speed_noise_m_s for each in robots]),
            _worst([each.heading_noise_rad for each in robots]),
            max(each.setpoint_period_s for each in robots),
        )

    def motion(self, module: str, model: MotionModel) -> Motion:
        """Return the motion bound of a model.

        Raises:
            IllFormedModule: it needs something that a robot does not promise; nothing has moved.
        """
        if model == "speed":
            return SpeedBound(self.v_max_m_s, self.brake_m_s2)
        accel_m_s2, speed_noise_m_s = self.accel_m_s2, self.speed_noise_m_s
        if accel_m_s2 is None or speed_noise_m_s is None:
            raise _unpromised(module, model, "accel_m_s2" if accel_m_s2 is None else "speed_noise_m_s")
        if model == "speed-acceleration":
            return SpeedAccelerationBound(self.v_max_m_s, accel_m_s2, self.brake_m_s2, speed_noise_m_s)
        if self.heading_noise_rad is None:
            raise _unpromised(module, model, "heading_noise_rad")
        return UnicycleBound(
            self.v_max_m_s, accel_m_s2, self.brake_m_s2, self.yaw_rate_max_rad_s, self.reverse_m_s, speed_noise_m_s,
            self.heading_noise_rad, self.period_s,
        )  # fmt: skip


def reach_into(region: Directed, own: Motion) -> ReachModel:
    """Return the reach model of a region for a robot with this motion bound."""
    return DirectedReach(region, own) if isinstance(own, UnicycleBound) else own


def reach_between(
    region: Directed, own: Motion, other: Motion, each: Mapping[int, Motion] = MappingProxyType({})
) -> ReachModel:
    """Return the reach model of a region between a robot and its peers; `each` has the bounds of single peers."""
    if isinstance(own, SpeedBound) and isinstance(other, SpeedBound):
        speeds = {robot_id: motion for robot_id, motion in each.items() if isinstance(motion, SpeedBound)}
        return PairsBound(region, own, speeds) if speeds else PairBound(own, other)
    return DirectedReach(region, own, other, each)


def _worst(promises: Sequence[float | None]) -> float | None:
    given = [promise for promise in promises if promise is not None]
    return max(given) if len(given) == len(promises) else None


def _unpromised(module: str, model: str, promise: str) -> IllFormedModule:
    return IllFormedModule(
        module, "P3", f"the model '{model}' needs {promise}, which a robot does not promise; model = \"speed\" would do"
    )
