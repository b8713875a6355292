"""What hangs on the order of a set is alike in one process, and unlike in another."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.conformance import Verdict, judge
from soter.conformance.clause import CLAUSES
from soter.conformance.find import find_harness

TURNS_BY_CHANCE = """
from soter.adapters.pybullet.backend import KinematicBackend, KinematicRobot
from soter.conformance.find import InProcessHarness
from soter.sdk import Goal


class Turning(KinematicRobot):
    def _send_goto(self, goal: Goal) -> None:
        aside_m = {"left": 1e-6, "right": -1e-6}[[*{"left", "right"}][0]]
        target = goal.target._replace(y_m=goal.target.y_m + aside_m)
        super()._send_goto(Goal(self, goal.id, target, goal.by, goal.sent_s))


class Backend(KinematicBackend):
    robot_class = Turning


def harness() -> InProcessHarness:
    return InProcessHarness("turning", Backend)


HARNESS = harness()
"""


def test_a_robot_whose_side_hangs_on_the_order_of_a_set_is_not_deterministic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "turns_by_chance.py").write_text(TURNS_BY_CHANCE)
    monkeypatch.syspath_prepend(tmp_path)
    (outcome,) = judge(find_harness("turns_by_chance:HARNESS"), [CLAUSES["capabilities.deterministic"]]).outcomes
    assert outcome.verdict is Verdict.FAIL
    assert "the order of a set got in" in outcome.reason


def test_what_fails_in_a_process_of_its_own_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "only_here.py").write_text(
        TURNS_BY_CHANCE
        + "\nimport os\nif os.environ['PYTHONHASHSEED'] == '3':\n    raise OSError('only one at a time')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONHASHSEED", "0")
    (outcome,) = judge(find_harness("only_here:HARNESS"), [CLAUSES["capabilities.deterministic"]]).outcomes
    assert outcome.verdict is Verdict.FAIL
    assert "in a process of its own the same calls failed: OSError: only one at a time" in outcome.reason
