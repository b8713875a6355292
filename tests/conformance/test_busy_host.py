"""A host that stands still for once is no fault of an adapter; one that does so again and again may be its doing."""

from __future__ import annotations

import math
from typing import Any

import pytest

from soter.conformance import CLAUSES, Verdict, try_clause
from soter.sdk import RobotState
from tests.broken.edits import wired
from tests.broken.parts import memory
from tests.conformance.wire import WireHarness, WireRobot

STALL_S = 0.15


def stalling(every_s: float) -> type[WireRobot]:
    """Return an adapter of which nothing is heard for a moment, first after 5 s, and then every so often."""

    def sample(self: Any) -> RobotState | None:
        kept, since_s = memory(self, "kept", lambda: [None]), self.clock.now() - 5.0
        if since_s < 0.0 or since_s % every_s >= STALL_S:
            kept[0] = WireRobot._sample(self)
        return kept[0]  # type: ignore[no-any-return]

    return wired("Stalls", "Is not heard for a moment.", "state.age", "too seldom", _sample=sample)


@pytest.mark.parametrize(("every_s", "verdict"), [(math.inf, Verdict.PASS), (3.0, Verdict.FAIL)])
def test_samples_are_old_by_the_robot_s_doing_if_they_are_so_again(every_s: float, verdict: Verdict) -> None:
    outcome, _ = try_clause(CLAUSES["state.age"], WireHarness(stalling(every_s)))
    assert outcome.verdict is verdict, outcome.reason
