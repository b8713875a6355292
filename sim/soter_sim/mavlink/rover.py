"""A ground robot of a world, steered by its autopilot."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, copysign, cos, hypot, sin
from typing import Final

from soter.onboard.drive import Drive
from soter_sim.mavlink.frames import wrapped_rad
from soter_sim.mavlink.setpoint import Place, Sample, Setpoint, Velocity
from soter_sim.world import World

TURN_PER_S: Final = 4.0
"""How fast it turns to a heading, by how far off that is."""

_ASTRAY_RAD: Final = 0.35
_SLOWEST_M_S: Final = 1e-3


class Rover:
    """Implements `soter_sim.mavlink.setpoint.Vehicle`.

    It drives to places as `soter.onboard.drive` does: pivot, drive straight, stop.

    Args:
        world: the robot's world.
        robot_id: its number.
    """

    def __init__(self, world: World, robot_id: int) -> None:
        self._world = world
        self._id = robot_id
        self._index = world.index(robot_id)
        self._drive = Drive(world.bodies.limits[self._index], world.period_s)

    @property
    def v_max_m_s(self) -> float:
        return self._drive.limits.v_max_m_s

    def sample(self) -> Sample:
        bodies, i = self._world.bodies, self._index
        east, north = self._world.engine.velocity(i)
        return Sample(
            bodies.x[i], bodies.y[i], 0.0, bodies.heading[i], east, north, 0.0, bodies.yaw_rate[i], bodies.charge[i]
        )

    def steer(self, setpoint: Callable[[float], Setpoint]) -> None:
        drive = self._drive.command

        def control(
            now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
        ) -> tuple[float, float]:
            wanted = setpoint(now_s)
            place = wanted if isinstance(wanted, Place) else None
            command = drive(x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s, place)
            if isinstance(wanted, Velocity):
                command = _keep(wanted, heading_rad)
            self._told(v_m_s, command[0])
            return command

        self._world.set_control(self._id, control)

    def _told(self, v_m_s: float, to_m_s: float) -> None:
        """Note how fast it is, and is to be."""


def _keep(wanted: Velocity, heading_rad: float) -> tuple[float, float]:
    """Return the speed and the turn rate that keep a velocity: turn towards it first, then drive."""
    if wanted.heading_rad is not None:
        return 0.0, TURN_PER_S * wrapped_rad(wanted.heading_rad - heading_rad)
    speed_m_s = hypot(wanted.east_m_s, wanted.north_m_s)
    if wanted.yaw_rate_rad_s is not None:
        along_m_s = wanted.east_m_s * cos(heading_rad) + wanted.north_m_s * sin(heading_rad)
        return copysign(speed_m_s, along_m_s), wanted.yaw_rate_rad_s
    if speed_m_s < _SLOWEST_M_S:
        return 0.0, 0.0
    error_rad = wrapped_rad(atan2(wanted.north_m_s, wanted.east_m_s) - heading_rad)
    astray = abs(error_rad) > _ASTRAY_RAD
    return 0.0 if astray else speed_m_s * cos(error_rad), TURN_PER_S * error_rad
