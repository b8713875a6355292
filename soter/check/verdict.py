"""What a check says about one condition of one module."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum


class Verdict(Enum):
    """How well a condition is known to hold.

    PROVED: for every state, from the assumptions that the finding names. PARTLY: for every state but those that are
    listed. TESTED: looked for a counterexample and found none. ASSUMED: taken from the author. REJECTED: it fails.
    """

    PROVED = "PROVED"
    PARTLY = "PARTLY"
    TESTED = "TESTED"
    ASSUMED = "ASSUMED"
    REJECTED = "REJECTED"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of a report.

    Attributes:
        module: the module's name.
        condition: P1a, P1b, P2a, P2b or P3; or model, for R(T) itself.
        verdict: how well it is known to hold.
        text: why, with the numbers.
        figures: the numbers, by a name that carries the unit.
    """

    module: str
    condition: str
    verdict: Verdict
    text: str
    figures: Mapping[str, float | int | str | None] = field(default_factory=dict)

    def as_dict(self) -> dict[str, object]:
        """Return it for JSON."""
        return {
            "module": self.module,
            "condition": self.condition,
            "verdict": self.verdict.value,
            "text": self.text,
            "figures": dict(self.figures),
        }
