"""Reads and judges a campaign's requirements and stopping rules, which are texts."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import BeforeValidator

from soter.problems import not_allowed

if TYPE_CHECKING:
    from soter.campaign.store import RunRow

_OPERATORS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_OVER: Final[Mapping[str, Callable[[Sequence[float]], float]]] = {
    "mean": fmean, "least": min, "most": max, "total": sum,
}  # fmt: skip
_FIGURE: Final = r"[a-z_]+(?:\.[\w-]+)*"
_NUMBER: Final = r"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_REQUIREMENT: Final = re.compile(
    rf"(?:(?P<over>{'|'.join(_OVER)}) )?(?P<figure>{_FIGURE}) ?(?P<operator>[<>]=?|[!=]=) ?(?P<number>{_NUMBER})"
)
_RULE: Final = re.compile(
    rf"(?P<figure>{_FIGURE}) ?< ?(?P<bound>{_NUMBER}) (?P<per>per robot-hour|of runs) at (?P<level>{_NUMBER}) ?%"
)


def looked_up(result: Mapping[str, Any], name: str) -> Any:
    """Return the value of a result at a dotted key; None if there is none."""
    value: Any = result
    for part in name.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def figure(row: RunRow, name: str) -> float | None:
    """Return a figure of a run, or None if the run has no such figure.

    Args:
        row: the run.
        name: `accepted` (1 or 0), `findings`, or a dotted key of its result, such as `ac_share`, `violations.collision`
            or `min_margin.obstacle`. For a whole table, such as `violations`, counts are added, and the least margin
            is taken; there is none if one of them was not a number.
    """
    if name == "accepted":
        return float(row.status == "done")
    if name == "findings":
        return float(len(row.findings))
    value = looked_up(row.result, name)
    if isinstance(value, dict):
        if name == "min_margin" and None in value.values():
            return None
        inner = [each for each in value.values() if isinstance(each, int | float)]
        return float(min(inner) if name == "min_margin" else sum(inner)) if inner else None
    return float(value) if isinstance(value, int | float) else None


@dataclass(frozen=True)
class Judged:
    """A judged requirement.

    Attributes:
        text: what is required.
        found: what was found.
        holds: whether it holds.
        ran: whether anything was run that it could be judged by; it does not hold if not.
    """

    text: str
    found: str
    holds: bool
    ran: bool = True


@dataclass(frozen=True)
class Condition:
    """A requirement such as "violations == 0" (for every run) or "mean ac_share >= 0.802" (for all together)."""

    text: str
    over: str
    figure: str
    operator: str
    number: float

    def __str__(self) -> str:
        return self.text

    @classmethod
    def parse(cls, text: object) -> Condition:
        """Read it; for pydantic."""
        found = _REQUIREMENT.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            raise not_allowed(f"'[{'|'.join(_OVER)}] FIGURE {'|'.join(_OPERATORS)} NUMBER', such as 'violations == 0'")
        return cls(found[0], found["over"] or "", found["figure"], found["operator"], float(found["number"]))

    def judge(self, rows: Iterable[RunRow]) -> Judged:
        """Judge finished runs. If runs lack the figure, the requirement does not hold."""
        holds = _OPERATORS[self.operator]
        values = {row.id: figure(row, self.figure) for row in rows}
        known = [value for value in values.values() if value is not None]
        if not known or len(known) < len(values):
            return Judged(self.text, f"known of {len(known)} of {len(values)} runs", False)
        if self.over:
            found = _OVER[self.over](known)
            return Judged(self.text, f"{found:.6g} ({min(known):.6g} to {max(known):.6g})", holds(found, self.number))
        broken = [name for name, value in values.items() if value is not None and not holds(value, self.number)]
        which = f", but for {', '.join(broken[:5])}{' ...' if len(broken) > 5 else ''}" if broken else ""
        return Judged(self.text, f"{len(known) - len(broken)} of {len(known)} runs{which}", not broken)


@dataclass(frozen=True)
class RateRule:
    """A stopping rule: "FIGURE < R per robot-hour at P %", or "FIGURE < R of runs at P %".

    Attributes:
        figure: the figure that counts the rare events.
        bound: the bound to prove, for the rate of events or for the share of runs that have any.
        per_hour: whether the bound is a rate.
        level: the confidence, from 0 to 1.
    """

    text: str
    figure: str
    bound: float
    per_hour: bool
    level: float

    @classmethod
    def parse(cls, text: object) -> RateRule:
        """Read it; for pydantic."""
        found = _RULE.fullmatch(text) if isinstance(text, str) else None
        if found is not None:
            bound, level = float(found["bound"]), float(found["level"]) / 100.0
            per_hour = found["per"] != "of runs"
            if bound > 0.0 and 0.0 < level < 1.0 and (per_hour or bound < 1.0):
                return cls(found[0], found["figure"], bound, per_hour, level)
        raise not_allowed("'FIGURE < RATE per robot-hour at P %' or 'FIGURE < SHARE of runs at P %'")


Requirement = Annotated[Condition, BeforeValidator(Condition.parse)]
StoppingRule = Annotated[RateRule, BeforeValidator(RateRule.parse)]
