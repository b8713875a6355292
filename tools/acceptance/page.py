"""The tables of the evaluation, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from soter.runner import RunResult
from soter.runner.result import THESIS_AC_SHARE, THESIS_DISENGAGEMENTS
from soter.sdk import RULES
from tools.acceptance.cases import MODULES, PLANNERS, Case
from tools.acceptance.judge import Criterion, Outcome, upper_rate

BEGIN: Final = "<!-- Begin of what `make accept` writes. -->"
END: Final = "<!-- End of what `make accept` writes. -->"

_NEW_PAGE: Final = f"""# Evaluation

The long figures: hours of simulated missions, judged by the simulator's ground truth at its own rate and never by the
state that the modules see. `make accept` runs what is missing and writes the part between the markers.

{BEGIN}
{END}
"""


_PROTECTED: Final = (
    f"Violations are counted by ground truth: {' / '.join(RULES)}. The thesis reports {THESIS_DISENGAGEMENTS} "
    f"disengagements in 2 h with 2 robots (mean of 4 runs), the AC in control {THESIS_AC_SHARE:.1%} of the time, and "
    "no violation. A stall is the longest time that a robot with a target, and not charging, stays within 0.1 m; no "
    "progress, the longest time in which no robot's target ends."
)
_DISENGAGEMENTS: Final = (
    "Disengagements, by the module that fired first. Needless: the AC's pending waypoints, rolled forward one more "
    "Delta, or to their end, would have kept the module's rule. Per robot-hour, the thesis has "
    f"{THESIS_DISENGAGEMENTS / 4:.0f}."
)
_BOUND: Final = (
    "A rate is at most so high with 95 % confidence, if violations come independently of each other (for none in T "
    "hours, 3/T). That holds for these workspaces, targets and simulated robots, and for nothing else."
)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1) -> list[str]:
    """Return a table whose first `texts` columns are texts and whose others are numbers."""
    rules = ["---" if column < texts else "--:" for column in range(len(head))]
    lines = [head, rules, *rows]
    return [f"| {' | '.join(line)} |" for line in lines] + [""]


def _done(outcomes: Iterable[Outcome], group: str) -> list[tuple[Case, RunResult]]:
    return [(o.case, o.result) for o in outcomes if o.case.group == group and o.result is not None]


def kinds(result: RunResult) -> str:
    """Return the violations of every rule."""
    found = result.violations
    return "unknown" if found is None else " / ".join(str(found[rule]) for rule in RULES)


def _margins(result: RunResult) -> list[str]:
    return ["-" if (margin := (result.min_margin or {}).get(rule)) is None else f"{margin:.3f}" for rule in RULES]


def head(judged: Sequence[Criterion], source: str, scale: float) -> list[str]:
    """Return what every evaluation begins with: the state of the sources, and the criteria."""
    lines = []
    if scale != 1.0:
        lines += [f"**This is no evaluation: durations are multiplied by {scale:g}.**", ""]
    lines += [f"State of the sources: `{source}`.", "", "## Criteria", ""]
    return lines + table(
        ["criterion", "found", "verdict"],
        ([each.text, each.found, f"**{each.verdict.value}**"] for each in judged), texts=3,
    )  # fmt: skip


def section(outcomes: Sequence[Outcome], judged: Sequence[Criterion], source: str, scale: float) -> str:
    """Return the generated part of the page."""
    lines = head(judged, source, scale)
    protected = _done(outcomes, "protected")
    if protected:
        lines += _protected(protected) + exposure(protected)
    lines += _ablations(outcomes)
    lines += _repeats(outcomes)
    lines += _planners(outcomes)
    lines += commands(outcomes, scale)
    return "\n".join(lines)


def _protected(runs: Sequence[tuple[Case, RunResult]]) -> list[str]:
    lines = [
        "## With all modules", "",
        _PROTECTED, "",
    ]  # fmt: skip
    lines += table(
        ["targets", "engine", "seed", "robots", "violations", "AC share", "without charging", "reached",
         "other targets", "stall, s", "no progress, s", "x real time"],
        (
            [case.subject, case.engine, str(case.seed), str(r.robots), kinds(r), f"{r.ac_share:.1%}",
             f"{r.ac_share_without_charging:.1%}", str(r.targets_reached),
             f"{r.targets.unsafe} unsafe, {r.targets.blocked} blocked, {r.targets.timed_out} timed out",
             f"{r.longest_stall_s:.1f}", f"{r.no_progress_s:.1f}", f"{r.real_time_factor:.0f}"]
            for case, r in runs
        ),
        texts=2,
    )  # fmt: skip
    lines += [
        _DISENGAGEMENTS, "",
    ]  # fmt: skip
    lines += table(
        ["targets", "engine", "seed", *MODULES, "other", "total", "per robot-hour", "needless: one Delta",
         "whole path", "no certified motion, ticks"],
        (
            [case.subject, case.engine, str(case.seed), *(str(r.disengagements.get(name, 0)) for name in MODULES),
             str(sum(n for name, n in r.disengagements.items() if name not in MODULES)), str(r.disengagements_total),
             f"{r.disengagements_total / robot_hours(r):.0f}", str(r.needless.one_delta), str(r.needless.whole_path),
             str(r.no_certified_motion)]
            for case, r in runs
        ),
        texts=2,
    )  # fmt: skip
    lines += [
        "Least margins, by ground truth (charge from 0 to 1, then metres), and the hash over all states and decisions.",
        "",
    ]
    lines += table(
        ["targets", "engine", "seed", *RULES, "trace"],
        ([case.subject, case.engine, str(case.seed), *_margins(r), f"`{r.trace_sha256[:16]}`"] for case, r in runs),
        texts=2,
    )
    return lines


def robot_hours(result: RunResult) -> float:
    """Return the time of all robots of a run together."""
    return result.robots * result.duration_s / 3600.0


def exposure(runs: Sequence[tuple[Case, RunResult]]) -> list[str]:
    """Return how long was looked for violations, and what the bound on their rate is."""
    hours = sum(result.duration_s for _, result in runs) / 3600.0
    together = sum(robot_hours(result) for _, result in runs)
    lines = [
        "## Exposure", "",
        f"{len(runs)} runs, {hours:.3g} h of missions, {together:.3g} robot-hours. {_BOUND}", "",
    ]  # fmt: skip
    rows = []
    for rule in RULES:
        count = sum((result.violations or {}).get(rule, 0) for _, result in runs)
        rows.append([rule, str(count), f"{upper_rate(count, hours):.3g}", f"{upper_rate(count, together):.3g}"])
    total = sum(sum((result.violations or {}).values()) for _, result in runs)
    rows.append(["any", str(total), f"{upper_rate(total, hours):.3g}", f"{upper_rate(total, together):.3g}"])
    return lines + table(["rule", "violations", "most per hour", "most per robot-hour"], rows)


def _ablations(outcomes: Sequence[Outcome]) -> list[str]:
    runs = [*_done(outcomes, "unprotected"), *_done(outcomes, "without")]
    if not runs:
        return []
    lines = ["## Without modules", "", f"The same robots and `hostile` targets. Violations: {' / '.join(RULES)}.", ""]
    return lines + table(
        ["left out", "engine", "seed", "violations", "contacts", "AC share", "reached"],
        (
            ["all modules" if case.group == "unprotected" else case.subject, case.engine, str(case.seed), kinds(r),
             str(r.contacts), f"{r.ac_share:.1%}", str(r.targets_reached)]
            for case, r in runs
        ),
        texts=2,
    )  # fmt: skip


def _repeats(outcomes: Sequence[Outcome]) -> list[str]:
    results = {o.case.name: o.result for o in outcomes}
    rows = []
    for case, again in _done(outcomes, "repeated"):
        first = results.get(case.repeats)
        if first is not None:
            same = "yes" if again.trace_sha256 == first.trace_sha256 else "no"
            traces = [f"`{result.trace_sha256[:16]}`" for result in (first, again)]
            rows.append(
                [
                    case.engine,
                    f"{case.subject} {case.seed}",
                    *traces,
                    same,
                    f"{first.wall_s:.0f}",
                    f"{again.wall_s:.0f}",
                ]
            )
    if not rows:
        return []
    lines = ["## Determinism", "", "Two processes; the second beside twice as many busy ones as there are cores.", ""]
    columns = ["engine", "run", "trace", "trace under load", "same", "took, s", "under load, s"]
    return lines + table(columns, rows, texts=5)


def _planners(outcomes: Sequence[Outcome]) -> list[str]:
    runs = _done(outcomes, "planner")
    if not runs:
        return []
    lines = [
        "## Planners that misbehave", "",
        f"For robot 1 only; what is reached, robot 2 reaches. Violations: {' / '.join(RULES)}.", "",
    ]  # fmt: skip
    return lines + table(
        ["the planner", "violations", "reached", "blocked", "simulated, s", "took, s"],
        (
            [PLANNERS[case.subject], kinds(r), str(r.targets_reached), str(r.targets.blocked), f"{r.duration_s:g}",
             f"{r.wall_s:.0f}"]
            for case, r in runs
        ),
    )  # fmt: skip


def commands(outcomes: Sequence[Outcome], scale: float) -> list[str]:
    """Return every run's command."""
    lines = [
        "## Commands",
        "",
        "Each run again, from the top of the work tree; `--json FILE` writes all its figures.",
        "",
    ]
    return lines + table(["run", "command"], ([o.case.name, f"`{o.case.command(scale)}`"] for o in outcomes), texts=2)


def write(page: Path, generated: str) -> None:
    """Put the generated part into the page, between its markers; make the page if there is none.

    Raises:
        ValueError: the page has lost its markers.
    """
    text = page.read_text() if page.exists() else _NEW_PAGE
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page} has lost the lines '{BEGIN}' and '{END}', between which its tables go")
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(f"{before}{begin}\n\n{generated.rstrip()}\n\n{end}{after}")
