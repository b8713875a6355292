"""A dozen random configurations, short: both judges agree, nothing is violated. `make accept-random` runs thousands."""

from __future__ import annotations

from pathlib import Path

from tools.generator.campaign import verdict
from tools.generator.drawing import draw
from tools.generator.running import Outcome, run_here

SEEDS = range(1, 13)
SHORT_S = 30.0


def test_what_is_accepted_keeps_every_rule_by_both_judges(tmp_path: Path) -> None:
    outcomes: dict[int, Outcome] = {}
    for seed in SEEDS:
        outcomes[seed] = run_here(draw(seed).write(tmp_path / str(seed)), SHORT_S)
    assert {seed: each.failures for seed, each in outcomes.items() if each.failures} == {}
    assert verdict(outcomes) == []
