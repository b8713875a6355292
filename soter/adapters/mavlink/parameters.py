"""The autopilot parameters that its promise depends on: checked before it is armed, and watched while it drives."""

from __future__ import annotations

from typing import Final

from soter.adapters.mavlink import boats
from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.vehicle import Vehicle
from soter.sdk import Capabilities

_STEERING: Final = {
    "SERVO1_FUNCTION": (26.0, 26.0, "it steers with its wheels, and cannot turn in place"),
    "WP_PIVOT_ANGLE": (0.0, 5.0, "it does not turn in place"),
}
"""Ranges of values that are refused. ArduRover treats a pivot angle of 5 degrees or less as none."""

_TURNS: Final = 0.75
"""The part of its turn rate that is asked for: autopilots swing beyond that, and take long for the end of a turn."""

_ASK_S: Final = 1.0
_ROUNDED: Final = 1.0 + 1e-6
"""Parameters are sent in single precision."""


class JudgedParameters:
    """Checks the reported parameters of one vehicle. Used in the supervisor's thread.

    An autopilot announces a new value only once, and the message may be lost: one parameter is asked for every second.
    """

    def __init__(self, vehicle: Vehicle, promised: Capabilities) -> None:
        self._vehicle: Final = vehicle
        self._promised: Final = promised
        self._brake_m_s2: Final = promised.brake_m_s2
        self._v_max_m_s: Final = promised.v_max_m_s
        self._yaw_rate_max_rad_s: Final = promised.yaw_rate_max_rad_s
        self._asked_s, self._asked = 0.0, 0

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in the order in which they are asked for."""
        kind = self._vehicle.kind
        own = (*(_STEERING if kind.is_ardurover else ()), *(boats.NAMES if kind.drifts else ()))
        gain = (kind.turn_gain,) if kind.turn_gain else ()
        return tuple(dict.fromkeys((*own, *kind.brakes, *kind.speeds, *kind.turns, *gain)))

    @property
    def drift_m(self) -> float:
        """How far from where it has stopped the vehicle drifts; 0 for one that does not."""
        return boats.drift_m(self._vehicle.parameters, self._promised) if self._vehicle.kind.drifts else 0.0

    @property
    def turn_reach_rad(self) -> float:
        """How far off a heading may be that the vehicle is told to turn to.

        ArduRover turns at its gain times how far off the heading is. Told to turn no farther than this it turns at 75 %
        of what it promises, and slows down as soon as it hears nothing more. One that does not report its gain is told
        to turn no farther than it may within its lease.
        """
        gain_per_s = self._vehicle.parameters.get(self._vehicle.kind.turn_gain, 0.0)
        return self._yaw_rate_max_rad_s * (_TURNS / gain_per_s if gain_per_s > 0.0 else self._promised.lease_s)

    def why_refused(self) -> str:
        """Return which parameter does not allow the promise, and values that would; empty if all allow it.

        Parameters that the vehicle does not report are not checked, but for those that hold a boat.
        """
        return self._steers_wrongly() or self._drifts_off() or self._brakes_weakly() or self._hurries() or self._spins()

    def ask_again(self) -> None:
        """Ask for the next parameter if one is due. Called while the vehicle drives."""
        now_s, names = self._vehicle.now_s, self.names
        if names and now_s - self._asked_s >= _ASK_S:
            self._asked_s, self._asked = now_s, self._asked + 1
            self._vehicle.ask_parameter(KEEPER, names[self._asked % len(names)])

    def _steers_wrongly(self) -> str:
        """Refuse a rover that steers with its wheels or does not pivot: safe controllers turn in place."""
        if not self._vehicle.kind.is_ardurover:
            return ""
        for name, (from_, to, why) in _STEERING.items():
            value = self._vehicle.parameters.get(name)
            # Also refuses NaN.
            if value is not None and not (value < from_ or value > to):
                return (
                    f"its {name} is {value:g}: {why}; safe controllers turn in place, and it would drive a curve "
                    "where nothing was looked at; allowed: skid steering that pivots, such as SERVO1_FUNCTION 73, "
                    "SERVO3_FUNCTION 74 and WP_PIVOT_ANGLE 20"
                )
        return ""

    def _drifts_off(self) -> str:
        """Refuse a boat that its autopilot does not hold as is promised."""
        return boats.why_refused(self._vehicle.parameters, self._promised) if self._vehicle.kind.drifts else ""

    def _brakes_weakly(self) -> str:
        """Refuse a vehicle that limits its braking to less than promised."""
        for name, unit_m_s2 in self._vehicle.kind.brakes.items():
            value = self._vehicle.parameters.get(name)
            if value is None or value <= 0.0:
                continue
            # Also refuses NaN.
            if value * unit_m_s2 * _ROUNDED >= self._brake_m_s2:
                return ""
            return (
                f"its {name} is {value:g}, which is {value * unit_m_s2:g} m/s2, and promise.brake_m_s2 is "
                f"{self._brake_m_s2:g}; allowed: a promise of at most that, or a larger parameter where the vehicle "
                "brakes so hard"
            )
        return ""

    def _hurries(self) -> str:
        """Refuse a vehicle that flies faster than promised until it has taken a lower limit."""
        for name, unit_m_s in self._vehicle.kind.speeds.items():
            value = self._vehicle.parameters.get(name)
            # Also refuses NaN.
            if value is not None and not value * unit_m_s <= self._v_max_m_s * _ROUNDED:
                return (
                    f"its {name} is {value:g}, which is {value * unit_m_s:g} m/s, and promise.v_max_m_s is "
                    f"{self._v_max_m_s:g}; allowed: at most {self._v_max_m_s / unit_m_s:g}"
                )
        return ""

    def _spins(self) -> str:
        """Refuse a vehicle that turns faster than promised."""
        for name, unit_rad_s in self._vehicle.kind.turns.items():
            value = self._vehicle.parameters.get(name)
            # Also refuses NaN.
            if value is not None and not 0.0 < value * unit_rad_s <= self._yaw_rate_max_rad_s * _ROUNDED:
                how_fast = f"{value * unit_rad_s:.4g} rad/s" if value else "no limit"
                return (
                    f"its {name} is {value:g}, which is {how_fast}, and promise.yaw_rate_max_rad_s is "
                    f"{self._yaw_rate_max_rad_s:g}; allowed: more than 0, at most "
                    f"{self._yaw_rate_max_rad_s / unit_rad_s:.4g}"
                )
        return ""
