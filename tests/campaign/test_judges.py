"""The simulator's judge and the generator's, which share no geometry, agree whatever a mission promises."""

from __future__ import annotations

from random import Random

import pytest

from soter.campaign.random.judge import PromisedLimits, Ways, judge
from soter.campaign.random.room import DrawnRoom, Patch, Start
from soter.campaign.random.witness import EngineWitness
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk.values import RuleLimits
from soter_sim import BODY_RADIUS_M, World
from tests.sim.worlds import promising, scripted, specs

BOXES = ((2.0, 0.0, 3.0, 1.0), (2.0, 3.0, 3.0, 4.0), (1.0, 2.0, 1.9, 3.0))
POSES = ((1.0, 1.0, 0.0), (2.5, 2.0, 1.0), (4.0, 1.0, 2.0), (4.0, 4.5, 3.0))
STATION = (0.8, 0.8, 1.2, 1.2)
RULES = ("collision", "obstacle", "geofence")


@pytest.mark.parametrize("seed", range(8))
def test_both_judges_see_the_same_rules_broken_by_the_same_robots(seed: int) -> None:
    rng = Random(seed)
    limits = RuleLimits(rng.uniform(0.0, 1.0), rng.choice((0.0, rng.uniform(0.0, 0.3))))
    radius_m = {robot.id: rng.choice((BODY_RADIUS_M, rng.uniform(0.1, 0.3))) for robot in specs(*POSES)}
    workspace = Workspace(5.0, 5.0, tuple(Box(*box) for box in BOXES), (RobotPlace(1, 1.0, 1.0, Box(*STATION)),))
    robots = [promising(spec, radius_m[spec.id]) for spec in specs(*POSES)]
    with World(workspace, robots, limits=limits) as world:
        witness = world.engine = EngineWitness(world.engine)
        for robot_id in witness.ids:
            moves = [(rng.uniform(-0.22, 0.22), rng.uniform(-2.0, 2.0)) for _ in range(60)]
            world.set_control(robot_id, scripted(moves, 1.0))
        world.advance(60.0)
        seen = {(each.rule, each.robots) for each in world.truth.report().violations}
    starts = tuple(Start(robot_id, *pose) for robot_id, pose in enumerate(POSES, 1))
    room = DrawnRoom(
        Patch(0.0, 0.0, 5.0, 5.0).ring, starts, (Patch(*STATION),), tuple(Patch(*box).ring for box in BOXES)
    )
    promised = PromisedLimits(RULES, radius_m, limits.clearance_m, limits.separation_m, {}, {})
    found = judge(room, promised, Ways(witness.ids, *witness.seen(60.0)))
    assert {(each.rule, each.robots) for each in found} == seen
