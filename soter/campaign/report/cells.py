"""Formats the figures of a group of runs for tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from soter.campaign.conditions import Judged
from soter.campaign.intervals import poisson_most
from soter.campaign.summary import Group, Rate, Spread
from soter.sdk import RULES

HEAD: Final = (
    "part", "setting", "runs", "robot-hours", "violations", "at most per robot-hour", "AC share",
    "disengagements per robot-hour", "reached per robot-hour", "longest stall, s", "no progress, s", "least margins",
)  # fmt: skip
"""Head of a table of groups; rules are in the order of `RULES`."""


def cells(group: Group) -> list[str]:
    """Return the table's line for a group."""
    refused, failed = group.status("refused"), group.status("failed")
    runs = [
        str(len(group.rows)),
        *([f"{refused} refused"] if refused else []),
        *([f"{failed} failed"] if failed else []),
    ]
    share = group.spread("ac_share")
    violations = group.rate("violations")
    most = f"{poisson_most(violations.count, group.robot_hours):.3g}" if violations else "-"
    return [
        group.part, group.name, ", ".join(runs), f"{group.robot_hours:.4g}", kinds(group), most,
        f"{share.mean:.1%}" if share else "-", rate(group.rate("disengagements_total")),
        rate(group.rate("targets_reached")), greatest(group.spread("longest_stall_s")),
        greatest(group.spread("no_progress_s")),
        " / ".join(least(group.spread(f"min_margin.{rule}")) for rule in RULES),
    ]  # fmt: skip


def kinds(group: Group) -> str:
    """Return the violations of every rule."""
    counts = group.counts("violations")
    return " / ".join(str(counts[rule]) for rule in group.rules()) or "unknown"


def disengagements(found: Sequence[Group]) -> tuple[list[str], list[list[str]]]:
    """Return the head and the lines of a table of disengagements by the module that fired first."""
    names = list(dict.fromkeys(name for group in found for name in group.counts("disengagements")))
    rates = [[rate(group.rate(f"disengagements.{name}")) for name in names] for group in found]
    return ["part", "setting", *names], [
        [group.part, group.name, *row] for group, row in zip(found, rates, strict=True)
    ]


def required(judged: Mapping[str, Sequence[Judged]], holds: str, fails: str) -> tuple[list[str], list[list[str]]]:
    """Return the head and the lines of a table of the parts' requirements; `holds` and `fails` are the verdicts."""
    rows = [
        [part, each.text, each.found, holds if each.holds else fails if each.ran else "not run"]
        for part, some in judged.items()
        for each in some
    ]
    return ["part", "required", "found", "verdict"], rows


def rate(found: Rate | None) -> str:
    """Return a rate with its interval."""
    return "-" if found is None else f"{found.per_hour:.3g} ({found.low:.3g} to {found.high:.3g})"


def least(spread: Spread | None) -> str:
    """Return the least of some values."""
    return "-" if spread is None else f"{spread.least:.3f}"


def greatest(spread: Spread | None) -> str:
    """Return the greatest of some values."""
    return "-" if spread is None else f"{spread.most:.4g}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> list[str]:
    """Return a table whose first `texts` columns are texts and whose others are numbers."""
    rules = ["---" if column < texts else "--:" for column in range(len(head))]
    return [f"| {' | '.join(line)} |" for line in (head, rules, *rows)] + [""] if rows else []
