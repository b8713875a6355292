"""The tables of docs/conformance.md: every clause, and every broken adapter with the clauses that fail it."""

from __future__ import annotations

from functools import cache
from typing import Final

from soter.conformance import CLAUSES, Verdict, judge, select
from tests.broken import in_process, on_wire
from tests.conformance.wire import SimulatedHarness, WireHarness
from tests.project.source import ROOT

PAGE: Final = ROOT / "docs" / "conformance.md"

IN_PROCESS: Final = tuple(in_process.Broken.__subclasses__())
ON_WIRE: Final = tuple(on_wire.BrokenWire.__subclasses__())
BROKEN: Final[tuple[type[in_process.Broken] | type[on_wire.BrokenWire], ...]] = (*IN_PROCESS, *ON_WIRE)


@cache
def failed_by(kind: type[in_process.Broken] | type[on_wire.BrokenWire]) -> dict[str, str]:
    """Return the clauses that fail a broken adapter, and why."""
    harness = WireHarness(kind) if issubclass(kind, on_wire.BrokenWire) else SimulatedHarness(kind)
    record = judge(harness, select())
    return {each.clause.id: each.reason for each in record.outcomes if each.verdict is Verdict.FAIL}


def clause_table() -> str:
    """Return the table of the clauses; those judged by state and by truth have one line."""
    lines = ["| clause | tier | contract |", "|---|---|---|"]
    for each in CLAUSES.values():
        if each.id.startswith("truth.") and each.id.removeprefix("truth.") in CLAUSES:
            continue
        tier = each.tier.value + (", truth" if f"truth.{each.id}" in CLAUSES else "")
        lines.append(f"| `{each.id}` | {tier} | {each.contract} |")
    return "\n".join(lines)


def broken_row(kind: type[in_process.Broken] | type[on_wire.BrokenWire]) -> str:
    """Return the line of one broken adapter."""
    others = sorted({each.removeprefix("truth.") for each in failed_by(kind)} - {kind.caught_by.removeprefix("truth.")})
    shown = ", ".join(f"`{each}`" for each in others[:3])
    more = f" and {len(others) - 3} more" if len(others) > 3 else ""
    summary = (kind.__doc__ or "").partition("\n")[0]
    return f"| {summary} | `{kind.caught_by}` | {shown}{more} |"


def broken_table() -> str:
    """Return the table of the broken adapters."""
    return "\n".join([BROKEN_HEAD, *(broken_row(kind) for kind in BROKEN)])


BROKEN_HEAD: Final = "| what is wrong | caught by | others that fail it |\n|---|---|---|"


def page_with_tables() -> str:
    """Return the page with both tables as they should be."""
    text = PAGE.read_text(encoding="utf-8")
    for name, table in (("clauses", clause_table()), ("broken", broken_table())):
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        before, after = text.partition(begin)[0], text.partition(end)[2]
        text = f"{before}{begin}\n\n{table}\n\n{end}{after}"
    return text
