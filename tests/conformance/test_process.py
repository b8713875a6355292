"""A driver that is killed, hangs, or ends by an error, for real: a process of its own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from soter.conformance import CLAUSES, Verdict, try_clause
from soter.conformance.clauses import process
from tests.conformance.pulse import PulseHarness
from tests.project.source import ROOT


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(ROOT), str(ROOT / "sim"))))


@pytest.mark.parametrize(
    ("clause", "lease_s", "opener", "says"),
    [
        ("process.killed", 1e9, "open_fleet", "still moves"),
        ("process.hung", 0.1, "open_fleet", ""),
        ("process.ends", 0.1, "open_fleet", ""),
        ("process.ends", 0.1, "open_stubborn", "that process is still there"),
    ],
)
def test_a_robot_must_stop_without_its_driver_and_that_must_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clause: str, lease_s: float, opener: str, says: str
) -> None:
    monkeypatch.setattr(process, "_ENDS_S", 0.5 if says else process._ENDS_S)
    outcome, _ = try_clause(CLAUSES[clause], PulseHarness(tmp_path / "renewals", lease_s, opener))
    assert outcome.verdict is (Verdict.FAIL if says else Verdict.PASS), outcome.reason
    assert says in outcome.reason
