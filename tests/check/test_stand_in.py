"""Trials are made with the mission's robots: as many of them, and with what they promise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from soter.adapters.pybullet import KinematicBackend
from soter.check.bench import TRIED_ROBOTS, ModuleBench
from soter.check.conditions import Certainty
from soter.check.mission import check_mission
from soter.config import MissionFile, load_mission
from soter.sdk import Capabilities
from tests.project.source import ROOT

SLOW_M_S, BRAKE_M_S2 = 0.1, 5.0
KINEMATIC = KinematicBackend.robot_class.declared


class SlowBackend(KinematicBackend):
    """Robots that are slower than simulated ones, and larger, and brake better."""

    @classmethod
    def promises(cls, config: Any) -> Capabilities:
        return replace(KINEMATIC, v_max_m_s=SLOW_M_S, body_radius_m=0.12, brake_m_s2=BRAKE_M_S2, accel_m_s2=None)


def mission(example: str = "surveillance", **changes: object) -> MissionFile:
    given = {"backend": "kinematic", "planner": "straight-line", **changes}
    return load_mission(ROOT / "examples" / f"{example}.toml", given)


def bench(loaded: MissionFile, name: str = "geofence", robots: int = 1) -> ModuleBench:
    return ModuleBench(loaded, loaded.read_workspace(), name, robots, patience_s=20.0)


def test_a_stand_in_is_built_for_what_it_stands_in_for() -> None:
    tried = bench(mission(backend=f"{__name__}:SlowBackend"))
    assert tried.module.model is not None
    assert tried.module.model.bound(1.0) == pytest.approx(SLOW_M_S + SLOW_M_S**2 / (2.0 * BRAKE_M_S2))
    trial = tried.run([0.5, 0.85, 0.25, 1.0, *[0.5, 1.0] * 4])
    assert trial.valid
    assert trial.surprises == 0
    ways_m = [abs(after.y_m - before.y_m) for before, after in zip(trial.rows, trial.rows[1:], strict=False)]
    assert 0.9 * SLOW_M_S < max(ways_m) / tried.base_tick_s <= SLOW_M_S + 1e-9


def test_declared_faults_are_part_of_what_is_tried_and_others_are_not() -> None:
    late = {"kind": "delay", "samples_s": 0.05}
    assert bench(mission(fault=[late])).timing.sample_age_s == pytest.approx(0.05)
    assert bench(mission(fault=[{**late, "declared": False}])).timing == bench(mission()).timing


@pytest.mark.parametrize(
    ("example", "module", "robots"),
    [("warehouse", "collision", TRIED_ROBOTS), ("surveillance", "collision", 2), ("modules/zone", "zone-speed", 2)],
)
def test_as_many_of_the_missions_robots_are_tried_as_there_are_up_to_a_number(
    example: str, module: str, robots: int
) -> None:
    report = check_mission(mission(example, **{"rta.modules": ["collision"]}), budget=2)
    texts = [each.text for each in report.findings if each.module == module and each.condition == "P2a"]
    assert [text.partition(",")[0] for text in texts] == [f"{robots} robots jointly"]


@pytest.mark.parametrize("example", ["ardurover", "arducopter"])
def test_pairs_that_keep_far_apart_are_tried_where_they_come_near_each_other(example: str) -> None:
    loaded = load_mission(ROOT / "examples" / example / "mission.toml", {"rta.modules": ["collision"]})
    found = [each for each in check_mission(loaded, budget=4).findings if each.condition.startswith("P2")]
    assert [(each.condition, each.verdict) for each in found] == [("P2a", Certainty.TESTED), ("P2b", Certainty.TESTED)]
