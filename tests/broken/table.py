"""The tables of docs/conformance.md: hooks, clauses, what measures each promise, and the broken adapters."""

from __future__ import annotations

import inspect
from functools import cache
from types import ModuleType
from typing import Final

from soter.conformance import CLAUSES, HOOKS, Harness, Outcome, try_clause
from soter.conformance.harness import EXTRA_HOOKS
from soter.conformance.promises import MEASURED_BY
from tests.broken import goals, in_process, lives, on_wire, samples
from tests.broken.afterwards import AFTERWARDS, AFTERWARDS_ON_WIRE
from tests.broken.corners import CORNERS, CORNERS_ON_WIRE
from tests.broken.crowd import CROWD, CROWD_ON_WIRE
from tests.broken.drivers import DRIVERS, DRIVERS_ON_WIRE
from tests.broken.duties import DUTIES
from tests.broken.field import FIELD, FIELD_ON_WIRE
from tests.broken.goals import TARGETS
from tests.broken.habits import HABITS, HABITS_ON_WIRE
from tests.broken.host import HOST, HOST_ON_WIRE
from tests.broken.meeting import MEETING, MEETING_ON_WIRE
from tests.broken.outages import OUTAGES, OUTAGES_ON_WIRE
from tests.broken.outsiders import OUTSIDERS, OUTSIDERS_ON_WIRE
from tests.broken.passing import PASSING
from tests.broken.promised import PROMISES
from tests.broken.samples import SAMPLES
from tests.broken.sealed import SEALED, SEALED_ON_WIRE
from tests.broken.seldom import SELDOM, SELDOM_ON_WIRE
from tests.broken.strangers import STRANGERS, STRANGERS_ON_WIRE
from tests.broken.survivors import SURVIVORS
from tests.broken.unasked import UNASKED, UNASKED_ON_WIRE
from tests.broken.ways import WAYS, WAYS_ON_WIRE
from tests.broken.wire_mutants import WIRE_MUTANTS
from tests.conformance.simulated import SimulatedHarness
from tests.conformance.wire import WireHarness
from tests.project.source import ROOT

PAGE: Final = ROOT / "docs" / "conformance.md"

Kind = type[in_process.Broken] | type[on_wire.BrokenWire]


def _written(base: Kind, *modules: ModuleType) -> tuple[Kind, ...]:
    """Return the broken adapters that have a class of their own in these modules, in the order of those."""
    return tuple(each for module in modules for each in base.__subclasses__() if each.__module__ == module.__name__)


BROKEN: Final[tuple[Kind, ...]] = (
    *_written(in_process.Broken, samples, goals, lives), *SAMPLES, *TARGETS, *PROMISES, *DUTIES, *SELDOM, *CORNERS,
    *DRIVERS, *HABITS, *WAYS, *CROWD, *PASSING, *AFTERWARDS, *STRANGERS, *MEETING, *FIELD,
    *UNASKED, *OUTAGES, *HOST, *OUTSIDERS, *SEALED,
    *_written(on_wire.BrokenWire, on_wire), *WIRE_MUTANTS, *SELDOM_ON_WIRE, *CORNERS_ON_WIRE, *DRIVERS_ON_WIRE,
    *HABITS_ON_WIRE, *WAYS_ON_WIRE, *CROWD_ON_WIRE, *AFTERWARDS_ON_WIRE, *STRANGERS_ON_WIRE,
    *MEETING_ON_WIRE, *FIELD_ON_WIRE, *UNASKED_ON_WIRE, *OUTAGES_ON_WIRE,
    *OUTSIDERS_ON_WIRE, *HOST_ON_WIRE, *SEALED_ON_WIRE,
)  # fmt: skip


@cache
def outcome_of(kind: Kind, clause_id: str) -> Outcome:
    """Return what one clause says of a broken adapter."""
    harness = WireHarness(kind) if issubclass(kind, on_wire.BrokenWire) else SimulatedHarness(kind)
    return try_clause(CLAUSES[clause_id], harness)[0]


def clause_table() -> str:
    """Return the table of the clauses; those judged by state and by truth have one line."""
    lines = ["| clause | tier | contract |", "|---|---|---|"]
    for each in CLAUSES.values():
        if each.id.startswith("truth.") and each.id.removeprefix("truth.") in CLAUSES:
            continue
        tier = each.tier.value + (", truth" if f"truth.{each.id}" in CLAUSES else "")
        lines.append(f"| `{each.id}` | {tier} | {each.contract} |")
    return "\n".join(lines)


def hook_table() -> str:
    """Return the table of the hooks of a harness, with what each has to do."""
    lines = ["| hook | needed | what it does |", "|---|---|---|"]
    for name in (*HOOKS, *EXTRA_HOOKS):
        told = " ".join((inspect.getdoc(getattr(Harness, name)) or "").partition("\n\nArgs:")[0].split())
        lines.append(f"| `{name}`{' and `restore`' * (name == 'cut')} | {'yes' * (name in HOOKS)} | {told} |")
    return "\n".join(lines)


def promise_table() -> str:
    """Return the table of what measures each promise, and how sharply."""
    lines = ["| promise | measured by | how, and what fails |", "|---|---|---|"]
    for name, (clauses, how) in MEASURED_BY.items():
        lines.append(f"| `{name}` | {', '.join(f'`{each}`' for each in clauses)} | {how} |")
    return "\n".join(lines)


def broken_row(kind: Kind) -> str:
    """Return the line of one broken adapter."""
    where = "wire" if issubclass(kind, on_wire.BrokenWire) else "in process"
    return f"| {(kind.__doc__ or '').partition(chr(10))[0]} | {where} | `{kind.caught_by}` |"


def broken_table() -> str:
    """Return the table of the broken adapters."""
    return "\n".join([BROKEN_HEAD, *(broken_row(kind) for kind in BROKEN)])


BROKEN_HEAD: Final = "| what is wrong | where | caught by |\n|---|---|---|"


def survivor_table() -> str:
    """Return the table of what no clause finds out."""
    return "\n".join(["| what is wrong | why no trial shows it | what it can do |", "|---|---|---|", *(
        f"| {each.says} | {each.why} | {each.can} |" for each in SURVIVORS
    )])  # fmt: skip


TABLES: Final = {
    "hooks": hook_table, "clauses": clause_table, "promises": promise_table, "broken": broken_table,
    "survivors": survivor_table,
}  # fmt: skip


def page_with_tables() -> str:
    """Return the page with all tables as they should be."""
    text = PAGE.read_text(encoding="utf-8")
    for name, table in TABLES.items():
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        before, after = text.partition(begin)[0], text.partition(end)[2]
        text = f"{before}{begin}\n\n{table()}\n\n{end}{after}"
    return text
