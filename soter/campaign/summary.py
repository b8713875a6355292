"""The results of a campaign: its runs by part and setting, rates with exact intervals, and its judgement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Final

from soter.campaign.conditions import Condition, Judged, figure
from soter.campaign.intervals import poisson
from soter.campaign.plan import Campaign
from soter.campaign.splitting import BRANCHED, judge_split
from soter.campaign.store import RunRow, Store
from soter.campaign.tables import PartTable
from soter.sdk import RULES

NO_VIOLATION: Final = Condition.parse("violations == 0")
"""The default requirement of a part that does not split."""


@dataclass(frozen=True)
class Rate:
    """Events per robot-hour, with the exact interval at 95 %."""

    count: int
    per_hour: float
    low: float
    high: float

    @classmethod
    def of(cls, count: int, hours: float) -> Rate:
        """Return the rate of `count` events in some robot-hours."""
        return cls(count, count / hours if hours else 0.0, *poisson(count, hours))


@dataclass(frozen=True)
class Spread:
    """The least, the mean and the greatest of some values."""

    least: float
    mean: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread | None:
        """Return the spread of values; None if there are none."""
        return cls(min(values), fmean(values), max(values)) if values else None


@dataclass(frozen=True)
class Group:
    """The runs of a part with one setting, its axes, over their seeds."""

    part: str
    axes: Mapping[str, str]
    rows: tuple[RunRow, ...]

    @property
    def name(self) -> str:
        """The setting, in words."""
        return ", ".join(f"{axis.rpartition('.')[2]} {name}" for axis, name in self.axes.items()) or "-"

    @property
    def branched(self) -> bool:
        """Whether these runs branch from others in importance splitting, so that no rate follows from them."""
        return self.axes == BRANCHED

    @property
    def done(self) -> list[RunRow]:
        """The runs that got to their end."""
        return [row for row in self.rows if row.status == "done"]

    @property
    def robot_hours(self) -> float:
        """Simulated robot-hours, of all robots together."""
        return sum(row.robot_hours for row in self.rows)

    def status(self, name: str) -> int:
        """Return how many runs have a status."""
        return sum(row.status == name for row in self.rows)

    def rate(self, name: str) -> Rate | None:
        """Return the rate of a count per robot-hour; None if any run lacks the count."""
        if self.branched:
            return None
        counts = [figure(row, name) for row in self.rows if row.result]
        known = [count for count in counts if count is not None]
        return Rate.of(round(sum(known)), self.robot_hours) if known and len(known) == len(counts) else None

    def spread(self, name: str) -> Spread | None:
        """Return the spread of a figure over the runs that have it."""
        return Spread.of([value for row in self.rows if (value := figure(row, name)) is not None])

    def rules(self) -> list[str]:
        """Return the rules that ground truth judges in these runs."""
        named = [rule for row in self.rows for rule in row.violations or {}]
        return [*RULES, *sorted(set(named) - set(RULES))] if named else []

    def counts(self, name: str) -> Counter[str]:
        """Return the sums of a table of counts, such as `disengagements`, over the results."""
        return sum((Counter(row.result.get(name) or {}) for row in self.rows), Counter())


def groups(rows: Iterable[RunRow]) -> list[Group]:
    """Return runs grouped by part and setting, in the order of first appearance."""
    found: dict[tuple[str, tuple[tuple[str, str], ...]], list[RunRow]] = {}
    for row in rows:
        found.setdefault((row.part, tuple(row.axes.items())), []).append(row)
    return [Group(part, dict(axes), tuple(each)) for (part, axes), each in found.items()]


def judge(campaign: Campaign, store: Store) -> dict[str, list[Judged]]:
    """Return, by part, its requirements and whether they hold."""
    return {name: _judged(campaign, part, [*store.rows(part=name)], store) for name, part in campaign.parts.items()}


def _judged(campaign: Campaign, part: PartTable, rows: Sequence[RunRow], store: Store) -> list[Judged]:
    required = part.require or (() if part.split else (NO_VIOLATION,))
    if not rows:
        texts = [*(each.text for each in required), *([] if part.until is None else [part.until.text])]
        return [Judged(text, "no runs", holds=False, ran=False) for text in texts or ["its runs"]]
    finished = [row for row in rows if row.status != "failed"]
    found = [condition.judge(_asked(condition, finished)) for condition in required]
    if part.split is not None:
        found.append(judge_split(campaign, part, rows))
    failed, refused = (sum(row.status == status for row in rows) for status in ("failed", "refused"))
    if failed:
        found.append(Judged("no run fails", f"{failed} of {len(rows)} failed", holds=False))
    if refused and not part.may_refuse:
        found.append(Judged("no run is refused", f"{refused} of {len(rows)} were refused", holds=False))
    if part.repeats:
        found.append(_repeated(part, rows, store))
    if part.until is not None:
        from soter.campaign.session import Look

        look = Look(part.until)
        shown = any(look.at(row) for row in rows)
        found.append(Judged(part.until.text, f"{'shown' if shown else 'not shown'} by {len(rows)} runs", shown))
    return found


def _asked(condition: Condition, rows: Sequence[RunRow]) -> Sequence[RunRow]:
    return rows if condition.figure == "accepted" else [row for row in rows if row.status == "done"]


def _repeated(part: PartTable, rows: Sequence[RunRow], store: Store) -> Judged:
    def key(row: RunRow) -> str:
        return f"{row.mission} {sorted(row.settings.items())}"

    first = {key(row): row.trace_sha256 for row in store.rows(part=part.repeats)}
    same = sum(first.get(key(row)) == row.trace_sha256 != "" for row in rows)
    holds = bool(rows) and same == len(rows)
    return Judged(f"the same runs as those of {part.repeats}, bit for bit", f"{same} of {len(rows)} runs", holds)
