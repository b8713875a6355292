"""One recording of a real run, for all that looks at recordings."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest

from soter.record.reader import Recording
from soter.runner import Run
from tests.record.helpers import recorded


class Recorded(NamedTuple):
    """A run and its recording."""

    run: Run
    path: Path

    @property
    def recording(self) -> Recording:
        return Recording(self.path)


FAULTS = [{"kind": "loss", "robot": 2, "commands": 0.3, "start_s": 60.0}]


@pytest.fixture(scope="session")
def kinematic(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Five minutes on the kinematic engine, with disengagements, targets of every outcome and a fault."""
    path = tmp_path_factory.mktemp("recordings") / "kinematic.mcap"
    return Recorded(recorded(path, duration_s=300.0, seed=4, targets="hostile", fault=FAULTS), path)


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The first hundred seconds of such a run, for what is changed in copies."""
    path = tmp_path_factory.mktemp("recordings") / "short.mcap"
    return Recorded(recorded(path, duration_s=100.0, seed=4, targets="hostile", fault=FAULTS), path)
