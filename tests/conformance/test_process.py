"""A driver that is killed, or hangs, for real: a process of its own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from soter.conformance import CLAUSES, Verdict, try_clause
from tests.conformance.pulse import PulseHarness
from tests.project.source import ROOT


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(ROOT), str(ROOT / "sim"))))


@pytest.mark.parametrize("clause", ["process.killed", "process.hung"])
@pytest.mark.parametrize(("lease_s", "verdict"), [(0.1, Verdict.PASS), (1e9, Verdict.FAIL)], ids=["lease", "for-ever"])
def test_a_robot_must_stop_without_its_driver(tmp_path: Path, clause: str, lease_s: float, verdict: Verdict) -> None:
    outcome, _ = try_clause(CLAUSES[clause], PulseHarness(tmp_path / "renewals", lease_s))
    assert outcome.verdict is verdict, outcome.reason
    assert verdict is Verdict.PASS or "still moves" in outcome.reason
