"""The words of a picture. They are written by the code that has a run's figures; a picture only sets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple


class Rule(NamedTuple):
    """How a safety rule was kept, in words, with its least margin, which is negative if it was broken."""

    name: str
    violations: str
    margin: str
    broken: bool


class Remark(NamedTuple):
    """A label on the plan: its text, the robot's place, and whether a rule was broken there."""

    x_m: float
    y_m: float
    text: str
    broken: bool


class Margins(NamedTuple):
    """The margins of a rule all over the workspace; its edge is where they are 0.

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
    """The texts above and beside the picture of a run.

    Attributes:
        title: name of the run.
        figures: the few most important figures, a few words each.
        alarming: whether the figures are bad news, and coloured so.
        details: further settings that are needed to repeat the run.
        disengagements: number by safety module; a missing module was not counted.
        rules: the rules as ground truth judged them; empty without it.
        safer_charge: charge from 0 to 1 from which a robot is given back; None without the battery's module.
        remarks: labels on the plan.
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
