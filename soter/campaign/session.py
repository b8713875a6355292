"""Carries out the missing runs of a campaign, keeps them, and ends parts whose stopping rules hold."""

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
"""How many workers may die of a run before it has failed."""

_POLL_S: Final = 0.2


@dataclass
class Totals:
    """The progress of a campaign.

    Attributes:
        runs: number of finished runs that count.
        planned: largest number of runs.
        violations: number by rule, by ground truth, of rules that had a module in their run.
        unguarded: the same of rules without one.
        status: number of runs that are done, refused, failed.
        left_s: estimate of the remaining host time; None while it is unknown.
    """

    runs: int = 0
    planned: int = 0
    robot_hours: float = 0.0
    violations: Counter[str] = field(default_factory=Counter)
    unguarded: Counter[str] = field(default_factory=Counter)
    status: Counter[str] = field(default_factory=Counter)
    left_s: float | None = None

    def add(self, row: RunRow) -> None:
        """Count a run."""
        self.runs += 1
        self.robot_hours += row.robot_hours
        guarded = row.result.get("modules", ())
        for rule, count in (row.violations or {}).items():
            (self.violations if rule in guarded else self.unguarded)[rule] += count
        self.status[row.status] += 1


class Source(Protocol):
    """The source of the runs of a part.

    Attributes:
        planned: the largest number of runs, as far as it is known.
    """

    planned: int

    def next(self) -> Job | None:
        """Return the next run; None if there is none until more runs are finished, or none at all."""

    def tell(self, row: RunRow) -> None:
        """Take a finished run."""

    def end(self, store: Store) -> None:
        """Correct which runs the store counts, at the end of the campaign."""


class Listed:
    """The runs of a part in their order, until all are done or its stopping rule holds; `Source`.

    The rule is checked for the first run, the first two, and so on, so that the order in which runs finish does not
    matter.
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
    """Checks a stopping rule, one run after another.

    Attributes:
        log_evidence: logarithm of the evidence that the bound holds; see `rate_evidence`.
    """

    def __init__(self, rule: StoppingRule) -> None:
        self.rule: Final = rule
        self.log_evidence = 0.0
        self._events = self._runs = 0
        self._hours = 0.0

    def at(self, row: RunRow) -> bool:
        """Add a run; return whether the rule holds. A run without the figure is no evidence."""
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
    """Return the sources of a campaign's runs."""
    found: list[Source] = []
    for part in campaign.parts.values():
        if part.split is not None:
            found.append(Split(campaign, part))
        elif part.search is None:
            found.append(Listed(campaign, part))
        else:
            # Imported only here: only searches need the optimiser's library.
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
    """Carry out the runs that the store lacks.

    Args:
        campaign: the campaign.
        store: keeps finished runs; those that it has are not made again.
        workers: carry runs out.
        stop: polled; returns whether to end and give up the runs under way.
        on_change: called with the totals at the start, and with every finished run.

    Returns:
        The totals at the end.
    """
    known, totals, all_sources = store.ids(), Totals(), sources(campaign)
    running: dict[Future[Done], tuple[Job, Source, float]] = {}
    deaths: Counter[str] = Counter()
    again: list[tuple[Job, Source]] = []
    lacking: dict[Source, Job | None] = {}
    began_s, finished = time.monotonic(), 0

    def changed(row: RunRow | None) -> None:
        # Runs under way when a stopping rule is met are still finished, and count as planned.
        totals.planned = max(sum(source.planned for source in all_sources), totals.runs)
        if finished:
            totals.left_s = (time.monotonic() - began_s) / finished * (totals.planned - totals.runs)
        on_change(totals, row)

    def tell(source: Source, job: Job, *, quiet: bool = False) -> None:
        for row in store.rows(run=job.id):
            totals.add(row)
            # A store of an earlier plan may have the run at another place.
            source.tell(replace(row, number=job.number))
            if not quiet:
                changed(row)

    def fresh(source: Source) -> Job | None:
        """Return the next run of a source that the store lacks; pass those that it has to the source."""
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
        # Before the first report, pass the store's runs to all sources, up to the first one that it lacks.
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
