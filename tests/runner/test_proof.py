"""The proofs of P2 are compared with brute force: what is proved must be true of states that nobody looked at."""

from __future__ import annotations

import math
import random
from functools import cache
from pathlib import Path

import pytest

from soter.check import Cell, Cover, Verdict
from soter.config import Mission, load_mission
from soter.registry import load_backend
from soter.rta import Port, Topic
from soter.runner.check import check_mission
from soter.runner.proof import LEAST_SIDE_M, Setting, prove_retreat, prove_way_home
from soter.sdk import RobotSpec
from soter.stack.actuator import PortForwarder
from soter.stack.declaration import PeerBounds, declare
from soter.stack.recovery import RecoveryPlanner
from soter.stack.right_of_way import RightOfWay
from soter.stack.terrain import Terrain
from tests.rta.doubles import At
from tests.stack.ground import seen

EXAMPLES = Path(__file__).parents[2] / "examples"
# The numbers with which the check itself says that the obstacle module has no gap.
PROVABLE = {"rta.obstacle.delta_s": 0.2, "rta.obstacle.phi_safer_m": 0.13}


def mission(**overrides: object) -> Mission:
    return load_mission(EXAMPLES / "surveillance.toml", {"backend": "kinematic", **overrides})


@cache
def setting(*overrides: tuple[str, float]) -> Setting:
    made = mission(**dict(overrides))
    workspace = made.read_workspace()
    promised = load_backend("kinematic").robot_class.declared
    terrain = Terrain(workspace, promised.body_radius_m)
    waypoint: Topic[object] = Topic("waypoint")
    forwarder = PortForwarder(Port(1, lambda _: None), waypoint, made.base_tick_s)  # type: ignore[arg-type]
    declared = declare(
        made, workspace, terrain, 1, promised, PeerBounds.of([promised]), forwarder, waypoint, RightOfWay()
    )  # fmt: skip
    return Setting(terrain, declared, promised)


@cache
def proved(name: str, *overrides: tuple[str, float]) -> Cover:
    made = setting(*overrides)
    return prove_way_home(made) if name == "battery" else prove_retreat(made, name)


def somewhere(drawn: random.Random, cell: Cell) -> tuple[float, float]:
    """A place in a cell, in a corner as often as not: that is where a bound is wrong first."""
    sides = [drawn.choice((-1.0, 1.0, drawn.uniform(-1.0, 1.0))) for _ in range(2)]
    return cell.x_m + sides[0] * cell.half_m, cell.y_m + sides[1] * cell.half_m


def in_claim(made: Setting, name: str, x_m: float, y_m: float) -> bool:
    claim, terrain = made.claim(name), made.terrain
    return terrain.fence_m(x_m, y_m) >= claim.fence_m and terrain.clearance_m(x_m, y_m) >= claim.clearance_m


@pytest.mark.parametrize("name", ["obstacle", "geofence"])
def test_from_every_proved_state_the_finder_finds_a_way_that_is_certified(name: str) -> None:
    made, found, drawn = setting(), proved(name), random.Random(1)
    recovery: RecoveryPlanner = made.declared.recovery
    tried = 0
    for _ in range(1500):
        x_m, y_m = somewhere(drawn, drawn.choice(found.proved))
        if not in_claim(made, name, x_m, y_m):
            continue
        tried += 1
        situation = seen(At(x_m, y_m, heading_rad=drawn.uniform(-math.pi, math.pi)))
        way = made.declared.refuges.way(situation, 0.5)
        assert len(way) == 1, (x_m, y_m)
        assert recovery.certify(situation, *way[0]) >= 0.0, "its whole length at once"
        assert math.dist((x_m, y_m), way[0]) <= found.cost + 1e-9
        # From wherever in its tube the robot is later, the rest of the way is certified too.
        part, aside = drawn.random(), drawn.uniform(-1.0, 1.0) * made.tube_m
        dx, dy = way[0][0] - x_m, way[0][1] - y_m
        length = math.hypot(dx, dy) or 1.0
        later = seen(At(x_m + part * dx - aside * dy / length, y_m + part * dy + aside * dx / length))
        assert recovery.certify(later, *way[0]) >= -1e-9
    assert tried > 1000


def test_from_every_proved_state_the_way_home_is_certified_and_no_longer_than_said() -> None:
    made, found, drawn = setting(), proved("battery"), random.Random(2)
    tried = 0
    for _ in range(1500):
        x_m, y_m = somewhere(drawn, drawn.choice(found.proved))
        if not in_claim(made, "battery", x_m, y_m):
            continue
        tried += 1
        way = made.declared.dock.way(x_m, y_m)
        assert made.declared.dock.home_m(x_m, y_m) <= found.cost + 1e-9
        assert made.declared.recovery.certify(seen(At(x_m, y_m)), *way[0]) >= 0.0, (x_m, y_m, way)
    assert tried > 1000
    assert found.cost <= made.declared.dock.longest_m, "the longest way home is bounded by proof"


@pytest.mark.parametrize("name", ["obstacle", "geofence", "battery"])
def test_what_is_listed_and_what_is_proved_is_all_of_the_claim(name: str) -> None:
    made, found, drawn = setting(), proved(name), random.Random(3)
    cells = [*found.proved, *(cell for cell, _ in found.unknown)]
    for _ in range(150):
        x_m, y_m = drawn.uniform(0.0, 5.0), drawn.uniform(0.0, 5.0)
        if in_claim(made, name, x_m, y_m):
            assert any(abs(c.x_m - x_m) <= c.half_m + 1e-9 and abs(c.y_m - y_m) <= c.half_m + 1e-9 for c in cells)


def test_the_default_mission_has_a_gap_beside_boxes_and_the_remedy_closes_it() -> None:
    assert proved("geofence").complete
    found = proved("obstacle")
    assert not found.complete
    assert 0.97 < found.share < 0.99
    assert all(2.0 * cell.half_m <= LEAST_SIDE_M for cell, _ in found.unknown)
    made = setting()
    assert all(made.terrain.clearance_m(cell.x_m, cell.y_m) < 2.0 * made.tube_m + 0.01 for cell, _ in found.unknown)
    assert proved("obstacle", *PROVABLE.items()).complete


def test_the_margin_that_is_left_at_rest_is_the_second_delta() -> None:
    made = setting()
    assert made.claim("obstacle").clearance_m == pytest.approx(0.22 * 0.05)
    assert made.claim("geofence").fence_m == pytest.approx(0.22 * 0.5)
    # While the geofence drives, the obstacle module has not fired: that is more than two tubes.
    assert made.claim("geofence").clearance_m > 2.0 * made.tube_m


def test_in_the_simulated_world_robots_come_home_from_cells_that_are_not_proved() -> None:
    made, found, drawn = setting(), proved("battery"), random.Random(4)
    from soter.stack.assembly import assemble

    loaded = mission()
    workspace = loaded.read_workspace().with_robots(1)
    backend = load_backend("kinematic")
    for _ in range(6):
        cell = drawn.choice(found.unknown)[0]
        if not in_claim(made, "battery", cell.x_m, cell.y_m):
            continue
        spec = RobotSpec(1, cell.x_m, cell.y_m, drawn.uniform(-math.pi, math.pi), 0.085)
        with backend().open(backend.config_model(workspace=workspace), [spec]) as fleet:
            fleet.robots[0].init(1.0)
            safety = assemble(loaded, workspace, fleet.robots, lambda _: None)
            for tick in range(1200):
                safety.supervisor.tick(tick * 0.05)
                fleet.clock.sleep_until((tick + 1) * 0.05)
            assert fleet.truth is not None
            assert fleet.truth.report().violations == ()
            x_m, y_m, _ = fleet.truth.pose(1)
            assert math.dist((x_m, y_m), made.declared.dock.place) < 0.05 or safety.ports[1].engaged


def test_a_mission_is_checked_without_its_backend() -> None:
    loaded = load_mission(EXAMPLES / "surveillance.toml", {"backend": "kinematic", "robots": 1, **PROVABLE})
    report = check_mission(loaded, budget=10, seed=1)
    verdicts = {(each.module, each.condition): each.verdict for each in report.findings}
    assert not report.rejected
    assert verdicts["obstacle", "P2a"] is verdicts["obstacle", "P2b"] is Verdict.PROVED
    assert verdicts["geofence", "P2b"] is Verdict.PROVED
    assert verdicts["battery", "P2a"] is Verdict.PARTLY
    assert {name for name, _ in verdicts} == {"collision", "obstacle", "geofence", "battery"}
    assert len(verdicts) == 20, "every module and condition"
