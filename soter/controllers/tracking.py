"""Turns velocities into goals for go-to-goal robots: each becomes a goal a short way ahead."""

from __future__ import annotations

import math
from typing import Final

from soter.onboard.velocity import Velocity
from soter.sdk import Capabilities, RobotState, Waypoint

LEAD_RAD: Final = 0.15
"""Largest bearing of the goal of a robot that drives: at more, it would stop and turn in place first."""

START_RAD: Final = 0.015
"""Largest bearing for a robot that begins to drive: at more, it would turn in place instead."""

TURN_RAD: Final = 1.0
"""Largest bearing for a robot that turns in place."""

_AHEAD_M: Final = 0.04
_BEYOND_M: Final = 0.01
_RESTS_M_S: Final = 0.01
_PAUSE_S: Final = 0.5
_RADIUS_M: Final = 0.005


class VelocityTracker:
    """Turns the requested velocities of one robot into goals, one at a time, for its go-to-goal control.

    A goal is as far ahead as the robot gets until the next goal acts, plus its braking distance. So a robot whose
    controller falls silent stops within `ahead_m` by itself. A goal to one side makes the robot steer: requested turn
    rates are integrated, and a small remainder that the robot has not turned yet is made up for.

    A robot that runs `soter.onboard.drive` (the simulated ones, those on ROS 2 and Zenoh, and those of the example
    adapters) tracks:

    - speed forwards, up to its top speed; and backwards if it promises `reverses`, else it stands;
    - turn rate while it drives, up to 0.75 rad/s, or 0.6 and 0.4 with a latency of 0.05 and 0.15 s; the heading lags by
      a sixth of a second. Turn rates beyond that are not made up for later;
    - turn rate in place, up to its own.

    All of this is late by at most `delay_s` (a tick, the robot's latency, its samples' age and its control period),
    while the robot goes on as before: its position is off by the change of velocity times that. Accelerations are the
    robot's own. A change between forwards and backwards, or between driving and turning in place, takes a stop.
    Sideways velocities cannot be requested. Other vehicles steer in their own way, within the same goals. A vehicle
    whose autopilot takes no heading to arrive with, such as a MAVLink rover without SOTER's gate, refuses to turn in
    place and to drive backwards: those goals are rejected, and it stops at the goal before.

    Args:
        robot: the robot's promises.
        tick_s: how often it is given a goal.

    Attributes:
        delay_s: longest time from a sample until the robot acts on the goal computed from it.
    """

    def __init__(self, robot: Capabilities, tick_s: float) -> None:
        self.delay_s: Final = tick_s + robot.latency_s + robot.sample_age_s + robot.setpoint_period_s
        self._robot: Final = robot
        self._tick_s: Final = tick_s
        self._last_goal_s = -math.inf
        self._heading_rad = 0.0
        self._stops_at: tuple[float, float] | None = None

    def ahead_m(self, speed_m_s: float) -> float:
        """Return how far ahead the goal of a robot at this speed is."""
        return speed_m_s * (self._tick_s + self.delay_s) + speed_m_s**2 / (2.0 * self._robot.brake_m_s2) + _AHEAD_M

    def goal(self, own: RobotState, asked: Velocity, now_s: float) -> Waypoint:
        """Return where to send the robot now, with a cap on its speed; `asked` must be finite."""
        robot = self._robot
        speed_m_s = max(-robot.v_max_m_s if robot.reverses else 0.0, min(robot.v_max_m_s, asked.forward_m_s))
        turn_rad_s = max(-robot.yaw_rate_max_rad_s, min(robot.yaw_rate_max_rad_s, asked.turn_rad_s))
        drives = abs(speed_m_s) > _RESTS_M_S
        moves_m_s = own.vx_m_s * math.cos(own.heading_rad) + own.vy_m_s * math.sin(own.heading_rad)
        rest_m_s = _RESTS_M_S + (robot.speed_noise_m_s or 0.0)
        rests = abs(moves_m_s) <= rest_m_s
        # Extrapolate the sample to now.
        x_m, y_m, heading_rad = _on(own.x_m, own.y_m, own.heading_rad, moves_m_s, own.yaw_rate_rad_s, own.age_s(now_s))
        passed_s, self._last_goal_s = now_s - self._last_goal_s, now_s
        if passed_s > _PAUSE_S or not (drives or turn_rad_s):
            self._heading_rad, passed_s = heading_rad, self._tick_s
        # Limit the remaining turn, so that a robot that falls behind does not turn on for long.
        most_rad = TURN_RAD if not drives else START_RAD if rests else LEAD_RAD
        left_rad = math.remainder(self._heading_rad + turn_rad_s * passed_s - heading_rad, math.tau)
        self._heading_rad = wanted_rad = heading_rad + max(-most_rad, min(most_rad, left_rad))
        if drives:
            self._stops_at = None
            way_m = math.copysign(self.ahead_m(abs(speed_m_s)), speed_m_s)
            x_m, y_m = x_m + way_m * math.cos(wanted_rad), y_m + way_m * math.sin(wanted_rad)
            # A leg to a place behind that ends with the present heading is driven backwards.
            return Waypoint(x_m, y_m, 0.0, wanted_rad if speed_m_s < 0.0 else None, abs(speed_m_s), _RADIUS_M)
        if rests:
            self._stops_at = x_m, y_m
        elif self._stops_at is None:
            # Not nearer than where it could stop now: it would turn back to such a goal.
            stop_s = robot.latency_s + abs(moves_m_s) / (2.0 * robot.brake_m_s2) + _BEYOND_M / abs(moves_m_s)
            self._stops_at = _on(x_m, y_m, heading_rad, moves_m_s, own.yaw_rate_rad_s, stop_s)[:2]
        aligned = turn_rad_s or moves_m_s < -rest_m_s
        return Waypoint(*self._stops_at, 0.0, wanted_rad if aligned else None, None, _RADIUS_M)


def _on(
    x_m: float, y_m: float, heading_rad: float, speed_m_s: float, turn_rad_s: float, seconds: float
) -> tuple[float, float, float]:
    """Return a robot's place and heading after some seconds at constant speed and turn rate."""
    middle_rad, way_m = heading_rad + 0.5 * turn_rad_s * seconds, speed_m_s * seconds
    return x_m + way_m * math.cos(middle_rad), y_m + way_m * math.sin(middle_rad), heading_rad + turn_rad_s * seconds
