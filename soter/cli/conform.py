"""`soter conform`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.exits import ExitCode, complain, guard

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from soter.cli.outputs import Output, StandardOutput
    from soter.conformance import Clause, Outcome, Record
    from soter.conformance.bench import Figure

EXAMPLES = """Examples:

  soter conform pybullet

  soter conform my_robots.harness:MyHarness --json record.json --junit junit.xml

  soter conform kinematic --only deadman --only goto.arrives

Exit codes:

  0  the adapter conforms, or passes the clauses that were selected

  1  it does not conform

  2  bad input, or a backend that cannot be used here
"""


def conform(
    adapter: Annotated[
        str | None,
        typer.Argument(
            metavar="BACKEND|MODULE:HARNESS", help="A backend's name, or a harness of your own.", show_default=False
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="Only this clause, or this group of clauses; may be repeated."),
    ] = None,
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the record; - is standard output.")
    ] = None,
    junit: Annotated[
        Path | None, typer.Option("--junit", metavar="FILE", help="Write JUnit XML; - is standard output.")
    ] = None,
    list_clauses: Annotated[bool, typer.Option("--list", help="List the clauses and exit.")] = False,
) -> None:
    """Try an adapter against every clause of the conformance kit and say whether it conforms."""
    with guard():
        import json as writer
        import sys

        from soter.cli.console import make_console
        from soter.cli.outputs import Output, StandardOutput, json_output, refuse_clashes
        from soter.conformance import Overall, find_harness, judge, select
        from soter.errors import ConfigError

        # A harness of one's own is found as Python run here would find it.
        sys.path.insert(0, "")
        clauses = select(only or ())
        to_stderr = "-" in (str(json), str(junit))
        console = make_console(stderr=to_stderr)
        if list_clauses:
            _print_list(console, clauses)
            return
        if adapter is None:
            raise ConfigError("say which: a backend's name, or module:Harness; `soter backends` lists the backends")
        if str(json) == "-" == str(junit):
            raise ConfigError("--json and --junit cannot both go to standard output", source="command line")
        refuse_clashes({"--json": json, "--junit": junit})
        json_file = None if json is None else json_output(json)
        junit_file = None if junit is None else StandardOutput() if str(junit) == "-" else Output(junit, "--junit")
        harness = find_harness(adapter)
        with _Table(console, len(clauses)) as table:
            record = judge(harness, clauses, table.add, table.begin)
        _print_verdict(console, record)
        written = _write(json_file, f"{writer.dumps(record.as_dict(), indent=2)}\n")
        written = _write(junit_file, f"{record.as_junit()}\n") and written
        if not written:
            raise typer.Exit(ExitCode.RUN_FAILED)
        raise typer.Exit(ExitCode.VIOLATION if record.overall is Overall.FAILS else ExitCode.OK)


class _Table:
    """Shows outcomes as they come: a line each, and below them, on a terminal, what is being tried."""

    def __init__(self, console: Console, total: int) -> None:
        from rich.status import Status

        from soter.cli.console import is_live

        self._console = console
        self._total = total
        self._done = 0
        self._status = Status("", console=console) if is_live(console) else None

    def __enter__(self) -> _Table:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def begin(self, clause: Clause) -> None:
        """Say what is being tried."""
        if self._status is not None:
            self._status.update(f"{self._done + 1} of {self._total}  {clause.id}")

    def add(self, outcome: Outcome) -> None:
        """Print one outcome."""
        self._done += 1
        self._console.print(_line(outcome), soft_wrap=True)


_WIDTH = 34
_STYLES = {"PASS": "green", "FAIL": "bold red", "NOT TESTED": "yellow"}


def _line(outcome: Outcome) -> Text:
    from rich.text import Text

    verdict = outcome.verdict.value
    line = Text.assemble((f"{verdict:<10}", _STYLES[verdict]), f"  {outcome.clause.id:<{_WIDTH}}")
    if outcome.reason:
        # What was promised, and what was found instead.
        return line.append(
            f"{outcome.clause.contract}\n{'':12}{outcome.reason}" if verdict == "FAIL" else outcome.reason
        )
    return line.append(", ".join(map(_figure, outcome.figures)), "dim")


def _figure(figure: Figure) -> str:
    value, bound = figure.value, figure.bound
    if bound is None:
        return f"{figure.name} {value:.3g}"
    # Why what is beyond its bound has passed all the same.
    unsure = f" (measured to {figure.resolution:.2g})" if value > bound and figure.resolution else ""
    return f"{figure.name} {value:.3g} of {bound:.3g}{unsure}"


def _print_list(console: Console, clauses: list[Clause]) -> None:
    for each in clauses:
        needs = ", ".join((*each.hooks, *each.needs))
        extra = f" (needs {needs})" if needs else ""
        console.print(f"{each.id:<{_WIDTH}}{each.tier.value:<6}{each.contract}{extra}", soft_wrap=True)


def _print_verdict(console: Console, record: Record) -> None:
    from rich.text import Text

    from soter.conformance import KIT_VERSION, Overall, Verdict
    from soter.conformance.record import overall

    counts = ", ".join(f"{record.count(each)} {each.value}" for each in Verdict)
    console.print(f"\n{record.adapter}: {len(record.outcomes)} clauses of kit {KIT_VERSION}: {counts}")
    in_process = record.subject is not None and record.subject.in_process
    missing: dict[str, list[Outcome]] = {}
    for each in record.outcomes:
        if each.verdict is Verdict.NOT_TESTED:
            missing.setdefault(each.reason, []).append(each)
    for reason, outcomes in sorted(missing.items()):
        needed = record.overall is Overall.FAILS and overall(outcomes, in_process=in_process) is Overall.FAILS
        what = "not tested, and may not be left out" if needed else "not tested"
        console.print(f"  {what}: {reason} ({len(outcomes)} clause{'s' * (len(outcomes) > 1)})", soft_wrap=True)
    console.print(Text(record.overall.value, "bold red" if record.overall is Overall.FAILS else "bold green"))


def _write(file: Output | StandardOutput | None, text: str) -> bool:
    try:
        if file is not None:
            file.write(text.encode())
    except OSError as failure:
        complain(f"the record could not be written: {failure}")
        return False
    return True
