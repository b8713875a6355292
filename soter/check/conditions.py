"""P1 and P3, which follow from a declaration and a robot's promises alone."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum

from soter.errors import IllFormedModule
from soter.rta import Region, RTAModule, Timing
from soter.rta.module import plain


class Certainty(Enum):
    """How well a condition is known to hold.

    PROVED: for every state, from the assumptions that the finding names. PARTLY: for every state except those listed.
    TESTED: a search found no counterexample. ASSUMED: taken from the author. REJECTED: it fails.
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
        condition: P1a, P1b, P2a, P2b or P3; or model, for R(T) itself.
        verdict: how well it is known to hold.
        text: why, with the numbers.
        figures: the numbers, by names that end in the unit.
    """

    module: str
    condition: str
    verdict: Certainty
    text: str
    figures: Mapping[str, float | int | str | None] = field(default_factory=dict)

    def as_dict(self) -> dict[str, object]:
        """Return the finding as a dict for JSON."""
        return {**asdict(self), "verdict": self.verdict.value}

    def is_gap(self, own: Container[str]) -> bool:
        """Return whether a mission with it is run on request only: a proof has a gap, or P2 or P3 is but a word.

        `own` has the names of the modules of the user's own. That robots like a mission's could not try the shipped
        collision module is no gap.
        """
        if self.verdict is Certainty.ASSUMED:
            return self.module in own and self.condition in ("P2a", "P2b", "P3")
        return self.verdict is Certainty.PARTLY


def rejection(failure: IllFormedModule) -> Finding:
    """Return the refusal of a module as a finding."""
    return Finding(failure.module, failure.condition, Certainty.REJECTED, failure.why)


ORDER = ("P1a", "P1b", "P3")
"""The order in which a module is checked; conditions after a failed one are not checked."""


def conditions(module: RTAModule, timing: Timing, base_tick_s: float) -> list[Finding]:
    """Return the findings about P1a, P1b and P3.

    They end at the first that fails, since the others build on it.
    """
    try:
        module.check(timing, base_tick_s)
    except IllFormedModule as failure:
        failed = ORDER.index(failure.condition) if failure.condition in ORDER else 0
        before = [_holds(module, condition, timing, base_tick_s) for condition in ORDER[:failed]]
        return [*before, rejection(failure)]
    return [_holds(module, condition, timing, base_tick_s) for condition in ORDER]


def _holds(module: RTAModule, condition: str, timing: Timing, base_tick_s: float) -> Finding:
    if condition == "P1a":
        ticks = round(module.delta_s / base_tick_s)
        of_ticks = "1 base tick" if ticks == 1 else f"{ticks} base ticks"
        text = f"Delta = {module.delta_s:g} s is {of_ticks}; AC and SC are no slower"
        return Finding(module.name, condition, Certainty.PROVED, text, {"delta_s": module.delta_s})
    if condition == "P1b":
        text = f"AC and SC publish {', '.join(sorted(module.ac.publishes))}"
        return Finding(module.name, condition, Certainty.PROVED, text)
    edge, horizon_s = module.edge_margin(), module.horizon_s(timing)
    if module.model is None:
        text = "given by predicates: that they look two Delta ahead is the author's claim"
        return Finding(module.name, condition, Certainty.ASSUMED, text, {"horizon_s": horizon_s})
    reach = module.reach(timing)
    noise = 0.0 if module.phi_safe is None else plain(module.phi_safe.noise(timing.noise_m))
    figures = {
        "horizon_s": horizon_s, "reach": reach, "noise": noise, "edge_margin": None if math.isnan(edge) else edge
    }  # fmt: skip
    unit = "" if module.phi_safe is None else f" {module.phi_safe.unit}"
    used = f"{unit} + noise = {noise:.3f}{unit}" if noise > 0.0 else unit
    if not isinstance(module.phi_safer, Region):
        text = f"phi_safer is a predicate; the AC gets control only where the margin is at least R = {reach:.3f}{used}"
        return Finding(module.name, condition, Certainty.PROVED, text, figures)
    text = f"R({horizon_s:.3f} s) = {reach:.3f}{used}, at most the margin at the edge of phi_safer, {edge:.3f}{unit}"
    return Finding(module.name, condition, Certainty.PROVED, text, figures)
