"""A copter of a world, steered by its autopilot."""

from __future__ import annotations

from collections.abc import Callable
from math import copysign, hypot, sqrt
from typing import Final

from soter.onboard.drive import DriveLimits
from soter_sim.copter import CLIMB_MAX_M_S, CopterEngine, Flight, Wanted
from soter_sim.mavlink.frames import wrapped_rad
from soter_sim.mavlink.setpoint import Place, Sample, Setpoint, Velocity

TUBE_M: Final = 0.02
"""A copter stays within this distance of the straight segment from where it began the leg to its target."""

_TURN_PER_S: Final = 2.0
# At more than this speed sideways, it brakes before it goes on.
_SIDEWAYS_M_S: Final = 0.05


class Copter:
    """Implements `soter_sim.mavlink.setpoint.Vehicle`.

    It flies to places in straight lines over the ground: it brakes first, unless it already moves in nearly the same
    direction. Its vertical motion is independent, at the same time.

    Args:
        engine: the engine that moves it.
        index: its index in the engine's lists.
    """

    def __init__(self, engine: CopterEngine, index: int) -> None:
        self._engine = engine
        self._index = index

    @property
    def v_max_m_s(self) -> float:
        return self._engine.bodies.limits[self._index].v_max_m_s

    def sample(self) -> Sample:
        return Sample(*self._engine.flight(self._index), self._engine.bodies.charge[self._index])

    def steer(self, setpoint: Callable[[float], Setpoint]) -> None:
        limits, period_s = self._engine.bodies.limits[self._index], self._engine.period_s

        def pilot(now_s: float, flight: Flight) -> Wanted:
            wanted = setpoint(now_s)
            if isinstance(wanted, Place):
                return _fly_to(wanted, flight, limits, period_s)
            if isinstance(wanted, Velocity):
                return wanted.east_m_s, wanted.north_m_s, wanted.up_m_s, wanted.yaw_rate_rad_s or 0.0
            return 0.0, 0.0, 0.0, 0.0

        self._engine.pilots[self._index] = pilot


def _fly_to(place: Place, flight: Flight, limits: DriveLimits, period_s: float) -> Wanted:
    """Return the command on the way to a place."""
    dx_m, dy_m, dz_m = place.x_m - flight.x_m, place.y_m - flight.y_m, place.z_m - flight.z_m
    distance_m = hypot(dx_m, dy_m)
    east_m_s = north_m_s = turn_rad_s = 0.0
    if distance_m > 0.0:
        east, north = dx_m / distance_m, dy_m / distance_m
        along_m_s = flight.east_m_s * east + flight.north_m_s * north
        sideways_m_s = flight.north_m_s * east - flight.east_m_s * north
        if abs(sideways_m_s) <= _SIDEWAYS_M_S and along_m_s >= -_SIDEWAYS_M_S:
            speed_m_s = _approach_m_s(distance_m, place.speed_m_s or limits.v_max_m_s, limits.brake_m_s2, period_s)
            east_m_s, north_m_s = speed_m_s * east, speed_m_s * north
    up_m_s = copysign(_approach_m_s(abs(dz_m), CLIMB_MAX_M_S, limits.brake_m_s2, period_s), dz_m)
    if place.heading_rad is not None:
        turn_rad_s = _TURN_PER_S * wrapped_rad(place.heading_rad - flight.heading_rad)
    return east_m_s, north_m_s, up_m_s, turn_rad_s


def _approach_m_s(distance_m: float, most_m_s: float, brake_m_s2: float, period_s: float) -> float:
    """Return the highest speed from which one more step and then braking end at the place."""
    step_m_s = brake_m_s2 * period_s
    return min(sqrt(step_m_s * step_m_s + 2.0 * brake_m_s2 * distance_m) - step_m_s, most_m_s)
