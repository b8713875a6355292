"""Boats that drift where they are not driven, and how ArduRover holds them: `--like ardurover-boat`.

After ArduRover's source, and as it was seen of one with the physics of a boat.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, radians, sin
from typing import Final

from soter_sim.mavlink.flaws import Flaws
from soter_sim.mavlink.parameters import Parameters
from soter_sim.mavlink.rover import Rover
from soter_sim.mavlink.setpoint import Place, Sample, Setpoint
from soter_sim.world import World

_RUNS_M_S: Final = 0.01
_GAIN_PER_S: Final = 0.5
_CREEPS_M_S: Final = 0.03


class Boat(Rover):
    """A boat, which a current carries while its motors drive it neither forwards nor backwards.

    Attributes:
        current_m_s: returns how fast the water moves, east and north.
    """

    def __init__(self, world: World, robot_id: int) -> None:
        super().__init__(world, robot_id)
        self.current_m_s: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0)

    def _told(self, v_m_s: float, to_m_s: float) -> None:
        runs = max(abs(v_m_s), abs(to_m_s)) > _RUNS_M_S
        self._world.bodies.carried[self._index] = (0.0, 0.0) if runs else self.current_m_s()


class Holding(Flaws):
    """The flaws of ArduRover, and what it does of itself with a boat.

    Once a boat has come to a place, or no velocity is wanted of it any more, it is held where it is then: it drifts
    within LOIT_RADIUS, and is driven back from beyond, backwards where that is nearer.
    """

    def __init__(self) -> None:
        super().__init__(flies=False)
        self._held: tuple[float, float] | None = None

    def steered(self, wanted: Setpoint, at: Sample, parameters: Parameters) -> Setpoint:
        near_m = parameters["WP_RADIUS"]
        there = isinstance(wanted, Place) and hypot(wanted.x_m - at.x_m, wanted.y_m - at.y_m) <= near_m
        if wanted is not None and not there:
            self._held = None
            return super().steered(wanted, at, parameters)
        self._held = self._held or (at.x_m, at.y_m)
        return _back(*self._held, at, parameters["LOIT_RADIUS"])


def _back(x_m: float, y_m: float, at: Sample, radius_m: float) -> Place | None:
    """Return where a boat that is held at a place is driven to; None while it drifts."""
    dx_m, dy_m = x_m - at.x_m, y_m - at.y_m
    beyond_m = hypot(dx_m, dy_m) - radius_m
    if beyond_m <= 0.0:
        return None
    place = Place(x_m, y_m, speed_m_s=max(_GAIN_PER_S * beyond_m, _CREEPS_M_S))
    behind = dx_m * cos(at.heading_rad) + dy_m * sin(at.heading_rad) < 0.0
    return place.backwards_from(at) if behind else place


def current_m_s(parameters: Parameters) -> tuple[float, float]:
    """Return how fast the water moves, east and north; SIM_TIDE_DIR is where it comes from."""
    speed_m_s, from_rad = parameters["SIM_TIDE_SPD"], radians(parameters["SIM_TIDE_DIR"])
    return -speed_m_s * sin(from_rad), -speed_m_s * cos(from_rad)
