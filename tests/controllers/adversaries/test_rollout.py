"""The model that the searching adversary rolls forward: where robots get to, and when modules stop them."""

from __future__ import annotations

import numpy as np
import pytest

from soter.config.tables import CollisionTable, GeofenceTable, RtaTable
from soter.controllers.adversaries.base import RobotFacts
from soter.controllers.adversaries.search import RULES, Rollout
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.stack.terrain import Terrain

CHARGER = Box(0.5, 0.5, 0.7, 0.7, 0.0)
ROOM = Workspace(4.0, 4.0, (Box(1.5, 0.0, 2.5, 0.5),), (RobotPlace(1, 0.6, 0.6, CHARGER),))
FACTS = RobotFacts(latency_s=0.0)
# Looks that are far enough apart to be told one from another.
RTA = RtaTable(
    collision=CollisionTable(delta_s=0.1), geofence=GeofenceTable(delta_s=0.5, phi_safer_inset_m=0.5)
)  # fmt: skip
ROLLOUT = Rollout(Terrain(ROOM, 0.1), RTA, FACTS, 0.05)


def least(start: list[list[float]], goals: list[list[float]], wait: int = 0, steps: int = 100) -> dict[str, float]:
    """The least margins of one candidate, in metres."""
    robots = len(start)
    parts = ROLLOUT.least(
        0, np.array(start), np.ones(robots, dtype=bool), np.array([goals]), np.full((1, robots), wait), steps
    )
    reach = [FACTS.reach_m(0.1, 2), FACTS.reach_m(0.05), FACTS.reach_m(0.5)]
    return {rule: float(part * metres) for rule, part, metres in zip(RULES, parts[0], reach, strict=True)}


def test_a_robot_that_runs_at_the_fence_is_stopped_between_one_delta_and_two_from_it() -> None:
    found = least([[1.0, 2.0, np.pi, 0.0]], [[-5.0, 2.0]])
    assert 0.22 * 0.5 - 0.012 <= found["geofence"] <= 0.22 * 1.0
    assert found["collision"] == np.inf


def test_a_robot_that_waits_longer_is_stopped_elsewhere() -> None:
    margins = {round(least([[1.0, 2.0, np.pi, 0.0]], [[-5.0, 2.0]], wait)["geofence"], 4) for wait in range(10)}
    assert len(margins) > 3


def test_two_robots_stop_before_they_meet() -> None:
    found = least([[1.0, 2.0, 0.0, 0.0], [3.0, 2.0, np.pi, 0.0]], [[3.0, 2.0], [1.0, 2.0]])
    assert 0.0 < found["collision"] < FACTS.reach_m(0.1, 2)


def test_a_robot_turns_before_it_drives() -> None:
    found = least([[2.0, 1.5, np.pi / 2, 0.0]], [[2.0, 0.0]], steps=40)
    straight = least([[2.0, 1.5, -np.pi / 2, 0.0]], [[2.0, 0.0]], steps=40)
    assert straight["obstacle"] < found["obstacle"] < 1.5 - 0.5 - 0.1


def test_robots_without_control_brake() -> None:
    parts = ROLLOUT.least(
        0, np.array([[1.0, 2.0, np.pi, 0.22]]), np.zeros(1, dtype=bool), np.array([[[-5.0, 2.0]]]),
        np.zeros((1, 1), dtype=np.int64), 60,
    )  # fmt: skip
    way_m = 1.0 - float(parts[0, RULES.index("geofence")]) * FACTS.reach_m(0.5)
    assert way_m == pytest.approx(0.22**2 / 2.0, abs=0.005)
