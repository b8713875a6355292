"""The table of promises: the worst figure by truth, and no promise near to it without a reason."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from tools.promises import BEGIN, END, PAGE, rows_of, table


def record(name: str, promised: float, *figures: tuple[str, float, Sequence[float]]) -> dict[str, Any]:
    return {
        "adapter": "mine",
        "subject": {"in_process": False, "capabilities": {name: promised, "reverses": True, "accel_m_s2": None}},
        "clauses": [
            {"id": clause, "figures": [{"name": name, "value": value, "spread": [*spread], "resolution": 0.001}]}
            for clause, value, spread in figures
        ],
    }  # fmt: skip


def test_the_worst_figure_by_truth_is_shown_beside_the_promise() -> None:
    seen = record("sample_age_s", 0.07, ("state.age", 0.03, (0.0, 0.01, 0.06)), ("truth.age", 0.02, (0.0, 0.01, 0.025)))
    assert [(row.worst, row.clause) for row in rows_of(seen)] == [(0.02, "truth.age")]
    line = "| mine | `sample_age_s` | 0.07 | 0.02 ± 0.001 | 0, 0.01, 0.025 | 3.5 | `truth.age` |"
    assert table(rows_of(seen)).endswith(line)


def test_a_promise_near_to_what_was_measured_needs_a_reason() -> None:
    with pytest.raises(ValueError, match=r"sample_age_s is promised as 0\.07, and 0\.05 was measured by state\.age"):
        table(rows_of(record("sample_age_s", 0.07, ("state.age", 0.05, (0.0, 0.01, 0.06)))))
    # Of brakes the least counts.
    said = table(rows_of(record("brake_m_s2", 1.0, ("bounds.braking", 0.98, (0.9, 0.98, 1.2)))))
    assert "| 0.98 ± 0.001 | 0.9, 0.98, 1.2 | 0.98 [2] |" in said
    assert said.endswith("Near for a reason: [2] the robot's motors are set to it.")


def test_lines_of_other_adapters_stay_with_their_reasons() -> None:
    other = "| other | `v_max_m_s` | 0.22 | 0.22 |  | 1 [1] | `goto.v_max` |"
    said = table(rows_of(record("sample_age_s", 0.07, ("state.age", 0.01, ()))), [other])
    assert said.splitlines()[2] == other
    assert said.endswith("Near for a reason: [1] the robot clamps it.")


def test_the_page_has_its_place() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page.index(BEGIN) < page.index(END)
