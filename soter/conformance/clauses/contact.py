"""Contact: what shows only where two robots are driven into each other."""

from __future__ import annotations

import math

from soter.conformance.bench import SETTLE_S, Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.sdk import Controller, Truth, Waypoint

_ROOM_M = 0.1
_SLOW = 0.2
_TOUCH_M = 0.003
_UNTOLD_M = 0.02


@clause("truth.bounds.body", tier=Tier.TRUTH)
def body(bench: Bench) -> None:
    """Two robots touch no earlier than body_radius_m of each allows."""
    if not bench.harness.contacts:
        raise NotTested("not declared: the harness's attribute 'contacts': real robots are not driven into each other")
    first, second = bench.open(2)
    truth, radius_m = bench.fleet.truth, bench.caps.body_radius_m
    if truth is None:
        raise NotTested("not declared: Fleet.truth, which counts contacts")

    def apart_m() -> float:
        return math.dist(bench.true_pose(first.id)[:2], bench.true_pose(second.id)[:2])

    near_m = 2.0 * radius_m + _ROOM_M + bench.caps.v_max_m_s**2 / bench.caps.brake_m_s2
    goals = [
        robot.goto(Waypoint(other.spec.x_m, other.spec.y_m), Controller.AC)
        for robot, other in ((first, second), (second, first))
    ]
    bench.run(10.0 * bench.way_s(), lambda: apart_m() < near_m or truth.report().contacts > 0)
    _judged_by_limits(bench, truth, apart_m())
    goals[1].cancel()
    state = bench.look(second).state
    slowly = Waypoint(state.x_m, state.y_m, speed_m_s=_SLOW * bench.caps.v_max_m_s, timeout_s=2.0 * bench.way_s())
    goal = first.goto(slowly, Controller.AC)
    bench.run(2.0 * bench.way_s(), lambda: truth.report().contacts > 0 or apart_m() < radius_m or not goal.active)
    touched_m = apart_m() if truth.report().contacts else 0.0
    goal.cancel()
    at = {robot: bench.true_pose(robot.id)[:2] for robot in (first, second)}
    slack_m = _TOUCH_M + _SLOW * bench.caps.v_max_m_s * (TICK_S if not bench.caps.in_process else 0.0)
    bench.measure(
        "body_radius_m", touched_m / 2.0, radius_m, slack_m / 2.0,
        f"two robots touched with their centres {touched_m:.3f} m apart: body_radius_m is declared too small",
    )  # fmt: skip
    bench.run(SETTLE_S)
    bench.measure(
        "after_contact_m", max(math.dist(place, bench.true_pose(robot.id)[:2]) for robot, place in at.items()),
        2.0 * _SLOW * bench.caps.v_max_m_s * bench.orphaned_s(), bench.still_m,
        "after they touched, a robot that has no goal any more moves: its bumper makes it back off, and heeds no lease",
    )  # fmt: skip


def _judged_by_limits(bench: Bench, truth: Truth, apart_m: float) -> None:
    """See that the truth counts a collision from the separation on that it was told to judge by."""
    limits = bench.harness.limits
    if limits is None or apart_m > limits.separation_m - _UNTOLD_M:
        return
    bench.require(
        truth.report().count("collision") > 0,
        f"two robots are {apart_m:.2f} m apart, less than the {limits.separation_m:g} m that the truth was told to "
        "judge by, and it counts no collision: the option `limits` does not reach the world",
    )
