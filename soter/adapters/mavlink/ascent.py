"""Has a copter climb to the height at which it is flown, from the ground or from wherever it hovers."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.vehicle import Vehicle
from soter.sdk import Controller

_NEAR_M: Final = 0.25
_CLIMBS_M_S: Final = 0.1
_TAKES_OFF_S: Final = 6.0
"""A copter that has not begun to climb after so long is aloft, and denies to take off."""


class Ascent:
    """One copter's way up. Used in the supervisor's thread.

    Args:
        vehicle: the copter.
        setpoints: what sends it places.
        height_m: where it is flown, above the origin of its EKF.
    """

    def __init__(self, vehicle: Vehicle, setpoints: Setpoints, height_m: float) -> None:
        self._vehicle: Final = vehicle
        self._setpoints: Final = setpoints
        self._height_m: Final = height_m
        self._since_s = self._climbed_s = -math.inf

    def begin(self) -> None:
        """Begin, or begin anew: earlier messages of the vehicle do not count."""
        self._since_s = self._climbed_s = self._vehicle.now_s

    @property
    def low(self) -> bool:
        """Whether it is not known to be above the ground."""
        return self._up_m() <= _NEAR_M

    @property
    def done(self) -> bool:
        """Whether it is at its height, or above."""
        return self._up_m() >= self._height_m - _NEAR_M

    def rise(self) -> None:
        """Have an ArduCopter climb: from the ground by a command, which it denies aloft, and there by a place above it.

        One that is told a place before it has left the ground forgets to take off.
        """
        vehicle = self._vehicle
        position = vehicle.heard_since("LOCAL_POSITION_NED", self._since_s)
        if position is not None and -position.vz > _CLIMBS_M_S:
            self._climbed_s = vehicle.now_s
        elif vehicle.now_s - self._climbed_s <= _TAKES_OFF_S:
            vehicle.command(KEEPER, mav.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self._height_m)
        else:
            self._climbed_s = vehicle.now_s
            self.climb()

    def climb(self) -> None:
        """Send a place above the vehicle. PX4 takes off so in OFFBOARD, where it refuses the command."""
        position = self._vehicle.heard_since("LOCAL_POSITION_NED", self._since_s)
        if position is not None:
            self._setpoints.go_ned(Controller.SC, position.x, position.y, -self._height_m)

    def _up_m(self) -> float:
        position = self._vehicle.heard_since("LOCAL_POSITION_NED", self._since_s)
        return -math.inf if position is None else -position.z
