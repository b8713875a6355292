"""The display of `soter conform`, and the files that it writes."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Collection, Mapping
from typing import Final

from rich.console import Console
from rich.status import Status
from rich.table import Table
from rich.text import Text

from soter.cli.console import is_live
from soter.cli.exits import complain
from soter.cli.outputs import Output, StandardOutput
from soter.conformance import KIT_VERSION, Clause, Outcome, Overall, Record, Verdict
from soter.conformance.figure import Figure
from soter.conformance.measured import measured_of
from soter.conformance.record import NOT_DECLARED, overall

WIDTH: Final = 34
_BUSY: Final = 2.0
"""Running and waiting programs per core of the host, from which on delays may be due to the host."""

_STYLES: Final = {"PASS": "green", "FAIL": "bold red", "NOT TESTED": "yellow"}


class Outcomes(contextlib.AbstractContextManager["Outcomes"]):
    """Shows outcomes as they come, a line each; on a terminal, the clauses being tried below them.

    Attributes:
        load: the most running and waiting programs per core of the host when a clause failed by a delay.
    """

    def __init__(self, console: Console, total: int) -> None:
        self._console: Final = console
        self._total: Final = total
        self._done = 0
        self.load = 0.0
        self._status: Final = Status("", console=console) if is_live(console) else None

    def __enter__(self) -> Outcomes:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def begin(self, clauses: Collection[Clause]) -> None:
        """Show which clauses are being tried."""
        if self._status is not None:
            self._status.update(f"{self._done} of {self._total} done  {', '.join(each.id for each in clauses)}")

    def add(self, outcome: Outcome) -> None:
        """Print one outcome."""
        self._done += 1
        if any(each.timed and not each.kept for each in outcome.figures):
            self.load = max(self.load, os.getloadavg()[0] / (os.cpu_count() or 1))
        self._console.print(_line(outcome), soft_wrap=True)


class Files:
    """Writes the record into files after every outcome, so that they are whole at every moment.

    Standard output, pipes and devices get it at the end. The files are those of `--json` and `--junit`, by option.
    """

    def __init__(self, files: Mapping[str, Output | StandardOutput]) -> None:
        self._files: Final = files
        self._failed: Final[set[str]] = set()

    def keep_up(self, record: Record) -> None:
        """Write the files that can be replaced."""
        self._write(record, [option for option, file in self._files.items() if file.replaceable])

    def finish(self, record: Record) -> bool:
        """Write all files; return whether that succeeded."""
        self._write(record, self._files)
        return not self._failed

    def _write(self, record: Record, options: Collection[str]) -> None:
        for option in options:
            text = _json(record) if option == "--json" else record.as_junit()
            try:
                self._files[option].write(f"{text}\n".encode())
            except OSError as failure:
                if not self._failed:
                    complain(f"the record could not be written: {failure}")
                self._failed.add(option)
            else:
                self._failed.discard(option)


def _json(record: Record) -> str:
    beside = [
        {"name": each.name, "promised": each.promised, "measured": each.measured, "clause": each.clause or None}
        for each in measured_of(record)
    ]
    return json.dumps({**record.as_dict(), "promises": beside}, indent=2)


def _line(outcome: Outcome) -> Text:
    verdict = outcome.verdict.value
    line = Text.assemble(
        (f"{verdict:<10}", _STYLES[verdict]), (f" {outcome.host_s:5.1f} s", "dim"), f"  {outcome.clause.id:<{WIDTH}}"
    )
    if outcome.reason:
        # A failed clause: its contract, and the reason.
        return line.append(
            f"{outcome.clause.contract}\n{'':20}{outcome.reason}" if verdict == "FAIL" else outcome.reason
        )
    return line.append(", ".join(map(_figure, outcome.figures)), "dim")


def _figure(figure: Figure) -> str:
    value, bound = figure.value, figure.bound
    if bound is None:
        return f"{figure.name} {value:.3g}"
    return f"{figure.name} {value:.3g} of {'at least ' if figure.at_least else ''}{bound:.3g}"


def print_list(console: Console, clauses: list[Clause]) -> None:
    """Print clauses with their needs."""
    for each in clauses:
        needs = ", ".join((*each.hooks, *each.needs))
        extra = f" (needs {needs})" if needs else ""
        console.print(f"{each.id:<{WIDTH}}{each.tier.value:<6}{each.contract}{extra}", soft_wrap=True)


def print_summary(console: Console, record: Record, host_s: float, load: float = 0.0) -> None:
    """Print the promises with their measured values, the clauses that were not tested, and the verdict.

    `load` is that of `Outcomes`.
    """
    _print_promises(console, record)
    counts = ", ".join(f"{record.count(each)} {each.value}" for each in Verdict)
    console.print(
        f"\n{record.adapter}: {len(record.outcomes)} clauses of kit {KIT_VERSION} in {host_s:.0f} s: {counts}"
    )
    in_process = record.subject is not None and record.subject.in_process
    missing: dict[str, list[Outcome]] = {}
    for each in record.outcomes:
        if each.verdict is Verdict.NOT_TESTED:
            missing.setdefault(each.reason, []).append(each)
    as_far = record.overall is Overall.AS_FAR
    for reason, outcomes in sorted(missing.items()):
        needed = record.overall is Overall.FAILS and overall(outcomes, in_process=in_process) is Overall.FAILS
        what = "not tested, and may not be left out" if needed else "not tested"
        console.print(f"  {what}: {reason} ({len(outcomes)} clause{'s' * (len(outcomes) > 1)})", soft_wrap=True)
        for each in outcomes if as_far and not reason.startswith(NOT_DECLARED) else ():
            console.print(f"    not shown: {each.clause.contract} ({each.clause.id})", soft_wrap=True)
    if load >= _BUSY and not in_process:
        console.print(
            f"  the host was busy, with {load:.1f} programs a core, as something was late: that may have been its "
            "doing, not the adapter's; try again with --jobs 1, and nothing beside it",
            soft_wrap=True,
        )
    console.print(Text(record.overall.value, "bold red" if record.overall is Overall.FAILS else "bold green"))


def _print_promises(console: Console, record: Record) -> None:
    found = measured_of(record)
    if not found:
        return
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("promise", "promised", "worst measured", "share", "by clause"):
        table.add_column(name, justify="left" if name in {"promise", "by clause"} else "right", no_wrap=True)
    for each in found:
        if each.measured is None or each.share is None:
            table.add_row(each.name, f"{each.promised:.3g}", "-", "-", "")
            continue
        share = Text(f"{each.share:.0%}", "bold red" if each.share > 1.0 else "")
        table.add_row(each.name, f"{each.promised:.3g}", f"{each.measured:.3g}", share, each.clause)
    console.print()
    console.print(table)
