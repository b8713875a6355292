"""Capabilities: what is promised is readable, sane and there; what is not promised is not there."""

from __future__ import annotations

import math
import time

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.repeated import STRAIGHT_BEHIND, digests
from soter.errors import Unsupported
from soter.sdk import Capabilities, Controller, GoalStatus, RobotState

_PAUSE_S = 1.2
_WAYS = (STRAIGHT_BEHIND, (0.5, 0.2), (-0.1, 0.4))
_U_TURNS = ((0.4, 0.4), (-0.4, -0.4)) * 4
"""For a target straight behind, a robot may turn to either side: each leg gives chance a choice."""


@clause("capabilities.sane")
def sane(bench: Bench) -> None:
    """`declared` is readable before connecting, free of contradictions, and no narrower than what is found."""
    (robot,) = bench.open_raw().robots
    declared = getattr(robot, "declared", None)
    bench.require(
        isinstance(declared, Capabilities),
        f"{type(robot).__name__}.declared is a {type(declared).__name__}, expected Capabilities",
    )
    assert isinstance(declared, Capabilities)
    bench.require(
        declared.body_radius_m > 0.0,
        f"declared.body_radius_m is {declared.body_radius_m:g}: every body takes room, so that it has to be above 0",
    )
    bench.require(
        declared.lease_s > TICK_S,
        f"lease_s is {declared.lease_s:g} s, but it is renewed only every {TICK_S:g} s: the robot would stop between",
    )
    robot.init(bench.harness.connect_timeout_s)
    wider = robot.capabilities.widened_beyond(declared)
    bench.require(wider is None, f"after init() {wider} is wider than declared: init() is overridden")


@clause("capabilities.optional")
def optional(bench: Bench) -> None:
    """What samples carry is what is declared: battery, and who is in charge; no more, no less."""
    state = bench.look(bench.open_one()).state
    for name, value in (("battery", state.battery), ("controller", state.controller)):
        declared = getattr(bench.caps, f"reports_{name}")
        bench.require(
            declared == (value is not None),
            f"reports_{name} is declared {declared}, but samples carry {name}={value}: correct the declaration or the "
            "sample; what is unknown is None, never a made-up value",
        )


@clause("capabilities.unsupported")
def unsupported(bench: Bench) -> None:
    """A goto that asks for what the robot lacks raises Unsupported, or is never REACHED."""
    robot = bench.open_one()
    target = bench.place(robot, 0.4)._replace(z_m=1.0, timeout_s=10.0)
    try:
        goal = robot.goto(target, Controller.AC)
    except Unsupported:
        bench.expect_still(robot, 1.0, "an unsupported goto must send nothing")
        return
    bench.run(12.0, lambda: not goal.active)
    state = bench.look(robot).state
    off_m = math.dist((state.x_m, state.y_m, state.z_m), (target.x_m, target.y_m, target.z_m))
    bench.require(
        goal.status is not GoalStatus.REACHED or off_m <= target.radius_m + bench.still_m,
        f"a goal 1 m above the ground is REACHED {off_m:.2f} m away from it: the altitude was dropped on the way; "
        "raise Unsupported in _send_goto()",
    )


@clause("capabilities.deterministic", needs=("deterministic",))
def deterministic(bench: Bench) -> None:
    """Where declared, the same calls on fresh fleets give the same samples, bit for bit, in any process and host."""
    runs: list[tuple[RobotState, ...]] = []
    for pauses in (False, True):
        robot = bench.open_one()
        for number, (ahead, left) in enumerate((*_WAYS, *_U_TURNS)):
            if number == 0:
                bench.get_going(robot, bench.place(robot, ahead, left))
                # Virtual time stands still meanwhile, whatever the host's does.
                time.sleep(_PAUSE_S if pauses and bench.caps.in_process else 0.0)
            bench.go(robot, bench.place(robot, ahead, left))
        runs.append(tuple(sample.state for sample in bench.tracks[robot.id]))
        bench.close()
    same = sum(first == second for first, second in zip(*runs, strict=False))
    bench.require(
        runs[0] == runs[1],
        f"two runs of the same calls agree in {same} of {len(runs[0])} samples only: host time, an unseeded random "
        "number or state left from the run before got in; or declare deterministic=False",
    )
    if bench.caps.in_process and bench.harness.found_as:
        unlike = len(set(digests(bench.harness.found_as))) - 1
        bench.require(
            not unlike,
            f"the same calls give the same samples again in this process, and others in {unlike} of some others: the "
            "order of a set got in, or the hash of a text, which each process of Python chooses anew; sort it",
        )
