"""The spec monitor and the metrics of a module, made from its declaration alone."""

from __future__ import annotations

import math
from typing import Final

from soter.rta.models import ReachModel
from soter.rta.situation import Mode


class ModuleMonitor:
    """Watches one decision module: does its invariant hold, and does its model fit the robot?

    The invariant, as the decision module sees it: the margin is never negative. The model: between two looks the
    margin never falls by more than R(elapsed). Neither is a safety claim, which only ground truth can settle; both
    say where an argument does not fit the robot that it is applied to.

    Args:
        model: R(T), or None for a rule given by predicates; then only decisions are counted.

    Attributes:
        looks: how often the margin was judged.
        to_sc: changes AC -> SC.
        to_ac: changes SC -> AC.
        sc_s: time spent in SC, up to the last look.
        least_margin: the least margin seen.
        broken: looks at which the margin was negative or no number.
        surprises: looks at which the margin had fallen by more than the model allows.
        first_broken_s: fleet time of the first such look of either kind, or None.
    """

    __slots__ = (
        "_last_margin",
        "_last_s",
        "_model",
        "broken",
        "first_broken_s",
        "least_margin",
        "looks",
        "sc_s",
        "surprises",
        "to_ac",
        "to_sc",
    )

    def __init__(self, model: ReachModel | None) -> None:
        self._model: Final = model
        self._last_margin = math.nan
        self._last_s = math.nan
        self.looks = 0
        self.to_sc = 0
        self.to_ac = 0
        self.sc_s = 0.0
        self.least_margin = math.inf
        self.broken = 0
        self.surprises = 0
        self.first_broken_s: float | None = None

    def look(self, now_s: float, margin: float, before: Mode, after: Mode) -> None:
        """Take one look of the decision module."""
        self.looks += 1
        if before is not after:
            if after is Mode.SC:
                self.to_sc += 1
            else:
                self.to_ac += 1
        model = self._model
        if model is None:
            return
        elapsed_s = now_s - self._last_s
        if before is Mode.SC and elapsed_s > 0.0:
            self.sc_s += elapsed_s
        if margin < self.least_margin:
            self.least_margin = margin
        # Written so that a margin that is not a number counts.
        if not margin >= 0.0:
            self.broken += 1
            self._note(now_s)
        elif self._last_margin - margin > model.bound(elapsed_s):
            self.surprises += 1
            self._note(now_s)
        self._last_margin, self._last_s = margin, now_s

    def _note(self, now_s: float) -> None:
        if self.first_broken_s is None:
            self.first_broken_s = now_s
