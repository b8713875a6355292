"""The parameters of an autopilot that its promise stands on: judged before it is armed, and watched while it drives."""

from __future__ import annotations

from typing import Final

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.vehicle import ARDUROVER, Vehicle
from soter.sdk import Capabilities

_STEERING: Final = {
    "SERVO1_FUNCTION": (26.0, 26.0, "it steers with its wheels, and cannot turn in place"),
    "WP_PIVOT_ANGLE": (0.0, 5.0, "it does not turn in place"),
}
"""Values from one to another that are refused. ArduRover takes a pivot angle of 5 degrees or less for none."""

_ASK_S: Final = 1.0


class JudgedParameters:
    """What one vehicle says of those parameters. Used in the supervisor's thread.

    An autopilot tells everybody when a parameter is set. That is told once, and may be lost: one of them is asked for
    every second.
    """

    def __init__(self, vehicle: Vehicle, promised: Capabilities) -> None:
        self._vehicle: Final = vehicle
        self._brake_m_s2: Final = promised.brake_m_s2
        self._asked_s, self._asked = 0.0, 0

    @property
    def names(self) -> tuple[str, ...]:
        """Which they are, in the order in which they are asked for."""
        kind = self._vehicle.kind
        return (*(_STEERING if kind == ARDUROVER else ()), *kind.brakes)

    def why_refused(self) -> str:
        """Return which of them does not allow what is promised, and what would; empty if all do.

        Who does not say is not judged.
        """
        return self._steers_wrongly() or self._brakes_weakly()

    def ask_again(self) -> None:
        """Ask for the next of them, now and then. Called while the vehicle drives."""
        now_s, names = self._vehicle.now_s, self.names
        if names and now_s - self._asked_s >= _ASK_S:
            self._asked_s, self._asked = now_s, self._asked + 1
            self._vehicle.ask_parameter(KEEPER, names[self._asked % len(names)])

    def _steers_wrongly(self) -> str:
        """Refuse a rover that steers with its wheels or does not pivot: safe controllers turn in place."""
        if self._vehicle.kind != ARDUROVER:
            return ""
        for name, (from_, to, why) in _STEERING.items():
            value = self._vehicle.parameters.get(name)
            # Written so that NaN is refused.
            if value is not None and not (value < from_ or value > to):
                return (
                    f"its {name} is {value:g}: {why}; safe controllers turn in place, and it would drive a curve "
                    "where nothing was looked at; allowed: skid steering that pivots, such as SERVO1_FUNCTION 73, "
                    "SERVO3_FUNCTION 74 and WP_PIVOT_ANGLE 20"
                )
        return ""

    def _brakes_weakly(self) -> str:
        """Refuse a vehicle that limits its own braking to less than is promised."""
        for name in self._vehicle.kind.brakes:
            most_m_s2 = self._vehicle.parameters.get(name)
            if most_m_s2 is None or most_m_s2 >= self._brake_m_s2:
                return ""
            if not most_m_s2 <= 0.0:
                return (
                    f"its {name} is {most_m_s2:g}, and promise.brake_m_s2 is {self._brake_m_s2:g}; allowed: a promise "
                    "of at most that, or a larger parameter where the vehicle brakes so hard"
                )
        return ""
