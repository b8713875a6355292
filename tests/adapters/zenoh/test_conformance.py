"""What the adapter's safety rests on, by the kit's own clauses; `soter conform zenoh` tries all of them."""

from __future__ import annotations

import pytest

from soter.adapters.zenoh.harness import ZenohHarness
from soter.conformance import CLAUSES
from soter.conformance.kit import try_clause
from soter.conformance.record import Verdict


@pytest.mark.parametrize(
    "clause", ["truth.authority.flushes", "link.switch_is_not_lost", "link.reorder", "process.hung"]
)
def test_clause(clause: str) -> None:
    outcome, _ = try_clause(CLAUSES[clause], ZenohHarness())
    assert outcome.verdict is Verdict.PASS, outcome.reason
