"""Importance splitting: estimates how often a margin falls below a value, if plain runs would hardly ever show it.

Adaptive multilevel splitting (Cerou and Guyader 2007) in discrete time begins with plain runs. The runs that stay
farthest from the value are killed, and as many branch from others at the tick at which these came nearer: they repeat
such a run up to that tick, and from then on faults use new random numbers. This is repeated until nearly all runs are
below the value. Each time the probability shrinks by the part that was killed. Runs that came equally near are killed
together; so the estimate is unbiased whatever the number of runs (Brehier, Gazeau, Goudenege, Lelievre, Rousset 2016).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from random import Random
from statistics import fmean
from typing import Any, Final, NamedTuple

from soter.campaign.conditions import Judged
from soter.campaign.intervals import positive_mean, proportion
from soter.campaign.job import FALLS, Job
from soter.campaign.plan import Campaign
from soter.campaign.store import RunRow, Store
from soter.campaign.tables import PartTable

BRANCHED: Final[Mapping[str, str]] = {"runs": "branched"}
"""The axis of runs that branch from others."""

_KILLED: Final = 0.2
"""The part of the runs that is killed at a level; more if runs came equally near."""

_NEVER: Final = 1e-12
"""Rarer events are taken for impossible."""

_REACHED: Final = 0.9
"""The part of the repetitions that must have reached the value for an interval from their spread."""

Falls = Sequence[Sequence[float]]
"""The falls of a run's margin: fleet time and least margin, see `soter.runner.Run`."""


class Branch(NamedTuple):
    """A run of a repetition.

    Attributes:
        root: the index of the plain run that it begins as.
        reseeds: fleet times, each with the seed from which faults draw from then on.
        shared: the falls of its margin up to the last of these times, which are known beforehand.
    """

    root: int
    reseeds: tuple[tuple[float, int], ...] = ()
    shared: Falls = ()


class Repetition:
    """One estimate. Its runs follow from its random numbers and the results so far.

    Args:
        replicas: the number of plain runs to begin with.

    Attributes:
        runs: the runs that it needs; grows with the results.
        estimate: the probability, once it is known.
        void: why there will be no estimate; empty otherwise.
    """

    def __init__(self, replicas: int, below: float, random: Random) -> None:
        self.runs: Final = [Branch(root) for root in range(replicas)]
        self.estimate: float | None = None
        self.void = ""
        self._below: Final = below
        self._random: Final = random
        self._falls: Final[dict[int, Falls]] = {}
        self._alive = [*range(replicas)]
        self._weight = 1.0

    def tell(self, index: int, falls: Falls) -> None:
        """Take the falls of a run's margin."""
        shared = self.runs[index].shared if index < len(self.runs) else ()
        if index >= len(self.runs):
            self.void = "a run is of another plan"
        elif not falls:
            self.void = "a run failed, or has no such margin"
        elif [*falls[: len(shared)]] != [*shared]:
            self.void = "a run does not repeat the one that it branches from"
        self._falls[index] = falls
        if not self.void and all(each in self._falls for each in self._alive):
            self._split()

    def _split(self) -> None:
        """Kill the runs that stay farthest away, and let as many branch from others."""
        least = {index: self._falls[index][-1][1] for index in self._alive}
        count = len(self._alive)
        level = sorted(least.values(), reverse=True)[max(1, int(_KILLED * count)) - 1]
        if level < self._below:
            self.estimate = self._weight * sum(margin < self._below for margin in least.values()) / count
            return
        nearer = [index for index in self._alive if least[index] < level]
        self._weight *= len(nearer) / count
        if self._weight < _NEVER:
            self.estimate = 0.0
            return
        new = range(len(self.runs), len(self.runs) + count - len(nearer))
        self.runs.extend([self._branch(self._random.choice(nearer), level) for _ in new])
        self._alive = [*nearer, *new]

    def _branch(self, parent: int, level: float) -> Branch:
        """Return a run that repeats another up to the tick at which its margin was below a level."""
        falls, origin = self._falls[parent], self.runs[parent]
        end = next(at for at, (_, margin) in enumerate(falls) if margin < level) + 1
        at_s = float(falls[end - 1][0])
        # If a run fell past several levels in one tick, only the last seed of that tick is used.
        earlier = [each for each in origin.reseeds if each[0] < at_s]
        return Branch(origin.root, (*earlier, (at_s, self._random.getrandbits(53))), falls[:end])


class Split:
    """The runs of a part that splits, a level at a time in each repetition; `soter.campaign.session.Source`."""

    def __init__(self, campaign: Campaign, part: PartTable) -> None:
        assert part.split is not None
        self._campaign, self._part = campaign, part
        self._plain: Final = [*campaign.jobs(part)]
        self._asked: Final[deque[Job]] = deque(self._plain)
        self.planned = len(self._plain)
        count, below = part.split.repetitions, part.split.below
        self.repetitions: Final = [
            Repetition(self.planned // count, below, Random(f"split, seed {job.seed}")) for job in self._plain[:count]
        ]

    def next(self) -> Job | None:
        return self._asked.popleft() if self._asked else None

    def tell(self, row: RunRow) -> None:
        # The numbers of runs alternate between the repetitions, whichever of them is ahead.
        index, which = divmod(row.number, len(self.repetitions))
        repetition = self.repetitions[which]
        known = len(repetition.runs)
        repetition.tell(index, row.result.get(FALLS, ()) if row.status == "done" else ())
        new = [self._job(which, at) for at in range(known, len(repetition.runs))]
        self._asked.extend(new)
        self.planned += len(new)

    def end(self, store: Store) -> None:
        """Do nothing: all runs count."""

    def _job(self, which: int, index: int) -> Job:
        branch, turns = self.repetitions[which].runs[index], len(self.repetitions)
        reseeds: list[dict[str, Any]] = [{"at_s": at_s, "seed": seed} for at_s, seed in branch.reseeds]
        settings = {**self._plain[branch.root * turns + which].settings, "reseed": reseeds}
        return self._campaign.job(self._part, index * turns + which, settings, BRANCHED)


def judge_split(campaign: Campaign, part: PartTable, rows: Sequence[RunRow]) -> Judged:
    """Judge the runs of a part that splits, given in the order of their numbers."""
    table = part.split
    assert table is not None
    asked = f"min_margin.{table.rule} < {table.below:g}"
    text = f"how often {asked}" if table.at_most is None else f"{asked} in at most {table.at_most:g} of runs"
    split = Split(campaign, part)
    for row in rows:
        split.tell(row)
    void = [each.void for each in split.repetitions if each.void]
    found = [each.estimate for each in split.repetitions if each.estimate is not None]
    if void or len(found) < table.repetitions:
        why = f": {void[0]}" if void else ""
        return Judged(text, f"{len(found)} of {table.repetitions} repetitions have an end{why}", holds=False)
    plain = [row for row in rows if row.axes != BRANCHED]
    count, of = sum(row.result[FALLS][-1][1] < table.below for row in plain), len(plain)
    reached = sum(each > 0.0 for each in found)
    share, low, high = positive_mean(found)
    # If repetitions die out, their spread does not show what they missed; the plain runs' interval holds in any case.
    by_spread = reached >= _REACHED * len(found) and len(rows) > of
    if not by_spread:
        low, high = proportion(count, of)
    hours = fmean(row.robot_hours for row in plain)
    words = (
        f"{share:.3g} of runs ({low:.3g} to {high:.3g}), {share / hours:.3g} per robot-hour ({low / hours:.3g} to "
        f"{high / hours:.3g}), by {len(rows)} runs; {reached} of {len(found)} repetitions got there; "
        f"{'plain runs' if by_spread else 'the interval is that of the plain runs'}: {count} of {of}"
    )
    return Judged(text, words, table.at_most is None or high <= table.at_most)
