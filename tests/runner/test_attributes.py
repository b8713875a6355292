"""What the interpreter needs to find the attributes of what a tick uses quickly; speed itself is for benchmarks."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

import pytest

from soter.adapters.pybullet.backend import KinematicRobot
from soter.config import load_mission
from soter.rta import DecisionModule, RobotSupervisor
from soter.rta.fleet import Supervisor
from soter.runner import run_mission
from soter.runner.progress import Follower
from soter.stack.recovery import RecoveryPlanner
from soter.stack.return_path import ReturnPath
from soter.stack.right_of_way import RightOfWay
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Terrain

EXAMPLES = Path(__file__).parents[2] / "examples"
USED = (
    DecisionModule, KinematicRobot, RecoveryPlanner, ReturnPath, RightOfWay, RobotSupervisor, SiteTerrain, Supervisor,
    Terrain,
)  # fmt: skip
MOST = 30
"""Objects of one class share the names of at most so many attributes."""


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="what makes attributes slow is another there")
def test_attributes_of_what_a_tick_uses_are_found_by_the_interpreters_shortcuts() -> None:
    chosen = {"backend": "kinematic", "planner": "straight-line", "duration_s": 5.0, "targets": "grid"}
    found: dict[str, list[str]] = {}

    def look() -> bool:
        for used in gc.get_objects():
            if type(used) in USED and type(used).__name__ not in found:
                found[type(used).__name__] = faults(used)
        return True

    for file in ("surveillance.toml", "worlds/patrol.toml"):
        run_mission(load_mission(EXAMPLES / file, chosen), follower=Follower(stop=look))
    assert found.keys() == {kind.__name__ for kind in USED}
    assert {name: why for name, why in found.items() if why} == {}


def faults(used: object) -> list[str]:
    """Return what makes an object's attributes slow to find."""
    slow = ["its class has __getattr__"] if hasattr(type(used), "__getattr__") else []
    if not type(used).__dictoffset__:
        return slow
    made = {id(each) for each in gc.get_referents(used) if type(each) is dict}
    names = vars(used)
    if id(names) in made:
        slow.append("its dict was asked for")
    if len(names) > MOST:
        slow.append(f"it has {len(names)} attributes, and no __slots__")
    return slow


def test_each_of_these_faults_is_seen() -> None:
    class Asked:
        def __getattr__(self, name: str) -> None:
            raise AttributeError(name)

    one, other = Asked(), Asked()
    one.place, other.place = 1, 1  # type: ignore[attr-defined]
    assert faults(one) == ["its class has __getattr__"]
    vars(other).update({f"name_{each}": each for each in range(MOST)})
    assert faults(other) == [
        "its class has __getattr__", "its dict was asked for", f"it has {MOST + 1} attributes, and no __slots__",
    ]  # fmt: skip
