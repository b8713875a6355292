"""One real run on the kinematic engine, for all that looks at results."""

from __future__ import annotations

import pytest

from soter.config import load_mission
from soter.runner import Run, RunResult, run_mission
from tests.project.source import ROOT

MISSION = ROOT / "examples" / "surveillance.toml"


@pytest.fixture(scope="session")
def kinematic_run() -> Run:
    """A minute of the surveillance mission."""
    overrides = {"backend": "kinematic", "duration_s": 60.0, "planner": "straight-line"}
    return run_mission(load_mission(MISSION, overrides))


@pytest.fixture(scope="session")
def result(kinematic_run: Run) -> RunResult:
    """Its result."""
    return kinematic_run.result
