"""What the kit says of a place that is off: by which mix-up, if one explains it."""

from __future__ import annotations

import re
from typing import Any

import pytest

from soter.conformance import CLAUSES, Verdict, try_clause
from tests.broken.in_process import Broken
from tests.conformance.simulated import SimulatedHarness


@pytest.mark.parametrize(
    ("mixed", "says"),
    [
        (lambda s: {"y_m": -s.y_m}, "y has the wrong sign"),
        (lambda s: {"x_m": -s.x_m}, "x has the wrong sign"),
        (lambda s: {"x_m": -s.x_m, "y_m": -s.y_m}, "x and y have the wrong signs"),
        (lambda s: {"x_m": s.y_m, "y_m": s.x_m}, "x and y are swapped"),
        (lambda s: {"x_m": 1000.0 * s.x_m, "y_m": 1000.0 * s.y_m}, "it is in millimetres"),
        (lambda s: {"x_m": 100.0 * s.x_m, "y_m": 100.0 * s.y_m}, "it is in centimetres"),
        (lambda s: {"x_m": s.x_m + 3.0}, "another frame, unit or origin"),
    ],
)
def test_a_place_that_is_off_is_told_by_its_mix_up(mixed: Any, says: str) -> None:
    kind = type("Mixed", (Broken,), {"_sample": lambda self: (s := self._honest())._replace(**mixed(s))})
    outcome, _ = try_clause(CLAUSES["state.start"], SimulatedHarness(kind))
    assert outcome.verdict is Verdict.FAIL
    assert re.search(says, outcome.reason), outcome.reason
