"""What is impossible on real autopilots is in docs/mavlink.md, and is of the kit. Needs no autopilot."""

from __future__ import annotations

import re

from soter.conformance import CLAUSES
from tests.autopilot.impossible import IMPOSSIBLE, ROWS
from tests.project.source import ROOT


def test_the_page_has_the_same_table() -> None:
    page = (ROOT / "docs" / "mavlink.md").read_text()
    _, _, rest = page.partition("| not tried | why | what that costs |\n|---|---|---|\n")
    rows = re.findall(r"^\| (.+) \| (.+) \| (.+) \|$", rest.partition("\n\n")[0], re.MULTILINE)
    assert rows == [(", ".join(f"`{each}`" for each in row.clauses), row.why, row.costs) for row in ROWS]


def test_each_is_a_clause_and_is_named_once() -> None:
    assert CLAUSES.keys() >= IMPOSSIBLE
    assert len(IMPOSSIBLE) == sum(len(row.clauses) for row in ROWS)
