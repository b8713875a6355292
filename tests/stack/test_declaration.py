"""What is declared for a robot fits together: one module's safe controller does not call up another module."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from soter.check.admission import declare_all
from soter.config import load_mission
from soter.errors import IllFormedModule
from soter.registry import load_backend
from soter.stack.terrain import Terrain

SURVEILLANCE = Path(__file__).parents[2] / "examples" / "surveillance.toml"
LATE_S = 1.1


@pytest.mark.parametrize("late_s", [0.0, LATE_S])
@pytest.mark.parametrize("start", [(4.0, 4.0), (0.5, 3.5), (4.0, 1.0)])
def test_ways_home_keep_clear_of_where_the_obstacle_module_steps_in(late_s: float, start: tuple[float, float]) -> None:
    """It drives first: a way along the boxes would be interrupted until the battery is flat."""
    modules = ["obstacle", "geofence", "battery"]
    mission = load_mission(
        SURVEILLANCE, {"backend": "kinematic", "rta.modules": modules, "rta.obstacle.phi_safer_m": 0.3,
                       "rta.geofence.phi_safer_inset_m": 0.5}
    )  # fmt: skip
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
        way = [start, *robot.dock.path.legs(*start)]
        assert way[-1] == robot.dock.place
        for a, b in pairwise(way[1:]):
            assert terrain.segment_clearance_m(*a, *b) >= acts_m


def test_a_station_behind_a_wall_is_refused_before_anything_moves(tmp_path: Path) -> None:
    """No safe controller could bring the robot there, and it would run flat."""
    (tmp_path / "room.xml").write_text(
        """<configuration>
          <dimension x="5" y="4" z="1"/>
          <robots><robot id="1"><start x="1" y="1"/></robot></robots>
          <obstacles>
            <box><low x="0" y="1.9" z="0"/><high x="4.7" y="2.1" z="1"/></box>
            <box><low x="4.99" y="1.9" z="0"/><high x="5" y="2.1" z="1"/></box>
          </obstacles>
          <charging_stations><box><low x="0.8" y="2.8" z="0"/><high x="1.2" y="3.2" z="0"/></box></charging_stations>
        </configuration>"""
    )
    (tmp_path / "mission.toml").write_text('workspace = "room.xml"\nbackend = "kinematic"\n')
    promised = {1: load_backend("kinematic").robot_class.declared}
    mission = load_mission(tmp_path / "mission.toml")
    with pytest.raises(
        IllFormedModule, match=r"'battery' .*\(P2b\): there is no path .* at \(1, 1\).* gaps of 0\.330 m"
    ):
        declare_all(mission, mission.read_workspace(), promised)[1].check(mission.base_tick_s)
    others = load_mission(tmp_path / "mission.toml", {"rta.modules": ["obstacle", "geofence"]})
    declare_all(others, others.read_workspace(), promised)[1].check(others.base_tick_s)
