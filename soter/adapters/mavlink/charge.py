"""The charge of a battery from what autopilots say of it: whole percents, or nothing, or a voltage."""

from __future__ import annotations

import math
from typing import Any, Final

_UNKNOWN_V: Final = 0xFFFF * 1e-3
_TRUSTED: Final = 0.02
"""A reading that is further below than this is believed at once: the battery falls faster than it should."""


class Charge:
    """Follows one battery.

    A percentage that is rounded down jumps by one from time to time. What is returned falls to it no faster than the
    battery can, so that it is never more than the true charge and has no jumps: decision modules take a jump for a
    battery that breaks its promise.

    Args:
        drive_s: time from full to empty at driving power.
        empty_v: voltage at which it is empty, for autopilots that do not count; None where that is not known.
        full_v: voltage at which it is full.
    """

    def __init__(self, drive_s: float, empty_v: float | None = None, full_v: float | None = None) -> None:
        self._per_s: Final = 1.0 / drive_s
        self._empty_v: Final = empty_v
        self._full_v: Final = full_v
        self._value: float | None = None
        self._stamp_s = -math.inf

    def read(self, sys_status: Any, stamp_s: float) -> float | None:
        """Return the charge from 0 to 1 at some time; None where it is not known.

        Args:
            sys_status: the latest SYS_STATUS, or None.
            stamp_s: fleet time of the sample that the charge is for.
        """
        said = None if sys_status is None else self._said(sys_status)
        if said is None or self._value is None or said < self._value - _TRUSTED:
            self._value = said
        else:
            self._value = max(said, self._value - max(0.0, stamp_s - self._stamp_s) * self._per_s)
        self._stamp_s = max(self._stamp_s, stamp_s)
        return self._value

    def _said(self, sys_status: Any) -> float | None:
        percent: int = sys_status.battery_remaining
        if 0 <= percent <= 100:
            return percent / 100.0
        volts: float = sys_status.voltage_battery * 1e-3
        if self._empty_v is None or self._full_v is None or not 0.0 < volts < _UNKNOWN_V:
            return None
        return min(max((volts - self._empty_v) / (self._full_v - self._empty_v), 0.0), 1.0)
