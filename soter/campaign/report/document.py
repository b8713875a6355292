"""The generated part of a document: a campaign's tables as Markdown, with the command that repeats each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from soter.campaign.conditions import Judged
from soter.campaign.intervals import poisson, poisson_most
from soter.campaign.plan import Campaign
from soter.campaign.report.cells import HEAD, cells, disengagements, least, markdown, required
from soter.campaign.store import Store
from soter.campaign.summary import Group, groups
from soter.errors import ConfigError
from soter.sdk import RULES

BEGIN: Final = "<!-- Begin of what `soter campaign report` writes. -->"
END: Final = "<!-- End of what `soter campaign report` writes. -->"

_ABOUT: Final = (
    f"Violations are counted by ground truth: {' / '.join(RULES)}, and so are least margins (charge from 0 to 1, then "
    "metres). Rates have exact Poisson intervals at 95 %. A stall is the longest time that a robot, short of its "
    "target and not charging, stays within 0.1 m; no progress, the longest time in which no robot's target ends."
)
_BOUND: Final = (
    "Runs in which no rule may be broken. A rate is at most so high with 95 % confidence, if violations come "
    "independently of each other (for none in T hours, 3/T). That holds for these missions and simulated robots, and "
    "for nothing else."
)


def section(campaign: Campaign, store: Store, judged: Mapping[str, Sequence[Judged]]) -> str:
    """Return the generated part."""
    found = groups(store.rows())
    lines = [f"State of the sources: `{store.about()['sources']}`. {_ABOUT}", "", "## What is required", ""]
    lines += markdown(*required(judged, "**PASS**", "**NOT REACHED**"), texts=4)
    for name, part in campaign.parts.items():
        own = [group for group in found if group.part == name]
        lines += [f"## {name.replace('-', ' ').capitalize()}", "", *([part.note, ""] if part.note else [])]
        lines += markdown(HEAD[1:-1], [cells(group)[1:-1] for group in own])
        lines += _margins(own) + _modules(own)
    safe = [name for name, some in judged.items() if any(each.text == "violations == 0" for each in some)]
    lines += _exposure([group for group in found if group.part in safe and not group.branched])
    return "\n".join(lines + _commands(campaign, found))


def _margins(found: Sequence[Group]) -> list[str]:
    names = [rule for rule in RULES if any(group.spread(f"min_margin.{rule}") for group in found)]
    rows = [[group.name, *(least(group.spread(f"min_margin.{rule}")) for rule in names)] for group in found]
    return ["Least margins:", "", *markdown(["setting", *names], rows)] if names else []


def _modules(found: Sequence[Group]) -> list[str]:
    head, rows = disengagements(found)
    table = markdown(head[1:], [row[1:] for row in rows])
    return ["Disengagements per robot-hour, by the module that fired first:", "", *table]


def _exposure(found: Sequence[Group]) -> list[str]:
    hours = sum(group.robot_hours for group in found)
    if not hours:
        return []
    rows = []
    for rule in (*RULES, "any"):
        counts = [group.counts("violations") for group in found]
        count = sum(each.total() if rule == "any" else each[rule] for each in counts)
        low, high = poisson(count, hours)
        rows.append([rule, str(count), f"{low:.3g} to {high:.3g}", f"{poisson_most(count, hours):.3g}"])
    runs = sum(len(group.rows) for group in found)
    head = ["rule", "violations", "per robot-hour", "at most per robot-hour"]
    return ["## Exposure", "", f"{runs} runs, {hours:.4g} robot-hours. {_BOUND}", "", *markdown(head, rows)]


def _commands(campaign: Campaign, found: Sequence[Group]) -> list[str]:
    about = (
        f"All of it: `soter campaign {_here(campaign.path)}`. One run, with the proof that it is the same bit for bit: "
        "`soter campaign run-again ID --store FILE`. The first run of each line, from the top of the work tree; the "
        "others differ in the seed:"
    )
    rows = [
        [group.part, group.name, group.rows[0].id, f"{len(group.rows)}: {_seeds(group)}", f"`{group.rows[0].command}`"]
        for group in found
    ]
    return ["## Commands", "", about, "", *markdown(["part", "setting", "id", "seeds", "command"], rows, texts=5)]


def _here(path: Path) -> str:
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def _seeds(group: Group) -> str:
    if group.branched:
        return "those of the plain runs"
    seeds = sorted(row.seed for row in group.rows)
    follow = seeds == list(range(seeds[0], seeds[0] + len(seeds)))
    return f"{seeds[0]} to {seeds[-1]}" if follow and len(seeds) > 2 else ", ".join(map(str, seeds))


def write(page: Path, generated: str) -> None:
    """Put the generated part into a document, between its markers.

    Raises:
        ConfigError: there is no such document, or it lacks the markers.
    """
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as failure:
        raise ConfigError(f"it cannot be read: {failure.strerror}", source=str(page), key="--into") from failure
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ConfigError(f"it lacks the lines '{BEGIN}' and '{END}'", source=str(page), key="--into")
    page.write_text(f"{before}{begin}\n\n{generated.rstrip()}\n\n{end}{after}", encoding="utf-8")
