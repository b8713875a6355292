"""The examples load, and their rooms have the space that their comments promise."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest

from soter.config import MissionFile, load_mission
from soter.geometry.workspace import Box, Workspace
from soter.geometry.workspace_xml import BODY_RADIUS_M, read_workspace

EXAMPLES = Path(__file__).parents[2] / "examples"


def gap_m(a: Box, b: Box) -> float:
    """The width of the passage between two boxes; 0 where they touch."""
    dx = max(a.low_x_m - b.high_x_m, b.low_x_m - a.high_x_m, 0.0)
    dy = max(a.low_y_m - b.high_y_m, b.low_y_m - a.high_y_m, 0.0)
    return math.hypot(dx, dy)


@pytest.fixture
def warehouse() -> Workspace:
    return read_workspace(EXAMPLES / "warehouse.xml")


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_missions_load_with_their_workspace(path: Path) -> None:
    mission = load_mission(path)
    workspace = mission.read_workspace()
    assert mission.duration_s == 600.0
    for place in workspace.robots:
        assert 0.0 < mission.initial_charge(place.id) <= 1.0
        # Everybody starts on a charger.
        assert place.charger.distance_m(place.x_m, place.y_m) < 0.0


def test_surveillance_spells_out_the_defaults_but_for_how_near_to_boxes_it_plans() -> None:
    mission = load_mission(EXAMPLES / "surveillance.toml")
    nearer = {"ompl-bitstar": {"clearance_m": mission.rta.obstacle.phi_safer_m}}
    plain = MissionFile(workspace=mission.workspace, seed=mission.seed, planners=nearer)
    assert mission.model_dump(exclude={"battery", "targets"}) == plain.model_dump(exclude={"battery", "targets"})
    assert mission.battery == plain.battery


def test_surveillance_is_the_case_of_the_design() -> None:
    workspace = read_workspace(EXAMPLES / "surveillance.xml")
    assert (workspace.width_m, workspace.depth_m) == (5.0, 5.0)
    assert workspace.boxes == (
        Box(2.0, 0.0, 3.0, 1.0),
        Box(2.0, 3.0, 3.0, 4.0),
        Box(1.0, 2.0, 1.9, 3.0),
    )
    assert [(place.id, place.x_m, place.y_m) for place in workspace.robots] == [(1, 1.0, 1.0), (2, 2.5, 2.0)]
    for place in workspace.robots:
        assert place.charger.centre == pytest.approx((place.x_m, place.y_m))
        assert place.charger.high_x_m - place.charger.low_x_m == pytest.approx(0.4)
        assert workspace.clearance_m(place.x_m, place.y_m, BODY_RADIUS_M) >= 0.15


def test_warehouse_has_six_robots_in_a_hall_of_ten_metres(warehouse: Workspace) -> None:
    assert (warehouse.width_m, warehouse.depth_m) == (10.0, 10.0)
    assert [place.id for place in warehouse.robots] == [1, 2, 3, 4, 5, 6]


def test_warehouse_passages_are_wide_enough(warehouse: Workspace) -> None:
    assert min(gap_m(a, b) for a, b in itertools.combinations(warehouse.boxes, 2)) >= 1.5
    for box in warehouse.boxes:
        # 1.5 m beside the strip of 0.5 m along the fence.
        assert min(box.low_x_m, box.low_y_m, 10.0 - box.high_x_m, 10.0 - box.high_y_m) >= 2.0


def test_warehouse_chargers_are_far_enough_apart(warehouse: Workspace) -> None:
    centres = [place.charger.centre for place in warehouse.robots]
    assert min(math.dist(a, b) for a, b in itertools.combinations(centres, 2)) >= 1.5 - 1e-9
    for place in warehouse.robots:
        assert 0.5 <= place.x_m <= 9.5
        assert 0.5 <= place.y_m <= 9.5
        assert warehouse.clearance_m(place.x_m, place.y_m, BODY_RADIUS_M) >= 1.5
