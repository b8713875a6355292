"""What is declared for a robot fits together: one module's safe controller does not call up another module."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from soter.config import load_mission
from soter.registry import load_backend
from soter.runner.speedup import declare_all
from soter.stack.terrain import Terrain

SURVEILLANCE = Path(__file__).parents[2] / "examples" / "surveillance.toml"
LATE_S = 1.1


@pytest.mark.parametrize("late_s", [0.0, LATE_S])
@pytest.mark.parametrize("start", [(4.0, 4.0), (0.5, 3.5), (4.0, 1.0)])
def test_ways_home_keep_clear_of_where_the_obstacle_module_steps_in(late_s: float, start: tuple[float, float]) -> None:
    """It drives first: a way along the boxes would be interrupted until the battery is flat."""
    modules = ["obstacle", "geofence", "battery"]
    mission = load_mission(
        SURVEILLANCE, {"backend": "kinematic", "rta.modules": modules, "rta.obstacle.phi_safer_m": 0.3}
    )
    workspace = mission.read_workspace()
    promised = load_backend("kinematic").robot_class.declared
    promised = replace(promised, latency_s=promised.latency_s + late_s)
    declared = declare_all(mission, workspace, {1: promised, 2: promised})
    terrain = Terrain(workspace, promised.body_radius_m)
    for robot in declared.values():
        robot.check(mission.base_tick_s)
        obstacle = robot.modules[0]
        assert obstacle.model is not None
        acts_m = obstacle.model.bound(obstacle.horizon_s(robot.timing))
        way = [start, *robot.dock.way(*start)]
        assert way[-1] == robot.dock.place
        for a, b in pairwise(way[1:]):
            assert terrain.segment_clearance_m(*a, *b) >= acts_m
