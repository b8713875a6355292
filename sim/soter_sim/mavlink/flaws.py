"""Flaws of real ArduPilots that the simulated ones lack: `--like ardurover` and `--like arducopter`.

All were observed on an ArduPilot in its own simulator, with default parameters. Nothing is random: equal times give
equal errors.
"""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, inf, pi, sin
from typing import Final, Literal

from soter_sim.mavlink.frames import wrapped_rad
from soter_sim.mavlink.parameters import Parameters
from soter_sim.mavlink.rover import TURN_PER_S
from soter_sim.mavlink.setpoint import Place, Sample, Setpoint, Velocity

BOAT_LIKE: Final = "ardurover-boat"
LIKE: Final[dict[str, Literal["rover", "copter"]]] = {
    "ardurover": "rover", BOAT_LIKE: "rover", "arducopter": "copter", "px4": "copter",
}  # fmt: skip
"""By value of `--like`, the kind of vehicle. Of a PX4 no flaws are known: `soter_sim.mavlink.kinds.PX4_COPTER`."""

_ROAMS_M_S: Final = 0.027
_PERIOD_S: Final = 24.0
_DRIFTS_M_S2: Final = 0.03
_NOTICES_S: Final = 7.0
_SETTLES_S: Final = 2.0
_TAIL_PER_S: Final = 2.0
_CREEPS_M_S: Final = 0.01
_ROLLS_M: Final = 0.05
_ROLLS_M_S: Final = 0.05
_NORTH_RAD: Final = 0.5 * pi
_GUST_S: Final = 6.0
_SWAY_M_PER_M_S: Final = 0.04


class Flaws:
    """The flaws of one autopilot.

    - **Estimate.** At rest the EKF shows 0.027 m/s in a rotating direction, and its position rotates, too.
    - **GPS.** Without GPS (SIM_GPS_DISABLE) the position drifts, by 0.7 m in 7 s. Only then does the EKF report it, and
      the vehicle holds.
    - **Masks.** A rover takes a zero velocity without a yaw rate as the heading north, and pivots to it.
    - **Places.** A rover approaches a place at a speed that falls with the remaining distance, so that it never gets
      fast on the way to a near place, and creeps at the end.
    - **Rolling on.** A rover comes to rest slightly beyond a place. If the place is sent again, it turns round to get
      back.
    - **Arming** is refused for a while after the EKF has become ready.
    - **Wind** (SIM_WIND_SPD, in m/s) comes in gusts and sways a copter: by up to 0.3 m at 5 m/s.

    Args:
        flies: whether it is a copter.

    Attributes:
        lost: whether the EKF has noticed that there is no GPS.
        fix_s: the vehicle's time of the last fix.
    """

    def __init__(self, *, flies: bool) -> None:
        self._flies: Final = flies
        self._now_s = 0.0
        self._driven_to: Place | None = None
        self.lost = False
        self.fix_s = 0.0

    def look(self, now_s: float, *, has_gps: bool) -> None:
        """Update the time, and whether there is GPS; called in each period."""
        self._now_s = now_s
        if has_gps or now_s < self.fix_s:
            self.fix_s = now_s
        self.lost = now_s - self.fix_s > _NOTICES_S

    def estimated(self, true: Sample) -> Sample:
        """Return the EKF's estimate of a true state."""
        angle_rad = 2.0 * pi * self._now_s / _PERIOD_S
        round_m = _ROAMS_M_S * _PERIOD_S / (2.0 * pi)
        drift_m = 0.5 * _DRIFTS_M_S2 * (self._now_s - self.fix_s) ** 2
        return true._replace(
            x_m=true.x_m + round_m * sin(angle_rad) + drift_m,
            y_m=true.y_m - round_m * cos(angle_rad),
            east_m_s=true.east_m_s + _ROAMS_M_S * cos(angle_rad),
            north_m_s=true.north_m_s + _ROAMS_M_S * sin(angle_rad),
        )

    def steered(self, wanted: Setpoint, at: Sample, parameters: Parameters) -> Setpoint:
        """Return the set-point that the vehicle actually steers for, with its flaws and the wind."""
        if self._flies:
            return self._swayed(wanted, _SWAY_M_PER_M_S * parameters["SIM_WIND_SPD"])
        if isinstance(wanted, Place):
            return self._rolling(wanted, at)
        if (
            isinstance(wanted, Velocity)
            and wanted.yaw_rate_rad_s is None
            and wanted.heading_rad is None
            and hypot(wanted.east_m_s, wanted.north_m_s) == 0.0
        ):
            return replace(wanted, yaw_rate_rad_s=TURN_PER_S * wrapped_rad(_NORTH_RAD - at.heading_rad))
        return wanted

    def _rolling(self, wanted: Place, at: Sample) -> Place:
        x_m, y_m, speed_m_s = wanted.x_m, wanted.y_m, hypot(at.east_m_s, at.north_m_s)
        left_m = hypot(x_m - at.x_m, y_m - at.y_m)
        slowest_m_s = _CREEPS_M_S
        if speed_m_s > _CREEPS_M_S:
            self._driven_to = wanted
            slowest_m_s = _ROLLS_M_S
            x_m += _ROLLS_M * at.east_m_s / speed_m_s
            y_m += _ROLLS_M * at.north_m_s / speed_m_s
        elif self._driven_to is wanted and left_m <= 2.0 * _ROLLS_M:
            return replace(wanted, x_m=at.x_m, y_m=at.y_m)
        cap_m_s = inf if wanted.speed_m_s is None else wanted.speed_m_s
        return replace(wanted, x_m=x_m, y_m=y_m, speed_m_s=min(cap_m_s, max(_TAIL_PER_S * left_m, slowest_m_s)))

    def _swayed(self, wanted: Setpoint, sway_m: float) -> Setpoint:
        angle_rad = 2.0 * pi * self._now_s / _GUST_S
        if isinstance(wanted, Place):
            return replace(wanted, x_m=wanted.x_m + sway_m * sin(angle_rad), y_m=wanted.y_m + sway_m * sin(angle_rad))
        if isinstance(wanted, Velocity):
            gust_m_s = sway_m * 2.0 * pi / _GUST_S * cos(angle_rad)
            return replace(wanted, east_m_s=wanted.east_m_s + gust_m_s, north_m_s=wanted.north_m_s + gust_m_s)
        return wanted

    def refuses_to_arm(self, ready_for_s: float) -> str | None:
        """Return why it refuses to arm; None if it does not."""
        return None if ready_for_s >= _SETTLES_S else "PreArm: Need Position Estimate"
