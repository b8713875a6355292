"""What collides in PyBullet, against shapely: areas, maps, boxes and robots of any size."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely  # type: ignore[import-untyped]

from soter.geometry.cells import pack
from soter.geometry.draft import Draft, Outline, Spot, site_of
from soter.geometry.grid import GridMap
from soter.geometry.workspace import Box, Workspace
from soter.sdk.values import RobotSpec
from soter_sim import World
from tests.geometry.drawn import drawn
from tests.sim.worlds import CASE, constant, empty, promising

if TYPE_CHECKING:
    from soter_sim.pybullet import PyBulletEngine

engines = pytest.importorskip("soter_sim.pybullet", exc_type=ImportError)
BODY, bullet = engines.BODY, engines.bullet

pytestmark = pytest.mark.pybullet

EXACT_M = 1e-9
PRESSED_M = 1e-6
# Two that meet: a step takes them 2 mm nearer to each other, and its forces are found step by step.
PUSHED_M = 5e-4
NEAR_M = 0.02
RADII_M = (0.05, 0.105, 0.35)


def a_map() -> Workspace:
    stream = np.random.default_rng(1)
    occupied = stream.random((40, 60)) < 0.05
    occupied[15:25, 25:35] = True
    occupied[:8, :8] = False
    grid = GridMap(60, 40, 0.1, -3.0, 1200.0, 0.5, pack(occupied))
    stations = [Spot("station 1", *grid.corner(4, 4))]
    edge = Outline("edge of the map", grid.ring(0, 0, 60, 40))
    return site_of(Draft("map", [edge], stations=stations, map=grid), phi_safer_m=0.1, spacing_m=0.5)


def spaced(workspace: Workspace) -> list[RobotSpec]:
    """Return robots of all sizes, far from everything."""
    low_x, low_y, _, _ = workspace.bounds
    places = [(low_x - 10.0 - 3.0 * each, low_y) for each in range(len(RADII_M))]
    return [
        promising(RobotSpec(each, x, y, 0.3), radius_m)
        for each, ((x, y), radius_m) in enumerate(zip(places, RADII_M, strict=True), 1)
    ]


def gap_m(engine: PyBulletEngine, robot: int, others: Sequence[int]) -> float:
    """Return the distance between a robot's body and the nearest of others, as PyBullet has it. Wheels touch none."""
    points = [
        point[8]
        for other in others
        for link in [BODY if other in engine._robots else -1]
        for point in bullet.getClosestPoints(robot, other, 2.0 * NEAR_M, BODY, link, physicsClientId=engine._client)
    ]
    return min(points, default=math.inf)


def put(engine: PyBulletEngine, robot: int, x_m: float, y_m: float) -> None:
    (_, _, z_m), turned = bullet.getBasePositionAndOrientation(robot, physicsClientId=engine._client)
    bullet.resetBasePositionAndOrientation(robot, (x_m, y_m, z_m), turned, physicsClientId=engine._client)


WORLDS = [*(pytest.param(seed, id=f"drawn {seed}") for seed in range(6)), "case", "map"]


@pytest.mark.parametrize("world", WORLDS)
def test_bodies_are_as_near_as_the_geometry_says(world: int | str) -> None:
    if isinstance(world, int):
        workspace: Workspace = site_of(drawn(world), phi_safer_m=0.1, spacing_m=0.5)
    else:
        workspace = CASE if world == "case" else a_map()
    kept_out = shapely.union_all([shapely.Polygon(ring) for ring in workspace.outlines()[1]])
    stream, tried = random.Random(1), 0
    engine = engines.PyBulletEngine(workspace, spaced(workspace))
    try:
        edges = shapely.get_parts(kept_out.boundary)
        for robot, radius_m in zip(engine._robots, RADII_M, strict=True):
            for _ in range(150):
                at = shapely.line_interpolate_point(stream.choice(edges), stream.random(), normalized=True)
                away_m, angle = radius_m + stream.uniform(0.0, NEAR_M), stream.uniform(-math.pi, math.pi)
                x_m, y_m = at.x + away_m * math.cos(angle), at.y + away_m * math.sin(angle)
                exact_m = kept_out.distance(shapely.Point(x_m, y_m)) - radius_m
                if 0.0 <= exact_m <= NEAR_M:
                    tried += 1
                    put(engine, robot, x_m, y_m)
                    assert gap_m(engine, robot, list(engine._boxes)) == pytest.approx(exact_m, abs=EXACT_M)
            put(engine, robot, workspace.bounds[0] - 20.0, workspace.bounds[1])
    finally:
        engine.close()
    assert tried > 30


def test_robots_of_any_size_are_as_far_apart_as_their_radii_say() -> None:
    stream, engine = random.Random(2), engines.PyBulletEngine(empty(), spaced(empty()))
    try:
        for one in range(len(RADII_M)):
            for other in range(one):
                for _ in range(100):
                    exact_m, angle = stream.uniform(0.0, NEAR_M), stream.uniform(-math.pi, math.pi)
                    apart_m = RADII_M[one] + RADII_M[other] + exact_m
                    put(engine, engine._robots[one], 5.0, 5.0)
                    put(engine, engine._robots[other], 5.0 + apart_m * math.cos(angle), 5.0 + apart_m * math.sin(angle))
                    found_m = gap_m(engine, engine._robots[one], [engine._robots[other]])
                    assert found_m == pytest.approx(exact_m, abs=EXACT_M)
                put(engine, engine._robots[other], -5.0 - 3.0 * other, 0.0)
    finally:
        engine.close()


@pytest.mark.parametrize("radius_m", RADII_M)
@pytest.mark.parametrize("heading_rad", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("height_m", [0.01, 1.0])
def test_a_robot_stops_at_a_wall_of_any_height_where_the_geometry_has_it(
    radius_m: float, heading_rad: float, height_m: float
) -> None:
    wall = Workspace(20.0, 20.0, (Box(5.5, 0.0, 6.0, 20.0, height_m),), ())
    with World(wall, [promising(RobotSpec(1, 5.0, 5.0, heading_rad), radius_m)], "pybullet") as world:
        world.set_control(1, constant(0.22))
        while world.truth.report().contacts == 0:
            assert world.now_s < 10.0
            assert world.bodies.x[0] <= 5.5 - radius_m + EXACT_M
            world.advance(world.now_s + 0.05)
        for _ in range(60):
            world.advance(world.now_s + 0.05)
            assert world.bodies.x[0] == pytest.approx(5.5 - radius_m, abs=PRESSED_M)


@pytest.mark.parametrize("other_m", RADII_M)
def test_robots_that_push_each_other_are_as_far_apart_as_their_radii_say(other_m: float) -> None:
    specs = [promising(RobotSpec(1, 5.0, 5.0, 0.0)), promising(RobotSpec(2, 6.0, 5.01, math.pi), other_m)]
    with World(empty(), specs, "pybullet") as world:
        for each in (1, 2):
            world.set_control(each, constant(0.22))
        while world.truth.report().contacts == 0:
            assert world.now_s < 10.0
            world.advance(world.now_s + 0.05)
        for _ in range(20):
            world.advance(world.now_s + 0.05)
            apart_m = math.dist(*zip(world.bodies.x, world.bodies.y, strict=True))
            assert apart_m == pytest.approx(0.105 + other_m, abs=PUSHED_M)
