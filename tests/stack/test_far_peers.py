"""Among many robots only the near ones are looked at: near enough for fast robots, and for those that are silent."""

from __future__ import annotations

from typing import ClassVar

import pytest

from soter.clock import VirtualClock
from soter.config import load_mission
from soter.rta import PEER_SILENT_S, Mode, SpeedBound
from soter.sdk import Capabilities, RobotSpec
from soter.stack.assembly import SafetySide, assemble
from soter.workspace import Box, RobotPlace, Workspace
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


def fleet(places: list[float]) -> tuple[VirtualClock, list[FastRobot], SafetySide]:
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
            robot.vehicle_in_charge = robot._in_charge
            if robot is not silent or now_s < 1.0:
                robot.place(x_m=robot.spec.x_m, y_m=5.0)
        safety.supervisor.tick(now_s)
        silent_s = max(0.0, now_s - (1.0 - TICK_S))
        nearest_m = gap_m - FAST.v_max_m_s * min(silent_s, PEER_SILENT_S)
        if now_s < 1.0:
            assert own.mode is Mode.AC or tick < 10, "they stand far enough apart"
        elif nearest_m - SAFE_M < REACH_M:
            assert own.mode is Mode.SC, f"it may be {nearest_m:.2f} m away, {silent_s:.2f} s after its last word"
        clock.sleep_until((tick + 1) * TICK_S)
    assert own.mode is Mode.SC
