"""The words of a picture. Whoever has the figures of a run phrases them; a picture only sets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple


class Rule(NamedTuple):
    """How a safety rule fared, in words.

    Attributes:
        name: the rule.
        violations: how often it was broken.
        margin: the least margin that was left, with its unit; negative where it was broken.
        broken: whether it was.
    """

    name: str
    violations: str
    margin: str
    broken: bool


class Broken(NamedTuple):
    """Where something was broken, to be shown.

    Attributes:
        x_m: where the robot was then, east.
        y_m: the same, north.
        text: what, in a few words.
    """

    x_m: float
    y_m: float
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
        broken: what is to be seen to be broken on the plan.
    """

    title: str = ""
    figures: tuple[str, ...] = ()
    alarming: bool = False
    details: str = ""
    disengagements: Mapping[str, int] = field(default_factory=dict)
    rules: tuple[Rule, ...] = ()
    safer_charge: float | None = None
    broken: tuple[Broken, ...] = ()
