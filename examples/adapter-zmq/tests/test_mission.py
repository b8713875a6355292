"""The adapter under SOTER itself: some clauses of the kit that a busy machine cannot spoil, and a mission."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.config import load_mission
from soter.conformance import CLAUSES as KIT
from soter.conformance import Verdict, find_harness, judge
from soter.runner import run_mission

EXAMPLES = Path(__file__).resolve().parents[2]
BACKEND = "soter_zmq.adapter:ZmqBackend"

CLAUSES = ("state.start", "truth.state.start", "goto.invalid", "goto.not_in_charge", "lifecycle.close_twice")


@pytest.mark.parametrize("clause", CLAUSES)
def test_a_clause_of_the_kit_passes(clause: str) -> None:
    record = judge(find_harness(BACKEND), [KIT[clause]])
    assert [(each.verdict, each.reason) for each in record.outcomes] == [(Verdict.PASS, "")]


def test_a_mission_runs_in_real_time_and_breaks_no_rule() -> None:
    mission = load_mission(
        EXAMPLES / "surveillance.toml", {"backend": BACKEND, "planner": "straight-line", "duration_s": 8.0}
    )
    result = run_mission(mission).result
    assert result.status == "completed"
    assert result.wall_s >= 7.9
    assert result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    assert result.min_margin is not None
    assert min(result.min_margin.values()) >= 0.0
    assert not result.failed_robots
