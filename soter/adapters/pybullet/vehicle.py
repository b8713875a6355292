"""What would run on the robot itself: the gate between the controllers, and the drive."""

from __future__ import annotations

from soter.onboard.drive import Drive
from soter.onboard.mux import Mux
from soter.sdk import Controller, Goal
from soter_sim import LIMITS


class Vehicle:
    """One robot's own side; its `control` is what the world calls once each control period.

    Args:
        lease_s: motion lives this long after a renewal.
        period_s: the control period.

    Attributes:
        mux: who may move it, and the goal that does.
    """

    __slots__ = ("_drive", "mux")

    def __init__(self, lease_s: float, period_s: float) -> None:
        self.mux: Mux[Controller, Goal] = Mux(Controller.SC, lease_s)
        self._drive = Drive(LIMITS, period_s)

    def control(
        self, now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, float]:
        """Return the speed and the turn rate for the next period; see `soter_sim.Control`."""
        goal = self.mux.passing(now_s)
        return self._drive.command(x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s, None if goal is None else goal.target)
