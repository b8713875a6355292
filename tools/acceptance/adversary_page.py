"""The tables of docs/adversaries.md."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Final

from soter.runner import RunResult
from soter.sdk import RULES
from tools.acceptance.adversaries import APART, DISTANCES, LINKS, STRETCHED, least_m, least_part
from tools.acceptance.judge import Criterion, Outcome
from tools.acceptance.page import commands, exposure, head, robot_hours, table

_GROUPS: Final = {
    "adversary": ("With the robots as they are", "The default modules."),
    **{
        link: (f"Over a link that is {link}", f"The default modules, with `{settings[0]}`.")
        for link, settings in LINKS.items()
    },
    "stretched": (
        "The worst latency",
        f"One robot alone, with {', '.join(f'`{setting}`' for setting in STRETCHED[1:])}.",
    ),
    "apart": (
        "The worst latency, for two",
        f"An empty hall, with {', '.join(f'`{setting}`' for setting in APART[1:])}.",
    ),
}

_TRUTH: Final = "Least margins are those of ground truth, in metres, and as parts of R(H)."


def adversary_section(outcomes: Sequence[Outcome], judged: Sequence[Criterion], source: str, scale: float) -> str:
    """Return the generated part of the page."""
    lines = head(judged, source, scale)
    for group, (title, text) in _GROUPS.items():
        runs = [outcome for outcome in outcomes if outcome.case.group == group and outcome.result is not None]
        if runs:
            lines += [f"## {title}", "", text, *_about(runs), *_margins(runs)]
    whole = [
        (outcome.case, outcome.result)
        for outcome in outcomes
        if outcome.result is not None and set(RULES) <= set(outcome.result.modules)
    ]
    if whole:
        lines += exposure(whole)
    return "\n".join(lines + commands(outcomes, scale))


def _about(runs: Sequence[Outcome]) -> list[str]:
    seeds, first = sorted({outcome.case.seed for outcome in runs}), runs[0].case
    about = f"Each line: seeds {', '.join(map(str, seeds))}, {first.duration_s / 3600.0:g} h each."
    return [f"{about} Violations: {' / '.join(RULES)}. {_TRUTH}", ""]


def _margins(runs: Sequence[Outcome]) -> list[str]:
    columns = [
        "adversary", "engine", "violations", *(f"{rule}, least" for rule in DISTANCES), "battery, least", "AC share",
        "disengagements per robot-hour", "no certified motion, ticks", "x real time",
    ]  # fmt: skip
    rows = []
    for (name, engine), found in groupby(runs, key=lambda outcome: (outcome.case.subject, outcome.case.engine)):
        same = list(found)
        results = [outcome.result for outcome in same if outcome.result is not None]
        rows.append([name, engine, _violations(results), *(_least(same, rule) for rule in DISTANCES), *_rest(results)])
    return table(columns, rows, texts=2)


def _violations(results: Sequence[RunResult]) -> str:
    if any(result.violations is None for result in results):
        return "unknown"
    return " / ".join(str(sum((result.violations or {})[rule] for result in results)) for rule in RULES)


def _least(runs: Sequence[Outcome], rule: str) -> str:
    least = least_part(runs, rule)
    if least is None:
        return "-"
    part, outcome = least
    return f"{least_m(outcome, rule):.3f} = {part:.2f} R"


def _rest(results: Sequence[RunResult]) -> list[str]:
    hours = sum(map(robot_hours, results))
    charge = min(((result.min_margin or {}).get("battery", 0.0) for result in results), default=0.0)
    return [
        f"{charge:.3f}",
        f"{sum(result.ac_share for result in results) / len(results):.1%}",
        f"{sum(result.disengagements_total for result in results) / hours:.0f}",
        str(sum(result.no_certified_motion for result in results)),
        f"{sum(result.real_time_factor for result in results) / len(results):.0f}",
    ]
