"""What a clause measures, and the two exceptions that end a clause early."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from soter.conformance.driver import ROUNDING
from soter.conformance.track import quantile

_RATES: Final = ("m_s", "rad_s")
_WAYS: Final = ("_run_m", "_reaction_m", "stopping_distance_m")


class Failed(Exception):
    """The adapter does not keep the clause; the message says what was seen and the likely cause."""


class NotTested(Exception):
    """The clause cannot be tried; the message says what is missing."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured value.

    Attributes:
        name: the quantity, with its unit at the end; a field of `Capabilities` if that is what was measured.
        value: the measured value; the bound, if the measured value exceeds it by no more than `resolution`. So a
            value beyond its bound is always a failure.
        bound: what was declared, or follows from that; None if nothing does.
        resolution: how far the measurement itself may be off.
        at_least: whether the bound is the least allowed value instead of the largest.
        spread: least, median and largest value of several trials.
    """

    name: str
    value: float
    bound: float | None = None
    resolution: float = 0.0
    at_least: bool = False
    spread: tuple[float, ...] = ()

    @classmethod
    def of(
        cls,
        name: str,
        seen: float,
        bound: float | None = None,
        resolution: float = 0.0,
        *,
        at_least: bool = False,
        trials: Sequence[float] = (),
    ) -> Figure:
        """Return the figure for the worst measured value, with the spread of all trials."""
        value = seen
        if bound is not None:
            off = resolution + ROUNDING
            # Credit the robot with the error of the measurement, but only up to the bound.
            value = min(max(seen, bound), seen + off) if at_least else max(min(seen, bound), seen - off)
        spread = tuple(round(quantile(trials, share), 6) for share in (0.0, 0.5, 1.0)) if trials else ()
        return cls(name, round(max(value, 0.0), 6), bound, round(resolution, 6), at_least, spread)

    @property
    def kept(self) -> bool:
        """Whether the value is within its bound; NaN is beyond every bound."""
        if self.bound is None:
            return True
        return self.value >= self.bound - ROUNDING if self.at_least else self.value <= self.bound + ROUNDING

    @property
    def timed(self) -> bool:
        """Whether a busy host may spoil the figure: it is a time, or a way that gets longer with one."""
        return self.name.endswith(_WAYS) or (self.name.endswith("_s") and not self.name.endswith(_RATES))
