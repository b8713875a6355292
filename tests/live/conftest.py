"""The recording of a real run, to be told as if it went on."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.record.helpers import recorded


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute on the kinematic engine."""
    path = tmp_path_factory.mktemp("recordings") / "whole.mcap"
    recorded(path, duration_s=60.0)
    return path
