"""The simulator's judge and the generator's, which share no geometry, agree whatever a mission promises."""

from __future__ import annotations

from random import Random

import pytest

from soter.sdk.values import RuleLimits
from soter.workspace import Box, RobotPlace, Workspace
from soter_sim import BODY_RADIUS_M, World
from tests.sim.worlds import scripted, specs
from tools.generator.judge import Limits, Ways, judge
from tools.generator.room import Patch, Room, Start
from tools.generator.witness import Witness

BOXES = ((2.0, 0.0, 3.0, 1.0), (2.0, 3.0, 3.0, 4.0), (1.0, 2.0, 1.9, 3.0))
POSES = ((1.0, 1.0, 0.0), (2.5, 2.0, 1.0), (4.0, 1.0, 2.0), (4.0, 4.5, 3.0))
STATION = (0.8, 0.8, 1.2, 1.2)
RULES = ("collision", "obstacle", "geofence")


@pytest.mark.parametrize("seed", range(8))
def test_both_judges_see_the_same_rules_broken_by_the_same_robots(seed: int) -> None:
    rng = Random(seed)
    limits = RuleLimits(
        rng.uniform(0.0, 1.0), rng.choice((0.0, rng.uniform(0.0, 0.3))), rng.choice((0.0, rng.uniform(0.1, 0.3)))
    )
    workspace = Workspace(5.0, 5.0, tuple(Box(*box) for box in BOXES), (RobotPlace(1, 1.0, 1.0, Box(*STATION)),))
    with World(workspace, specs(*POSES), limits=limits) as world:
        witness = world.engine = Witness(world.engine)
        for robot_id in witness.ids:
            moves = [(rng.uniform(-0.22, 0.22), rng.uniform(-2.0, 2.0)) for _ in range(60)]
            world.set_control(robot_id, scripted(moves, 1.0))
        world.advance(60.0)
        seen = {(each.rule, each.robots) for each in world.truth.report().violations}
    starts = tuple(Start(robot_id, *pose) for robot_id, pose in enumerate(POSES, 1))
    room = Room(5.0, 5.0, starts, (Patch(*STATION),), tuple(Patch(*box) for box in BOXES))
    radius_m = max(limits.body_radius_m, BODY_RADIUS_M)
    promised = Limits(RULES, radius_m, limits.clearance_m, limits.separation_m, {}, {})
    found = judge(room, promised, Ways(witness.ids, *witness.seen(60.0)))
    assert {(each.rule, each.robots) for each in found} == seen
