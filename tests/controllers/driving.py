"""A robot with the go-to-goal drive on board, without a world: its motors follow, and its link takes its time."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Final

from soter.controllers import Velocity, VelocityTracker
from soter.onboard.drive import Drive, DriveLimits
from soter.sdk import Capabilities, Link, RobotState, Waypoint
from tests.sdk.fake import CAPABILITIES

TICK_S: Final = 0.05
PERIOD_S: Final = 0.01


class Robot:
    """One robot.

    Args:
        limits: what its motors do.
        latency_s: until a goal acts; whole periods.
        age_s: of its samples; whole periods.
        reverses: whether it promises to.
        bias_m_s: what its samples, and its drive, take for its speed at rest.
    """

    def __init__(
        self,
        limits: DriveLimits | None = None,
        latency_s: float = 0.0,
        age_s: float = 0.0,
        *,
        reverses: bool = True,
        bias_m_s: float = 0.0,
    ) -> None:
        self.limits = limits = replace(limits or DriveLimits(), speed_noise_m_s=abs(bias_m_s))
        self.bias_m_s: Final = bias_m_s
        self.capabilities: Capabilities = replace(
            CAPABILITIES, v_max_m_s=self.limits.v_max_m_s, brake_m_s2=self.limits.brake_m_s2,
            yaw_rate_max_rad_s=self.limits.yaw_rate_max_rad_s, latency_s=latency_s, sample_age_s=age_s,
            setpoint_period_s=PERIOD_S, reverses=reverses, speed_noise_m_s=abs(bias_m_s),
        )  # fmt: skip
        self.tracker = VelocityTracker(self.capabilities, TICK_S)
        self.drive = Drive(self.limits, PERIOD_S)
        self.time_s = self.x_m = self.y_m = self.heading_rad = self.speed_m_s = self.turn_rad_s = 0.0
        self.turned_rad = self.driven_m = 0.0
        self._samples: deque[RobotState] = deque(maxlen=round(age_s / PERIOD_S) + 1)
        self._goals: deque[Waypoint | None] = deque([None] * (round(latency_s / PERIOD_S) + 1))
        self._sample()

    def run(self, forward_m_s: float, turn_rad_s: float, seconds: float) -> None:
        """Ask for a velocity for so long."""
        for _ in range(round(seconds / TICK_S)):
            goal = self.tracker.goal(self._samples[0], Velocity(forward_m_s, turn_rad_s), self.time_s)
            goal.check()
            self.coast(TICK_S, goal)

    def coast(self, seconds: float, goal: Waypoint | None = None) -> None:
        """Go on for so long with a goal, or with the last one."""
        for _ in range(round(seconds / PERIOD_S)):
            self._goals.append(self._goals[-1] if goal is None else goal)
            self._period(self._goals.popleft())

    def _period(self, goal: Waypoint | None) -> None:
        limits, before_m_s = self.limits, self.speed_m_s
        speed, turn = self.drive.command(
            self.x_m, self.y_m, self.heading_rad, self.speed_m_s + self.bias_m_s, self.turn_rad_s, goal
        )
        gain, loss = limits.accel_m_s2 * PERIOD_S, limits.brake_m_s2 * PERIOD_S
        faster = speed * self.speed_m_s >= 0.0 and abs(speed) > abs(self.speed_m_s)
        most = gain if faster else loss
        self.speed_m_s += max(-most, min(most, speed - self.speed_m_s))
        most = limits.yaw_accel_rad_s2 * PERIOD_S
        self.turn_rad_s += max(-most, min(most, turn - self.turn_rad_s))
        way_m, turned_rad = 0.5 * (before_m_s + self.speed_m_s) * PERIOD_S, self.turn_rad_s * PERIOD_S
        self.x_m += way_m * math.cos(self.heading_rad + 0.5 * turned_rad)
        self.y_m += way_m * math.sin(self.heading_rad + 0.5 * turned_rad)
        self.heading_rad = math.remainder(self.heading_rad + turned_rad, math.tau)
        self.turned_rad += turned_rad
        self.driven_m += way_m
        self.time_s += PERIOD_S
        self._sample()

    def _sample(self) -> None:
        shown_m_s = self.speed_m_s + self.bias_m_s
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        self._samples.append(RobotState(
            1, self.time_s, self.time_s, self.x_m, self.y_m, 0.0, self.heading_rad, shown_m_s * c,
            shown_m_s * s, self.turn_rad_s, None, None, None, Link.UP,
        ))  # fmt: skip
