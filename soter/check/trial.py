"""The results of trials that try to break a module.

A counterexample is kept as a file: the point that was tried, where the module broke, and what happened at every tick.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec

from soter.errors import ConfigError
from soter.problems import read_limited

Vector = tuple[float, ...]
"""A point of the unit cube, which decides all of a trial."""


class Obligation(Enum):
    """An obligation that a trial can break."""

    P2A = "P2a"
    P2B = "P2b"
    P3 = "P3"

    @property
    def statement(self) -> str:
        """The obligation in words."""
        return {
            Obligation.P2A: "under the safe controller, from phi_safe, the robot stays in phi_safe",
            Obligation.P2B: "under the safe controller it gets to where it stays in phi_safer for a whole Delta",
            Obligation.P3: "within two Delta and the robot's delays no controller leads from phi_safer out of phi_safe",
        }[self]


class Way(Enum):
    """How a robot came back to phi_safer.

    ITSELF: its module's safe controller drove it there. HOME: that one stood for as long as its contract allows, and
    the robot was driven home. CHARGE: it was driven home because it had to charge. Of one that stood, or that other
    modules drove, there is nothing to say.
    """

    ITSELF = "itself"
    HOME = "home"
    CHARGE = "charge"


class TrialRow(NamedTuple):
    """One robot at one tick of a trial, by ground truth.

    Attributes:
        time_s: time since the start.
        robot_id: the robot.
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
        battery: charge from 0 to 1, or None.
        margin: margin of phi_safe at the true pose; NaN for a robot or module without one.
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


class BrokenObligation(NamedTuple):
    """An obligation that a trial broke, and where.

    Attributes:
        time_s: when it was broken; for P2b when patience ran out.
        robot_id: the module's robot.
        x_m: where the robot was then, east.
        y_m: where the robot was then, north.
        text: what happened, with the numbers.
    """

    obligation: Obligation
    time_s: float
    robot_id: int
    x_m: float
    y_m: float
    text: str


@dataclass(frozen=True, slots=True)
class Attempt:
    """The result of one trial.

    Attributes:
        valid: whether it began inside phi_safe; one that did not says nothing.
        least_margin: the least true margin of phi_safe; infinite without a region.
        return_s: time under the safe controller until the module gave the robot back; NaN if it was never taken,
            infinite if it was not given back in time.
        spare: the patience that was left; if none was, minus how far phi_safer was still away. The score of P2b.
        surprises: looks at which the margin had fallen by more than the module's model allows, or at which an
            assumption failed.
        breaches: the obligations that were broken, in order of time.
        rows: what happened at every tick.
        unfit: the first assumption that failed, in words; empty if none did.
        driven: whether the module's safe controller drove.
        failure: what the module's own safe controller failed with; empty if it did not.
        ways: how robots came back.
    """

    valid: bool
    least_margin: float = math.inf
    return_s: float = math.nan
    spare: float = math.inf
    surprises: int = 0
    breaches: tuple[BrokenObligation, ...] = ()
    rows: Sequence[TrialRow] = ()
    unfit: str = ""
    driven: bool = False
    failure: str = ""
    ways: frozenset[Way] = frozenset()

    def score(self, obligation: Obligation) -> float:
        """Return how far the trial was from breaking an obligation; negative if it broke it."""
        broken = any(each.obligation is obligation for each in self.breaches)
        if not self.valid:
            return math.inf
        if obligation is Obligation.P2B:
            return min(self.spare, -1e-9) if broken else max(self.spare, 0.0)
        return min(self.least_margin, -1e-9) if broken else max(self.least_margin, 0.0)


_TRACE_EVERY: Final = 5


class _Header(msgspec.Struct):
    """The beginning of a counterexample's file."""

    format: Literal["soter-counterexample"]
    version: Literal[1]


class Counterexample(msgspec.Struct, frozen=True):
    """All that is needed to break a module again: the subject, as its maker describes it, and the point tried."""

    subject: dict[str, Any]
    obligation: Obligation
    time_s: float
    text: str
    vector: Annotated[tuple[Annotated[float, msgspec.Meta(ge=0.0, le=1.0)], ...], msgspec.Meta(min_length=1)]
    trace_sha256: str

    def as_json(self, rows: Sequence[TrialRow] = ()) -> str:
        """Return the content of its file; the rows are for people to read, and a replay computes them again."""
        content = msgspec.to_builtins(_Header("soter-counterexample", 1)) | msgspec.to_builtins(self)
        content["trace"] = [row._asdict() for row in rows[::_TRACE_EVERY]]
        return msgspec.json.format(msgspec.json.encode(content), indent=1).decode()


def trace_hash(trial: Attempt) -> str:
    """Return the SHA-256 over all rows of a trial."""
    return hashlib.sha256("\n".join(map(repr, map(tuple, trial.rows))).encode()).hexdigest()


def read_counterexample(path: Path) -> Counterexample:
    """Read a counterexample's file.

    Raises:
        ConfigError: the file is no counterexample, or of an unknown version.
    """

    def refused(message: str) -> ConfigError:
        return ConfigError(f"{message}; give a file that `soter check --counterexample` wrote", source=str(path))

    try:
        found = msgspec.json.decode(read_limited(path, "counterexample"))
        msgspec.convert(found, _Header)
        return msgspec.convert(found, Counterexample)
    except msgspec.ValidationError as failure:
        raise refused(f"this is no counterexample of version 1: {failure}") from failure
    except (msgspec.DecodeError, RecursionError) as failure:
        raise refused(f"not valid JSON: {failure}") from failure
