"""The gate of velocity-controlled robots."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from soter.onboard.gate import Gate


class Velocity(NamedTuple):
    """A velocity for a differential-drive robot: speed along its heading, and turn rate counter-clockwise."""

    forward_m_s: float = 0.0
    turn_rad_s: float = 0.0


REST: Final = Velocity()


class VelocityGate(Gate[Velocity]):
    """Passes the velocity of the active controller, within the limits, while its lease lives.

    Args:
        v_max_m_s: limit of the speed that passes.
        yaw_rate_max_rad_s: limit of the turn rate that passes.
    """

    def __init__(self, lease_s: float, command_s: float, v_max_m_s: float, yaw_rate_max_rad_s: float) -> None:
        for name, value in (("v_max_m_s", v_max_m_s), ("yaw_rate_max_rad_s", yaw_rate_max_rad_s)):
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} is {value}, allowed: finite and above 0")
        super().__init__(lease_s, command_s)
        self._v_max_m_s: Final = v_max_m_s
        self._yaw_rate_max_rad_s: Final = yaw_rate_max_rad_s

    def give(self, by: str, command: Velocity, now_s: float) -> bool:
        """Take a controller's velocity, rest if it is not finite; return whether the controller is active."""
        return super().give(by, command if math.isfinite(command.forward_m_s + command.turn_rad_s) else REST, now_s)

    def passing(self, now_s: float) -> Velocity | None:
        """Return the velocity that may move the robot now, within the limits, or None for rest."""
        velocity = super().passing(now_s)
        if velocity is None:
            return None
        v_m_s, turn_rad_s = self._v_max_m_s, self._yaw_rate_max_rad_s
        return Velocity(
            max(-v_m_s, min(v_m_s, velocity.forward_m_s)), max(-turn_rad_s, min(turn_rad_s, velocity.turn_rad_s))
        )
