"""What a robot promises, and which changes of it the proofs do not allow for. Metres, seconds, radians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from numbers import Real
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from soter.sdk.values import RobotState

_MOVING_M_S: Final = 0.02

REST_M_S: Final = 1e-3
REST_RAD_S: Final = 1e-2
"""Turn rate up to which a robot without noise counts as standing still."""

ABOVE_0: Final = (
    "v_max_m_s", "yaw_rate_max_rad_s", "brake_m_s2", "setpoint_period_s", "lease_s", "accel_m_s2",
)  # fmt: skip
_AT_LEAST_0: Final = (
    "body_radius_m", "latency_s", "sample_age_s", "jitter_s", "tube_m", "overshoot_m", "position_noise_m",
    "speed_noise_m_s", "heading_noise_rad",
)  # fmt: skip
_UNPROMISED: Final = ("accel_m_s2", "speed_noise_m_s", "heading_noise_rad")
"""These may be None."""

_LEAST: Final = 1e-6
_MOST: Final = 1e6
"""No robot is beyond these, and no quotient of two such figures is beyond what a float holds."""


def is_finite(value: float) -> bool:
    """Return whether a number is finite as a Python float; compared in 32 bits, a limit could itself be infinite."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a robot promises. The proofs rest on these numbers, and the conformance kit measures them.

    Attributes:
        in_process: the robot lives in this process, in virtual time.
        deterministic: the same calls give the same samples, bit for bit.
        reverses: it can drive backwards.
        reports_battery: samples carry a charge.
        reports_controller: samples carry the controller in charge.
        v_max_m_s: top speed, clamped on the robot's side.
        yaw_rate_max_rad_s: top turn rate.
        brake_m_s2: deceleration that it never falls short of.
        body_radius_m: a disc of this radius around the position holds the whole body.
        latency_s: from a call to the moment the vehicle acts on it, at most.
        sample_age_s: age of the latest sample when it is read, at most.
        jitter_s: how late a tick may come, at most.
        setpoint_period_s: the vehicle's own control period.
        lease_s: without renewal for this long the vehicle stops by itself.
        tube_m: how far the vehicle strays from the straight segment to its target, at most.
        overshoot_m: how far it runs beyond a target, at most.
        position_noise_m: error of a reported position, at most.
        pivots_first: it turns in place before it drives.
        accel_m_s2: how fast its speed along the heading grows, at most; None if not promised.
        speed_noise_m_s: error of a reported velocity, at most; None if not promised.
        heading_noise_rad: error of a reported heading, at most; None if not promised.
    """

    in_process: bool
    deterministic: bool
    reverses: bool
    reports_battery: bool
    reports_controller: bool
    v_max_m_s: float
    yaw_rate_max_rad_s: float
    brake_m_s2: float
    body_radius_m: float
    latency_s: float
    sample_age_s: float
    jitter_s: float
    setpoint_period_s: float
    lease_s: float
    tube_m: float
    overshoot_m: float
    position_noise_m: float
    pivots_first: bool
    accel_m_s2: float | None = None
    speed_noise_m_s: float | None = None
    heading_noise_rad: float | None = None

    def __post_init__(self) -> None:
        """Check that every figure is one.

        Raises:
            ValueError: names it, its value, and what is allowed.
        """
        for name in (*ABOVE_0, *_AT_LEAST_0):
            value: Any = getattr(self, name)
            real, above = isinstance(value, Real), name in ABOVE_0
            if value is None and name in _UNPROMISED:
                continue
            least = _LEAST if above else 0.0
            if not real or not is_finite(value) or not least <= value <= _MOST:
                raise ValueError(f"Capabilities.{name} is {value!r}, allowed: a number from {least:g} to {_MOST:g}")

    @property
    def moving_m_s(self) -> float:
        """Reported speed above which a robot moves, whatever the noise; at or below it, the robot may stand."""
        return _MOVING_M_S + (self.speed_noise_m_s or 0.0)

    @property
    def rest_rad_s(self) -> float:
        """Reported yaw rate up to which a robot may stand; speed noise bounds how fast its rim seems to move, too."""
        noise_m_s, radius_m = self.speed_noise_m_s or 0.0, self.body_radius_m
        return max(REST_RAD_S, noise_m_s / radius_m) if radius_m > 0.0 else REST_RAD_S

    def rests(self, state: RobotState) -> bool:
        """Return whether a robot that reports this state stands still, as far as its noise allows to tell."""
        fast_m_s = math.hypot(state.vx_m_s, state.vy_m_s)
        return fast_m_s <= REST_M_S + (self.speed_noise_m_s or 0.0) and abs(state.yaw_rate_rad_s) <= self.rest_rad_s

    def unrest(self, state: RobotState) -> str:
        """Return, in words, why a robot that was told to stand and reports this state does not count as standing."""
        speed_m_s = math.hypot(state.vx_m_s, state.vy_m_s)
        return (
            f"it does not come to rest although it has no goal: it reports {speed_m_s:.3f} m/s and "
            f"{state.yaw_rate_rad_s:.3f} rad/s; does something else move it? If not, that is noise, and "
            f"promise.speed_noise_m_s = {self.speed_noise_m_s} allows too little of it"
        )

    def widened_beyond(self, declared: Capabilities) -> str | None:
        """Return the name of the first promise that is worse than `declared`, as `WIDENS` says; None if none is."""
        for name in self.__slots__:
            mine, theirs = getattr(self, name), getattr(declared, name)
            # A figure that is not promised may be anything.
            mine, theirs = (math.inf if each is None else each for each in (mine, theirs))
            # Written so that NaN counts as worse.
            up, down = mine <= theirs, mine >= theirs
            if not {Widens.UP: up, Widens.DOWN: down, Widens.EITHER_WAY: up and down}[WIDENS[name]]:
                return name
        return None


class Widens(Enum):
    """The direction of change of a promise that lets a robot do what the proofs rule out."""

    UP = "up"
    DOWN = "down"
    EITHER_WAY = "either way"


WIDENS: Final[Mapping[str, Widens]] = {
    "in_process": Widens.EITHER_WAY,
    "deterministic": Widens.UP,
    # A robot may lack an ability of its class, and is then supervised without it; it may not claim more.
    "reverses": Widens.UP,
    "reports_battery": Widens.UP,
    "reports_controller": Widens.UP,
    "v_max_m_s": Widens.UP,
    # Faster turns lead where nothing was checked; slower ones take longer than waits and return paths are paid for.
    "yaw_rate_max_rad_s": Widens.EITHER_WAY,
    "brake_m_s2": Widens.DOWN,
    "body_radius_m": Widens.UP,
    "latency_s": Widens.UP,
    "sample_age_s": Widens.UP,
    "jitter_s": Widens.UP,
    "setpoint_period_s": Widens.UP,
    "lease_s": Widens.UP,
    "tube_m": Widens.UP,
    "overshoot_m": Widens.UP,
    "position_noise_m": Widens.UP,
    "pivots_first": Widens.UP,
    "accel_m_s2": Widens.UP,
    "speed_noise_m_s": Widens.UP,
    "heading_noise_rad": Widens.UP,
}
"""By promise, for all fields of `Capabilities`: which change widens it."""
