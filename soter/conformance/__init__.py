"""The conformance kit: judges whether an adapter can be relied on. See docs/conformance.md.

`Harness` is what an adapter's author writes (`RelayedHarness` for robots in another process, with an `ImpairedRelay`
between them and the adapter); `judge` tries every clause on it and returns the record, and `Workshop` does so in
processes of their own, which a crash ends in place of the caller's;
`soter.conformance.testing.AdapterSuite` makes tests of them.
"""

from soter.conformance.clause import CLAUSES, Clause, Tier
from soter.conformance.find import find_harness
from soter.conformance.harness import HOOKS, Harness
from soter.conformance.impaired import ImpairedRelay, Line
from soter.conformance.kit import judge, select, try_clause
from soter.conformance.record import KIT_VERSION, Outcome, Overall, Record, Verdict
from soter.conformance.relayed import WIDE_ROOMS, RelayedHarness, in_wide_rooms
from soter.conformance.workshop import Workshop

__all__ = [
    "CLAUSES",
    "HOOKS",
    "KIT_VERSION",
    "WIDE_ROOMS",
    "Clause",
    "Harness",
    "ImpairedRelay",
    "Line",
    "Outcome",
    "Overall",
    "Record",
    "RelayedHarness",
    "Tier",
    "Verdict",
    "Workshop",
    "find_harness",
    "in_wide_rooms",
    "judge",
    "select",
    "try_clause",
]
