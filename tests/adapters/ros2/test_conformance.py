"""What the adapter's safety rests on, by the kit's own clauses; `soter conform ros2` tries all of them.

What it shares with that of Zenoh is tried there, with less effort.
"""

from __future__ import annotations

import pytest

from soter.conformance import CLAUSES
from soter.conformance.kit import try_clause
from soter.conformance.record import Verdict

pytestmark = pytest.mark.rclpy


@pytest.mark.parametrize(
    "clause",
    ["truth.authority.flushes", "truth.deadman.goto", "process.killed", "process.hung"],
)
def test_clause(clause: str) -> None:
    from soter.adapters.ros2.harness import Ros2Harness

    outcome, _ = try_clause(CLAUSES[clause], Ros2Harness())
    assert outcome.verdict is Verdict.PASS, outcome.reason
