"""What one try at breaking a module yields, and what can be tried: the seam to whoever runs the robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

from soter.rta import RTAModule, Timing


class Obligation(Enum):
    """What a trial can break."""

    P2A = "P2a"
    P2B = "P2b"
    P3 = "P3"

    @property
    def statement(self) -> str:
        """What it promises, in words."""
        return {
            Obligation.P2A: "under the safe controller, from phi_safe, the robot stays in phi_safe",
            Obligation.P2B: "under the safe controller it gets to where it stays in phi_safer for a whole Delta",
            Obligation.P3: "within two Delta and the robot's delays no controller leads from phi_safer out of phi_safe",
        }[self]


class Row(NamedTuple):
    """One robot at one tick of a trial, as ground truth has it.

    Attributes:
        time_s: since the start.
        robot_id: which robot.
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
        battery: charge from 0 to 1, or None.
        margin: of phi_safe, from the true pose; NaN for a robot or module that has none.
        driver: the module that drives, or "AC".
    """

    time_s: float
    robot_id: int
    x_m: float
    y_m: float
    heading_rad: float
    battery: float | None
    margin: float
    driver: str


class Breach(NamedTuple):
    """An obligation that a trial broke, and where.

    Attributes:
        obligation: which.
        time_s: when it was broken; for P2b when patience ran out.
        robot_id: whose module.
        x_m: where the robot was then, east.
        y_m: the same, north.
        text: what happened, with the numbers.
    """

    obligation: Obligation
    time_s: float
    robot_id: int
    x_m: float
    y_m: float
    text: str


@dataclass(frozen=True, slots=True)
class Trial:
    """One try.

    Attributes:
        valid: whether it began inside phi_safe; one that did not says nothing.
        least_margin: the least true margin of phi_safe; infinite where there is no region to ask.
        return_s: time under the safe controller until the module gave the robot back; NaN if that did not come to be
            asked, infinite if it did not come back in time.
        spare: what is left of the patience, less than 0 by how far phi_safer was still away; the score of P2b.
        surprises: looks at which the margin had fallen by more than the module's model allows, or at which an
            assumption did not hold.
        breaches: what was broken, in the order of time.
        rows: what happened, tick by tick.
        unfit: the first assumption that did not hold, in words; empty if all did.
    """

    valid: bool
    least_margin: float = math.inf
    return_s: float = math.nan
    spare: float = math.inf
    surprises: int = 0
    breaches: tuple[Breach, ...] = ()
    rows: Sequence[Row] = ()
    unfit: str = ""

    def score(self, obligation: Obligation) -> float:
        """Return how far the trial is from breaking an obligation; negative where it broke it."""
        broken = any(each.obligation is obligation for each in self.breaches)
        if not self.valid:
            return math.inf
        if obligation is Obligation.P2B:
            return min(self.spare, -1e-9) if broken else max(self.spare, 0.0)
        return min(self.least_margin, -1e-9) if broken else max(self.least_margin, 0.0)


class Subject(Protocol):
    """A module bound to robots, a world and an adversarial AC; every point of a unit cube is a way to try it."""

    @property
    def module(self) -> RTAModule:
        """The declaration under test."""

    @property
    def timing(self) -> Timing:
        """What its robot adds to every horizon."""

    @property
    def base_tick_s(self) -> float:
        """Period of the supervisor."""

    @property
    def dimensions(self) -> int:
        """Of the cube."""

    @property
    def patience_s(self) -> float:
        """How long the safe controller may take to get back to phi_safer."""

    def run(self, vector: Sequence[float]) -> Trial:
        """Try one point: initial states and the AC's commands are read from it. The same point, the same trial."""
