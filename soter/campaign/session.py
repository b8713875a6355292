"""Runs what a campaign lacks, keeps it, and knows when it is enough."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

from soter.campaign.conditions import StoppingRule, figure
from soter.campaign.intervals import enough, rate_evidence, share_evidence
from soter.campaign.job import Done, Job
from soter.campaign.plan import Campaign
from soter.campaign.splitting import Split
from soter.campaign.store import RunRow, Store
from soter.campaign.tables import PartTable
from soter.campaign.workers import Workers

MOST_DEATHS: Final = 3
"""A run of which so many workers have died has failed."""

_POLL_S: Final = 0.2


@dataclass
class Totals:
    """What a campaign has up to now.

    Attributes:
        runs: finished ones that count.
        planned: how many there are to be, at most.
        robot_hours: simulated.
        violations: by rule, by ground truth.
        status: how many runs are done, refused, failed.
        left_s: estimate of the host time that is left; None while nothing is known.
    """

    runs: int = 0
    planned: int = 0
    robot_hours: float = 0.0
    violations: Counter[str] = field(default_factory=Counter)
    status: Counter[str] = field(default_factory=Counter)
    left_s: float | None = None

    def add(self, row: RunRow) -> None:
        """Count a run."""
        self.runs += 1
        self.robot_hours += row.robot_hours
        self.violations.update(row.violations or {})
        self.status[row.status] += 1


class Source(Protocol):
    """Where the runs of a part come from.

    Attributes:
        planned: how many there are at most, as far as that is known.
    """

    planned: int

    def next(self) -> Job | None:
        """Return the next run; None if there is none now. There may be one after more are finished."""

    def tell(self, row: RunRow) -> None:
        """Hear of a finished run."""

    def end(self, store: Store) -> None:
        """Put right what the store counts, once nothing more is run."""


class Listed:
    """The runs of a part in their order, until they are all done or its stopping rule holds; `Source`.

    The rule is asked about the first run, the first two, and so on: what of them is finished first has no say in when
    a campaign ends.
    """

    def __init__(self, campaign: Campaign, part: PartTable) -> None:
        self.planned = sum(1 for _ in part.rows()) * len([*part.all_seeds()])
        self._jobs: Final[Iterator[Job]] = campaign.jobs(part)
        self._part: Final = part
        self._waiting: Final[dict[int, RunRow]] = {}
        self._look: Final = None if part.until is None else Look(part.until)
        self._next = 0
        self._enough = False

    def next(self) -> Job | None:
        return None if self._enough else next(self._jobs, None)

    def tell(self, row: RunRow) -> None:
        if self._look is None or self._enough:
            return
        self._waiting[row.number] = row
        while not self._enough and self._next in self._waiting:
            self._enough = self._look.at(self._waiting.pop(self._next))
            self._next += 1
        if self._enough:
            self.planned = self._next

    def end(self, store: Store) -> None:
        if self._enough:
            store.leave_out(self._part.name, self._next)


class Look:
    """A stopping rule that looks at one run after another.

    Attributes:
        log_evidence: that what must be rare is, as a logarithm; see `rate_evidence`.
    """

    def __init__(self, rule: StoppingRule) -> None:
        self.rule: Final = rule
        self.log_evidence = 0.0
        self._events = self._runs = 0
        self._hours = 0.0

    def at(self, row: RunRow) -> bool:
        """Look at one run more; return whether it is enough. A run without that figure is none that shows anything."""
        found = figure(row, self.rule.figure)
        if found is None:
            return False
        self._runs += 1
        self._hours += row.robot_hours
        if self.rule.per_hour:
            self._events += round(found)
            self.log_evidence = rate_evidence(self._events, self._hours, self.rule.bound)
        else:
            self._events += found > 0.0
            self.log_evidence = share_evidence(self._events, self._runs, self.rule.bound)
        return enough(self.log_evidence, self.rule.level)


def sources(campaign: Campaign) -> list[Source]:
    """Return where the runs of a campaign come from."""
    found: list[Source] = []
    for part in campaign.parts.values():
        if part.split is not None:
            found.append(Split(campaign, part))
        elif part.search is None:
            found.append(Listed(campaign, part))
        else:
            # Only searches need its library.
            from soter.campaign.search import Searched

            found.append(Searched(campaign, part))
    return found


def run_campaign(
    campaign: Campaign,
    store: Store,
    workers: Workers,
    *,
    stop: Callable[[], bool] = lambda: False,
    on_change: Callable[[Totals, RunRow | None], None] = lambda totals, row: None,
) -> Totals:
    """Run what the store lacks.

    Args:
        campaign: what.
        store: keeps finished runs; what it has is not run again.
        workers: carry runs out.
        stop: asked again and again whether to end; runs under way are then given up.
        on_change: told of every run that is finished, and first of what is there already.

    Returns:
        What there is in the end.
    """
    known, totals, all_sources = store.ids(), Totals(), sources(campaign)
    running: dict[Future[Done], tuple[Job, Source, float]] = {}
    deaths: Counter[str] = Counter()
    again: list[tuple[Job, Source]] = []
    lacking: dict[Source, Job | None] = {}
    began_s, finished = time.monotonic(), 0

    def changed(row: RunRow | None) -> None:
        # Runs that were under way when a stopping rule was met are finished all the same.
        totals.planned = max(sum(source.planned for source in all_sources), totals.runs)
        if finished:
            totals.left_s = (time.monotonic() - began_s) / finished * (totals.planned - totals.runs)
        on_change(totals, row)

    def tell(source: Source, job: Job, *, quiet: bool = False) -> None:
        for row in store.rows(run=job.id):
            totals.add(row)
            # A store that had another plan before may have it at another place.
            source.tell(replace(row, number=job.number))
            if not quiet:
                changed(row)

    def fresh(source: Source) -> Job | None:
        """Return the next run of a source that the store has not; it hears of those that it has."""
        had = []
        while (job := source.next()) is not None and job.id in known:
            had.append(job)
            tell(source, job, quiet=True)
        store.count(had)
        return job

    def upcoming() -> tuple[Job, Source] | None:
        if again:
            return again.pop()
        for source in all_sources:
            if (job := lacking.pop(source, None) or fresh(source)) is not None:
                return job, source
        return None

    def finish(future: Future[Done], job: Job, source: Source, since_s: float) -> None:
        nonlocal finished
        try:
            done = future.result()
        except workers.died as death:
            deaths[job.id] += 1
            late = job.limit_s is not None and time.monotonic() - since_s > job.limit_s
            if deaths[job.id] < MOST_DEATHS and not late:
                again.append((job, source))
                return
            done = Done("failed", f"no end after {job.limit_s:g} s" if late else f"its worker died: {death}")
        if done.status == "stopped":
            return
        finished += 1
        store.add(job, done)
        known.add(job.id)
        tell(source, job)

    with workers:
        # Before anything is said, all sources hear of what the store has, up to the first run that it lacks.
        lacking.update((source, fresh(source)) for source in all_sources)
        changed(None)
        while not stop():
            while len(running) < workers.count and (found := upcoming()) is not None:
                job, source = found
                running[workers.submit(job)] = job, source, time.monotonic()
            if not running:
                break
            for future in wait(running, _POLL_S, FIRST_COMPLETED).done:
                finish(future, *running.pop(future))
    for source in all_sources:
        source.end(store)
    changed(None)
    return totals
