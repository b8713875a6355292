"""Hostile missions in worlds drawn at random: robots keep every rule. `tests.runner.random_worlds` runs hundreds."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.runner.random_worlds import outcome


@pytest.mark.parametrize(("seed", "duration_s"), [(2, 20.0), (3, 300.0)], ids=["polygons", "a noisy map"])
def test_every_rule_is_kept(seed: int, duration_s: float, tmp_path: Path) -> None:
    assert outcome(seed, tmp_path, duration_s) == "kept"
