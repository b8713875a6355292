"""Impaired vehicles: wheels that slip, worn brakes, dead motors.

An impairment changes the command between a robot's control and the engine, so that it is the same on every engine: the
engine moves a body as commanded, and the command is what the wheels still bring to the ground.
"""

from __future__ import annotations

from math import isfinite
from typing import Final, NamedTuple

from soter.onboard.drive import DriveLimits
from soter_sim.bodies import Control

TRACK_M: Final = 0.14
"""Distance between the two wheels."""


class Impairment(NamedTuple):
    """The impairment of one vehicle; none by default.

    Attributes:
        left: part of the left wheel's motion that reaches the ground, from 0 to 1.
        right: part of the right wheel's motion that reaches the ground, from 0 to 1.
        brake: part of the deceleration that the brakes still have, from 0 to 1.
        alive: whether the motors are on; if not, they brake.
    """

    left: float = 1.0
    right: float = 1.0
    brake: float = 1.0
    alive: bool = True


def impaired(control: Control, impairment: Impairment, period_s: float, limits: DriveLimits) -> Control:
    """Return the control of an impaired vehicle.

    Args:
        control: the control of the intact vehicle.
        impairment: its impairment.
        period_s: the control period.
        limits: the limits of the intact vehicle.

    Raises:
        ValueError: a part is not between 0 and 1.
    """
    left, right, brake, alive = impairment
    for name, part in (("left", left), ("right", right), ("brake", brake)):
        if not 0.0 <= part <= 1.0:
            raise ValueError(f"{name} is {part}, allowed: 0 to 1")
    slower = brake * limits.brake_m_s2 * period_s

    def steered(
        now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, float]:
        v_to = w_to = 0.0
        if alive:
            v_to, w_to = control(now_s, x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s)
            v_to = _limited(v_to, limits.v_max_m_s)
            w_to = _limited(w_to, limits.yaw_rate_max_rad_s)
        if left != 1.0 or right != 1.0:
            half = 0.5 * TRACK_M * w_to
            on_left, on_right = left * (v_to - half), right * (v_to + half)
            v_to, w_to = 0.5 * (on_left + on_right), (on_right - on_left) / TRACK_M
        # Worn brakes cannot bring the speed below this within one period.
        least = abs(v_m_s) - slower
        if brake < 1.0 and least > 0.0:
            v_to = max(v_to, least) if v_m_s > 0.0 else min(v_to, -least)
        return v_to, w_to

    return steered


def _limited(value: float, most: float) -> float:
    """Return a command clamped as the engines do."""
    return max(-most, min(most, value)) if isfinite(value) else 0.0
