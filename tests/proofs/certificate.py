"""What a certified leg keeps of fence and boxes, about the numbers that `RecoveryPlanner.certify` itself computes.

What a leg that leads away is worth is in `lemmas`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, Final

import pytest
import z3

from soter.rta import Situation
from soter.stack import recovery, terrain
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.terrain import Terrain
from tests.proofs.lemmas import Lemma
from tests.proofs.robots import Obligation, Robot
from tests.proofs.symbolic import FAR_M, Fact, SymbolicMath, branches, positive
from tests.rta.doubles import At

SLANT: Final = math.sin(recovery._ALIGNED_RAD)
"""How much of its way a robot may get off a leg while its sample ages, and how much a leg that leads away rises."""


def _off(robot: Robot) -> tuple[Any, Any, list[Fact]]:
    """Return how far from its line a robot is, one way or the other, the most that this is, and what is known of it.

    It may have strayed, may be seen at a wrong place, and may have moved since its sample was taken.
    """
    off, most = z3.Real("off"), robot.tube + robot.noise + robot.v * robot.a * SLANT
    return off, most, [-most <= off, off <= most]


def certified_fence(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Wherever a robot is on a certified leg it is inside of the fence, or the leg leads away from that side."""
    robot = Robot()
    ax, ay, bx, by = z3.Reals("ax ay bx by")
    (width, depth, length), facts = positive("width depth length")
    off, most, strays = _off(robot)
    patch.setattr(symbolic, "hypot", lambda *_: length)
    ground: Any = SimpleNamespace(width_m=width, depth_m=depth)
    ground.fence_m = lambda x, y: Terrain.fence_m(ground, x, y)
    ground.leg_fence_m = lambda *leg: Terrain.leg_fence_m(ground, *leg)
    rules = RecoveryRules(boxes=False, pairs=False)
    look = Situation(1, At(ax, ay, -robot.a), 0)

    def worst() -> Any:
        return RecoveryPlanner(ground, robot.capabilities, rules, robot.tau).certify(look, bx, by)

    # The distance to a side is linear along a line: between the ends it is no less than at one of them.
    kept = z3.And(*(
        z3.Or(z3.And(start + off >= 0, end + off >= 0), z3.And(start < most, end - start >= SLANT * length))
        for start, end in ((ax, bx), (width - ax, width - bx), (ay, by), (depth - ay, depth - by))
    ))  # fmt: skip
    for branch in branches(worst, [*robot.facts, *facts], symbolic):
        yield Obligation("inside", kept, [*branch.facts, *strays, branch.value >= 0])


def certified_boxes(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Wherever a robot is on a certified leg its body is clear of a box, or the leg leads away from that box."""
    robot = Robot()
    dx, dy, past, there = z3.Reals("dx dy past there")
    (near, length), facts = positive("near length")
    off, most, strays = _off(robot)
    # The least distance of leg and box is taken for what it is called: no place on the leg is nearer.
    patch.setattr(terrain, "segment_to_box", lambda *_: past)
    patch.setattr(symbolic, "hypot", lambda *_: length)
    # One box, to the east: whoever looks may turn the frame.
    ground: Any = SimpleNamespace(body_radius_m=0, walls=lambda *_: [(near, 1, 0)], _edges=(None,))
    ground.clearance_m = lambda *_: near
    ground.leg_clearance_m = lambda *leg: Terrain.leg_clearance_m(ground, *leg)
    rules = RecoveryRules(fence=False, pairs=False)
    look = Situation(1, At(0, 0, -robot.a), 0)
    on_leg = [there >= past, there >= near - length, near < FAR_M / 2, past < FAR_M / 2]

    def worst() -> Any:
        return RecoveryPlanner(ground, robot.capabilities, rules, robot.tau).certify(look, dx, dy)

    for branch in branches(worst, [*robot.facts, *facts, *on_leg], symbolic):
        kept = z3.Or(there + off >= 0, z3.And(near < most, -dx >= SLANT * length))
        yield Obligation("clear of the box", kept, [*branch.facts, *strays, branch.value >= 0])


LEMMAS: Final[dict[str, Lemma]] = {each.__name__: each for each in (certified_fence, certified_boxes)}
