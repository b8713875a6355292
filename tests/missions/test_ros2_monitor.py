"""Watching over robots that others drive, in virtual time: what is told, and that nothing is sent in the AC's name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from soter.adapters.pybullet import KinematicBackend, KinematicConfig
from soter.config import load_mission
from soter.missions.ros2_monitor import Watcher
from soter.sdk import Controller
from soter.specs import robot_specs

PROMISED = dict.fromkeys((1, 2), KinematicBackend.robot_class.declared)
MISSION = Path(__file__).parents[2] / "examples" / "ros2_external_ac" / "mission.toml"


class Told:
    """Notes everything."""

    def __init__(self) -> None:
        self.drivers: list[tuple[int, str]] = []
        self.margins: list[Mapping[str, float]] = []
        self.switches: list[tuple[int, str, str]] = []

    def tick(self, robot_id: int, driver: str, cause: str, margins: Mapping[str, float]) -> None:
        self.drivers.append((robot_id, driver))
        self.margins.append(margins)
        assert bool(cause) <= (driver != "AC")

    def switched(self, robot_id: int, before: str, after: str, module: str, cause: str) -> None:
        self.switches.append((robot_id, before, after))


def watch(told: Told, duration_s: float, **options: object) -> tuple[Watcher, list[tuple[float, float]]]:
    """Watch over robots that nobody drives; return the watcher and where they are at the end."""
    mission = load_mission(MISSION, {"rta.modules": ["collision", "geofence"], **options})
    workspace = mission.read_workspace()
    with KinematicBackend().open(
        KinematicConfig(workspace=workspace), robot_specs(mission, workspace, PROMISED)
    ) as fleet:
        for robot in fleet.robots:
            robot.init(1.0)
        watcher = Watcher(mission, workspace, fleet, told)
        watcher.run(lambda: False, duration_s)
        assert {robot.read_state().controller for robot in fleet.robots} == {Controller.AC}
        assert fleet.truth is not None
        return watcher, [fleet.truth.pose(robot.id)[:2] for robot in fleet.robots]


def test_robots_are_given_to_their_acs_and_not_spoken_for() -> None:
    told = Told()
    watcher, places = watch(told, 10.0)
    assert told.drivers[-2:] == [(1, "AC"), (2, "AC")]
    assert {(robot_id, after) for robot_id, _, after in told.switches} >= {(1, "AC"), (2, "AC")}
    assert set(told.margins[-1]) == {"collision", "geofence"}
    assert told.margins[-1]["geofence"] == 1.5
    assert watcher.disengagements == {1: 0, 2: 0}
    assert watcher.late_ticks == 0
    # What is put into the ports, so that nobody expects them to rest, moves nothing; their SCs had them for a moment.
    for place, start in zip(places, [(1.5, 2.5), (4.5, 2.5)], strict=True):
        assert math.dist(place, start) < 0.01


def test_without_modules_everybody_drives_from_the_start() -> None:
    told = Told()
    watch(told, 1.0, **{"rta.enabled": False})
    assert set(told.drivers) == {(1, "AC"), (2, "AC")}
    assert told.switches == []


def test_it_stops_when_it_is_told_to() -> None:
    mission = load_mission(MISSION, {})
    workspace = mission.read_workspace()
    with KinematicBackend().open(
        KinematicConfig(workspace=workspace), robot_specs(mission, workspace, PROMISED)
    ) as fleet:
        for robot in fleet.robots:
            robot.init(1.0)
        looks = iter([False, False, True])
        told = Told()
        Watcher(mission, workspace, fleet, told).run(lambda: next(looks))
    assert len(told.drivers) == 4
