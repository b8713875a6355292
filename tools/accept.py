"""The long figures of docs/evaluation.md: runs what is missing, judges all of it, writes the tables. `make accept`.

With `--suite adversaries` those of docs/adversaries.md.

Finished runs are kept below out/accept, so the evaluation can be stopped with Ctrl-C and carried on at any time. A
change of the code, the examples or a library begins it anew, because what was measured then is something else.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from tools.acceptance import page
from tools.acceptance.adversaries import adversary_cases, adversary_criteria
from tools.acceptance.adversary_page import adversary_section
from tools.acceptance.cases import Case, all_cases
from tools.acceptance.judge import Criterion, Outcome, Verdict, criteria
from tools.acceptance.running import Session
from tools.acceptance.store import FOLDER, ROOT, Store, source_hash

PAGE = ROOT / "docs" / "evaluation.md"


@dataclass(frozen=True)
class Suite:
    """One evaluation.

    Attributes:
        page: where its tables go.
        cases: its runs.
        criteria: judges them.
        section: writes the tables.
    """

    page: Path
    cases: Callable[[], list[Case]]
    criteria: Callable[[Sequence[Outcome]], list[Criterion]]
    section: Callable[[Sequence[Outcome], Sequence[Criterion], str, float], str]


SUITES = {
    "missions": Suite(PAGE, all_cases, criteria, page.section),
    "adversaries": Suite(ROOT / "docs" / "adversaries.md", adversary_cases, adversary_criteria, adversary_section),
}
STYLES = {Verdict.REACHED: "green", Verdict.NOT_REACHED: "bold red", Verdict.INCOMPLETE: "yellow"}


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the command line's arguments."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--suite", choices=SUITES, default="missions", help="which evaluation (default: missions)")
    parser.add_argument("--only", metavar="PATTERN", action="append", help="runs whose name matches, such as '*grid*'")
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="runs at a time (default: 2)")
    parser.add_argument("--list", action="store_true", help="name the runs and their commands, and run nothing")
    parser.add_argument(
        "--scale", metavar="F", type=float, default=1.0,
        help="multiply all durations; to try this program out: the result is no evaluation and stays out of docs/",
    )  # fmt: skip
    parser.add_argument("--folder", metavar="DIR", type=Path, default=FOLDER, help="where finished runs are kept")
    given = parser.parse_args(argv)
    if given.jobs < 1:
        parser.error(f"--jobs is {given.jobs}, allowed: at least 1")
    if not 0.0 < given.scale <= 1.0:
        parser.error(f"--scale is {given.scale:g}, allowed: above 0, at most 1")
    return given


def chosen(cases: Sequence[Case], patterns: Sequence[str] | None) -> list[Case]:
    """Return the cases that match one of the patterns, and those that they are compared with."""
    if patterns is None:
        return list(cases)
    found = [case for case in cases if any(fnmatch(case.name, pattern) for pattern in patterns)]
    wanted = {case.name for case in found} | {case.repeats for case in found}
    return [case for case in cases if case.name in wanted]


def run_missing(cases: Sequence[Case], store: Store, jobs: int, console: Console) -> dict[str, str]:
    """Run the cases that the store has no result of; return what went wrong, by name."""
    missing = [case for case in cases if store.load(case) is None]
    if not missing:
        return {}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as progress:
        overall = progress.add_task("runs", total=len(cases), completed=len(cases) - len(missing))
        running: dict[str, TaskID] = {}

        def on_change(case: Case, event: str) -> None:
            if event == "started":
                running[case.name] = progress.add_task(f"  {case.name}", total=None)
                return
            progress.remove_task(running.pop(case.name))
            progress.advance(overall)
            progress.console.print(f"{case.name}: {event}", soft_wrap=True, highlight=False, markup=False)

        session = Session(store, on_change)
        session.run(missing, jobs)
    return session.failures


def show(judged: Sequence[Criterion], console: Console) -> None:
    """Print the criteria."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("criterion", "found", "verdict"):
        table.add_column(column)
    for each in judged:
        table.add_row(each.text, each.found, f"[{STYLES[each.verdict]}]{each.verdict.value}[/]")
    console.print(table)


def main(argv: Sequence[str] | None = None) -> int:
    """Run, judge, write; return the exit code: 0 if nothing failed, 1 if something did, 130 after Ctrl-C."""
    given = parse(argv)
    console = Console(highlight=False)
    suite = SUITES[given.suite]
    everything = suite.cases()
    cases = chosen(everything, given.only)
    if not cases:
        console.print("no run has such a name; --list names them all", style="red")
        return 2
    if given.list:
        for case in cases:
            console.print(f"{case.name:36} {case.command(given.scale)}", soft_wrap=True)
        return 0
    store = Store(source_hash(), given.scale, given.folder)
    try:
        failures = run_missing(cases, store, given.jobs, console)
    except KeyboardInterrupt:
        console.print("stopped; finished runs are kept, the same command carries on", style="yellow")
        return 130

    outcomes = [Outcome(case, store.load(case)) for case in everything]
    judged = suite.criteria(outcomes)
    show(judged, console)
    for name, failure in failures.items():
        console.print(f"{name}: {failure}", style="red", soft_wrap=True, markup=False)
    missing = sum(outcome.result is None for outcome in outcomes)
    target = suite.page if given.scale == 1.0 and not missing else given.folder / suite.page.name
    page.write(target, suite.section(outcomes, judged, store.source, given.scale))
    if missing:
        console.print(f"{missing} of {len(outcomes)} runs are still missing; docs/{suite.page.name} is left as it was")
    console.print(f"written: {target}", soft_wrap=True)
    refused = {Verdict.NOT_REACHED} if given.only else {Verdict.NOT_REACHED, Verdict.INCOMPLETE}
    return 1 if failures or any(each.verdict in refused for each in judged) else 0


if __name__ == "__main__":
    # Whoever ends this program ends its runs too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())
