"""Safe controllers of a user's modules get away from where their rule takes the robot, whatever its heading is."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.config import load_mission
from soter.runner import run_mission
from tests.project.source import ROOT

TUTORIAL = ROOT / "docs" / "tutorials" / "first-module.md"

BOLD = """
from soter import Controller, Waypoint


class Bold(Controller):
    _until_s = 0.0

    def step(self, own, now_s):
        if now_s >= self._until_s:
            self._until_s = now_s + 20.0
            x_m, y_m = self.random.uniform(-1.0, 6.0), self.random.uniform(-1.0, 6.0)
            self._to = (4.0, 2.5) if self.random.random() < 0.5 else (x_m, y_m)
        return Waypoint(*self._to)
"""

MISSION = f"""
workspace = "{ROOT / "examples" / "surveillance.xml"}"
backend = "kinematic"
ac = "bold.py:Bold"
duration_s = 400.0

[rta.module.fountain]
declare = "fountain.py:declare"
options = {{ x_m = 4.0, y_m = 2.5, apart_m = 0.3 }}
"""


def listing(name: str) -> str:
    """Return a file that the tutorial has the reader save."""
    return TUTORIAL.read_text().split(f'```python title="{name}"\n')[1].split("```")[0]


@pytest.mark.parametrize("seed", [1, 4])
def test_robots_that_head_for_a_fountain_are_not_left_beside_it(seed: int, tmp_path: Path) -> None:
    (tmp_path / "fountain.py").write_text(listing("fountain.py"))
    (tmp_path / "bold.py").write_text(BOLD)
    (tmp_path / "m.toml").write_text(MISSION)
    mission = load_mission(tmp_path / "m.toml", {"seed": seed})
    result = run_mission(mission, accept_unproved=True).result  # trials would take longer than the run
    assert not any((result.violations or {"unknown": 1}).values())
    assert result.disengagements["fountain"] > 10
    assert result.longest_without_ac_s < 30.0
