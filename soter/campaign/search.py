"""Searches for the worst run: CMA-ES over declared ranges, one run a candidate."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Final

import cma
import numpy as np

from soter.campaign.conditions import figure
from soter.campaign.job import Job
from soter.campaign.plan import Campaign
from soter.campaign.store import RunRow, Store
from soter.campaign.tables import SEED, PartTable, flat

_BEGIN_SPREAD: Final = 0.3
_NOTHING: Final = 1e9
"""Value of a candidate that was refused or failed, from which the optimiser keeps away."""


class Searched:
    """The runs of a search, a generation at a time; `soter.campaign.session.Source`.

    The next runs follow from the seed and the results so far, so that a resumed search asks for the same runs again. If
    the optimiser has converged, it starts again elsewhere, with twice as many candidates.
    """

    def __init__(self, campaign: Campaign, part: PartTable) -> None:
        assert part.search is not None
        self.planned = part.search.runs
        self._campaign, self._part, self._search = campaign, part, part.search
        self._random: Final = np.random.RandomState(self._search.seed)
        self._seeds: Final = list(part.all_seeds())
        self._optimiser: Any = None
        self._restarts = 0
        self._asked: deque[Job] = deque()
        self._generation: list[Any] = []
        self._found: Final[dict[int, float]] = {}
        self._first = self._number = 0
        self._ended = False

    def next(self) -> Job | None:
        if not self._asked and not self._ended and self._first == self._number:
            self._ask()
        return self._asked.popleft() if self._asked and not self._ended else None

    def tell(self, row: RunRow) -> None:
        found = figure(row, self._search.minimise)
        self._found[row.number] = _NOTHING if found is None else found
        self._learn()

    def _learn(self) -> None:
        """Take the finished runs of a generation, in order; ask for the next generation once all are taken."""
        numbers = range(self._first, self._number)
        below = -math.inf if self._search.below is None else self._search.below
        for number in numbers:
            if number not in self._found:
                return
            if self._found[number] < below:
                self._ended, self.planned = True, number + 1
                return
        if self._search.by == "cma" and self._number < self._search.runs:
            self._optimiser.tell(self._generation, [self._found[number] for number in numbers])
        self._first = self._number

    def end(self, store: Store) -> None:
        if self._ended:
            store.leave_out(self._part.name, self.planned)

    def _ask(self) -> None:
        """Ask for the next generation."""
        left = self._search.runs - self._number
        if not left:
            return
        if self._search.by == "random":
            self._generation = [self._random.rand(len(self._search.over))]
        else:
            if self._optimiser is None or self._optimiser.stop():
                self._optimiser = self._begin()
                self._restarts += 1
            self._generation = self._optimiser.ask()
            if len(self._generation) > left:
                # The optimiser cannot use a part of a generation, but the remaining runs may still find a worse case.
                self._generation = self._generation[:left]
        for place in self._generation:
            settings = {**flat(self._part.set), SEED: self._seeds[self._number % len(self._seeds)]}
            for (key, values), part in zip(self._search.over.items(), place, strict=True):
                settings[key] = values.at(float(part))
            settings |= self._campaign.overrides
            self._asked.append(self._campaign.job(self._part, self._number, settings, {}))
            self._number += 1

    def _begin(self) -> Any:
        dimensions = len(self._search.over)
        place = [0.5] * dimensions if not self._restarts else self._random.rand(dimensions)
        options = {
            "bounds": [0.0, 1.0], "randn": self._random.randn, "seed": math.nan, "verbose": -9,
            "popsize": (4 + int(3 * math.log(dimensions))) * 2**self._restarts,
        }  # fmt: skip
        return cma.CMAEvolutionStrategy(place, _BEGIN_SPREAD, options)
