"""Among many robots only the near ones are looked at: near enough for fast robots, and for those that are silent."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import pytest
from pydantic import BaseModel

from soter.clock import VirtualClock
from soter.config import load_mission
from soter.errors import IllFormedModule
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.rta import PEER_SILENT_S, PairBound, RTAModule, SpeedBound, Timing
from soter.sdk import Capabilities, Controller, RobotSpec
from soter.stack.assembly import SafetySide, assemble
from soter.stack.collision import Separation
from soter.stack.module_kit import ModuleKit
from tests.rta.doubles import module
from tests.sdk.fake import FakeRobot, capabilities
from tests.stack.loop import MISSION, TICK_S

SAFE_M, SAFER_M = 1.8, 3.1
FAST = capabilities(v_max_m_s=4.0, brake_m_s2=50.0, latency_s=0.02)
MANY = 8

REACH_M = 2.0 * SpeedBound(FAST.v_max_m_s, FAST.brake_m_s2).bound(2.0 * TICK_S + FAST.latency_s)
"""How far two robots get towards each other in what the collision module looks ahead."""


class FastRobot(FakeRobot):
    """As fast as a copter."""

    declared: ClassVar[Capabilities] = FAST

    def __init__(self, spec: RobotSpec, clock: VirtualClock) -> None:
        super().__init__(spec, clock)
        self.found = FAST


def fleet(places: list[float], **further: object) -> tuple[VirtualClock, list[FastRobot], SafetySide]:
    """Put fast robots at rest on a line, and supervise them."""
    clock = VirtualClock()
    robots = [FastRobot(RobotSpec(number, x, 5.0, 0.0), clock) for number, x in enumerate(places, start=1)]
    room = Workspace(
        200.0, 10.0, (),
        tuple(RobotPlace(each.id, each.spec.x_m, 5.0, Box(each.spec.x_m, 5.0, each.spec.x_m, 5.0)) for each in robots),
    )  # fmt: skip
    for robot in robots:
        robot.place(x_m=robot.spec.x_m, y_m=5.0)
        robot.init(1.0)
    overrides = {
        "backend": "kinematic", "rta.modules": ["collision"], "rta.collision.delta_s": TICK_S,
        "rta.collision.phi_safe_m": SAFE_M, "rta.collision.phi_safer_m": SAFER_M,
        **further,
    }  # fmt: skip
    return clock, robots, assemble(load_mission(MISSION, overrides), room, robots, lambda report: None)


@pytest.mark.parametrize("gap_m", [4.12, 4.6, 5.2])
def test_a_silent_robot_that_may_have_come_near_counts_among_many(gap_m: float) -> None:
    # Where cells are as wide as what is looked at, the two are not in cells side by side.
    first_m = 8.19
    clock, robots, safety = fleet([first_m, first_m + gap_m, *(50.0 + 20.0 * k for k in range(MANY - 2))])
    own, silent = safety.supervisor.robots[1], robots[1]
    for tick in range(round(2.0 / TICK_S)):
        now_s = clock.now()
        for robot in robots:
            robot.vehicle_in_charge = robot.in_charge
            if robot is not silent or now_s < 1.0:
                robot.place(x_m=robot.spec.x_m, y_m=5.0)
        safety.supervisor.tick(now_s)
        silent_s = max(0.0, now_s - (1.0 - TICK_S))
        nearest_m = gap_m - FAST.v_max_m_s * min(silent_s, PEER_SILENT_S)
        if now_s < 1.0:
            assert own.mode is Controller.AC or tick < 10, "they stand far enough apart"
        elif nearest_m - SAFE_M < REACH_M:
            assert own.mode is Controller.SC, f"it may be {nearest_m:.2f} m away, {silent_s:.2f} s after its last word"
        clock.sleep_until((tick + 1) * TICK_S)
    assert own.mode is Controller.SC


class LooksFar(BaseModel):
    """How far the rule below looks; not at all said is everybody."""

    far_m: float | None = None


def keeps_far(kit: ModuleKit, options: LooksFar) -> RTAModule:
    """Declare a module whose rule is about peers."""
    apart = Separation(0.5, kit.capabilities.v_max_m_s)
    made = RTAModule(
        kit.name, kit.ac, kit.go_to(lambda s: (0.0, 0.0)), TICK_S, apart, replace(apart, least_m=20.0),
        PairBound(kit.model, kit.model),
    )  # fmt: skip
    return made if options.far_m is None else replace(made, peers_within_m=options.far_m)


@pytest.mark.parametrize("far_m", [None, 5.0, 30.0, 90.0])
def test_a_users_module_among_many_sees_every_peer_that_matters_to_its_rule(far_m: float | None) -> None:
    options = {} if far_m is None else {"far_m": far_m}
    own = {"own": {"declare": f"{__name__}:keeps_far", "options": options}}
    places = [5.0 + 19.0 * k for k in range(MANY)]
    _, _, safety = fleet(places, **{"rta.module": own})
    safety.supervisor.tick(0.0)
    for robot_id, supervisor in safety.supervisor.robots.items():
        near = {
            other for other, x_m in enumerate(places, start=1)
            if other != robot_id and abs(x_m - places[robot_id - 1]) <= (far_m or 1e9)
        }  # fmt: skip
        assert near <= {peer.robot_id for peer in supervisor.situation.peers}
    if far_m == 5.0:
        assert not safety.supervisor.robots[1].situation.peers, "what is finite keeps the cost linear"


def test_a_distance_that_is_none_is_refused() -> None:
    with pytest.raises(IllFormedModule, match="peers_within_m is nan, allowed: 0 or more"):
        module(peers_within_m=math.nan).check(Timing(), TICK_S)
