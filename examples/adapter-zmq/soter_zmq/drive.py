"""How a robot drives to a place: brake, turn on the spot, drive straight, stop there. Plain east and north inside."""

from __future__ import annotations

import math
from typing import Final

from soter_zmq.wire import BRAKE_M_S2, PERIOD_S, V_MAX_M_S, YAW_RATE_MAX_RAD_S, GoalMessage, heading_rad

TUBE_M: Final = 0.02
"""A leg strays from the straight line by no more than this."""

OVERSHOOT_M: Final = 0.01
"""It ends beyond its target by no more than this."""

ACCEL_M_S2: Final = 1.0
YAW_ACCEL_RAD_S2: Final = 8.0

_THERE_M: Final = 0.004
_NEAR_M: Final = 0.03
_REST_M_S: Final = 0.005
_REST_RAD_S: Final = 0.2
_ALIGNED_RAD: Final = 0.02
_ASTRAY_RAD: Final = 0.15
_STEER_PER_S: Final = 6.0
# Turns are planned with less than the whole yaw brake, so that they do not swing past.
_YAW_BRAKE_RAD_S2: Final = 0.7 * YAW_ACCEL_RAD_S2


def drive(
    x_m: float, y_m: float, angle_rad: float, v_m_s: float, yaw_rate_rad_s: float, goal: GoalMessage | None
) -> tuple[float, float]:
    """Return the speed along the heading in m/s and the turn rate in rad/s to steer for.

    A goal with a heading is driven to backwards where that arrives nearer to it; what is left is turned at the end.

    Args:
        x_m: metres east.
        y_m: metres north.
        angle_rad: heading, counter-clockwise from east.
        v_m_s: speed along the heading, negative backwards.
        yaw_rate_rad_s: turn rate, counter-clockwise.
        goal: where to go; None to brake.
    """
    if goal is None:
        return 0.0, 0.0
    dx_m, dy_m = goal.east_m - x_m, goal.north_m - y_m
    distance_m = math.hypot(dx_m, dy_m)
    wanted_rad = None if goal.heading_deg is None else heading_rad(goal.heading_deg)
    resting = abs(v_m_s) <= _REST_M_S
    if distance_m <= _THERE_M or (resting and distance_m <= 2.0 * _THERE_M):
        if not resting or wanted_rad is None:
            return 0.0, 0.0
        error_rad = _wrapped(wanted_rad - angle_rad)
        return 0.0, 0.0 if abs(error_rad) <= _ALIGNED_RAD else _turn(error_rad)
    backwards = wanted_rad is not None and math.cos(wanted_rad) * dx_m + math.sin(wanted_rad) * dy_m < 0.0
    error_rad = _wrapped(math.atan2(dy_m, dx_m) - angle_rad + (math.pi if backwards else 0.0))
    sign = -1.0 if backwards else 1.0
    if resting:
        if abs(error_rad) > _ALIGNED_RAD or abs(yaw_rate_rad_s) > _REST_RAD_S:
            return 0.0, _turn(error_rad)
    elif v_m_s * sign < 0.0 or abs(error_rad) > (_ASTRAY_RAD if distance_m > _NEAR_M else 0.5 * math.pi):
        return 0.0, 0.0
    turn = 0.0
    if distance_m > _NEAR_M:
        # So near to the place the bearing says little, and the heading is right already.
        turn = _STEER_PER_S * error_rad
    along_m = distance_m * math.cos(error_rad)
    step_m_s = BRAKE_M_S2 * PERIOD_S
    speed_m_s = math.sqrt(step_m_s * step_m_s + 2.0 * BRAKE_M_S2 * max(0.0, along_m)) - step_m_s
    return sign * min(speed_m_s, V_MAX_M_S, goal.speed_m_s or V_MAX_M_S), turn


def _turn(error_rad: float) -> float:
    """Return the turn rate that, after one more period and braking, has turned by `error_rad`."""
    step_rad_s = _YAW_BRAKE_RAD_S2 * PERIOD_S
    rate = math.sqrt(step_rad_s * step_rad_s + 2.0 * _YAW_BRAKE_RAD_S2 * abs(error_rad)) - step_rad_s
    return math.copysign(min(rate, YAW_RATE_MAX_RAD_S), error_rad)


def _wrapped(angle_rad: float) -> float:
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
