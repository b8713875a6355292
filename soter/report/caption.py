"""The words of a picture. Whoever has the figures of a run phrases them; a picture only sets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple


class Rule(NamedTuple):
    """How a safety rule fared, in words; the margin is the least that was left, negative where it was broken."""

    name: str
    violations: str
    margin: str
    broken: bool


class Remark(NamedTuple):
    """The label of a place on the plan, where a robot was then, and whether a rule was broken there."""

    x_m: float
    y_m: float
    text: str
    broken: bool


class Margins(NamedTuple):
    """What a rule makes of a place, all over the workspace: its edge is where that is 0.

    Attributes:
        x_m: columns, east.
        y_m: rows, north.
        margins: the rule's margin for a robot there, by row and column; negative where the rule is broken.
        text: which rule, in a few words.
    """

    x_m: Sequence[float]
    y_m: Sequence[float]
    margins: Sequence[Sequence[float]]
    text: str


@dataclass(frozen=True, slots=True)
class Caption:
    """What stands above and beside the picture of a run.

    Attributes:
        title: what was run.
        figures: the few numbers that matter most, each a few words.
        alarming: whether the figures are bad news, and set as such.
        details: what else it takes to run it again.
        disengagements: by safety module; a module that is not in it was not counted.
        rules: as ground truth judged them; empty without it.
        safer_charge: charge from 0 to 1 from which a robot is given back; None without that module.
        remarks: what is said on the plan.
        rule: the rule whose edge is on the plan; None for none.
    """

    title: str = ""
    figures: tuple[str, ...] = ()
    alarming: bool = False
    details: str = ""
    disengagements: Mapping[str, int] = field(default_factory=dict)
    rules: tuple[Rule, ...] = ()
    safer_charge: float | None = None
    remarks: tuple[Remark, ...] = ()
    rule: Margins | None = None
