"""Contact: faults that show only when two robots are driven into each other."""

from __future__ import annotations

import math

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.clauses.legs import along_and_across
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.track import TrackSample
from soter.sdk import Controller, Robot, Truth, Waypoint

_ROOM_M = 0.1
_SLOW = 0.2
_TOUCH_M = 0.003
_UNTOLD_M = 0.02
_SETS_OUT_M = 0.15
_BEYOND_M = 0.6
_PUSHES_S = 2.0
_HELD_UP_S = 6.0
"""Longer than what protects motors waits until it switches them off."""


@clause("truth.bounds.body", tier=Tier.TRUTH)
def body(bench: Bench) -> None:
    """Two robots set out for one place, pass straight on, touch no earlier than promised, and know where they push."""
    if not bench.harness.contacts:
        raise NotTested("not declared: the harness's attribute 'contacts': real robots are not driven into each other")
    first, second = bench.open(2)
    truth, radius_m = bench.fleet.truth, bench.caps.body_radius_m
    if truth is None:
        raise NotTested("not declared: Fleet.truth, which counts contacts")

    def apart_m() -> float:
        return math.dist(bench.true_pose(first.id)[:2], bench.true_pose(second.id)[:2])

    near_m = 2.0 * radius_m + _ROOM_M + bench.caps.v_max_m_s**2 / bench.caps.brake_m_s2
    began = {robot: bench.look(robot) for robot in (first, second)}
    middle = Waypoint((first.spec.x_m + second.spec.x_m) / 2.0, (first.spec.y_m + second.spec.y_m) / 2.0)
    goals = [robot.goto(middle, Controller.AC) for robot in began]

    def gone_m() -> list[float]:
        return [math.dist(at[1:3], bench.true_pose(robot.id)[:2]) for robot, at in began.items()]

    bench.run(bench.way_s(), lambda: min(gone_m()) > _SETS_OUT_M)
    least_m, slower = min(zip(gone_m(), [robot.id for robot in began], strict=True))
    bench.require(
        least_m > _SETS_OUT_M,
        f"of two robots that are sent to one place, ({middle.x_m:.2f}, {middle.y_m:.2f}), robot {slower} has gone "
        f"{least_m:.2f} m: places are kept for one robot at a time, or goals are known by their places",
    )
    for each in goals:
        each.cancel()
    bench.run(bench.orphaned_s())
    _see_it_pass(bench, first, bench.look(second), 2.0 * radius_m + _ROOM_M)
    came_from = bench.look(first)
    there = Waypoint(*bench.true_pose(second.id)[:2], timeout_s=bench.way_s())
    first.goto(there, Controller.AC)
    bench.run(there.timeout_s, lambda: apart_m() < near_m or truth.report().contacts > 0)
    _judged_by_limits(bench, truth, apart_m())
    slowly = there._replace(speed_m_s=_SLOW * bench.caps.v_max_m_s, timeout_s=2.0 * bench.way_s())
    goal = first.goto(slowly, Controller.AC)
    bench.run(2.0 * bench.way_s(), lambda: truth.report().contacts > 0 or apart_m() < radius_m or not goal.active)
    touched_m = apart_m() if truth.report().contacts else 0.0
    bench.require(
        touched_m > 0.0 or apart_m() <= max(radius_m, there.radius_m + bench.off_m),
        f"it was sent to where another robot stands, and stops {apart_m():.2f} m away: a field of the vehicle's own "
        "holds it, and where two robots meet neither goes on, for the safe controller neither; switch it off",
    )
    if touched_m:
        bench.run(_PUSHES_S)
    goal.cancel()
    at = {robot: bench.true_pose(robot.id)[:2] for robot in (first, second)}
    slack_m = _TOUCH_M + _SLOW * bench.caps.v_max_m_s * (TICK_S if not bench.caps.in_process else 0.0)
    bench.measure(
        "body_radius_m", touched_m / 2.0, radius_m, slack_m / 2.0,
        f"two robots touched with their centres {touched_m:.3f} m apart: body_radius_m is declared too small",
    )  # fmt: skip
    bench.settle()
    bench.measure(
        "after_contact_m", max(math.dist(place, bench.true_pose(robot.id)[:2]) for robot, place in at.items()),
        2.0 * _SLOW * bench.caps.v_max_m_s * bench.orphaned_s(), bench.still_m,
        "after they touched, a robot that has no goal any more moves: its bumper makes it back off, and heeds no lease",
    )  # fmt: skip
    bench.measure(
        "after_pushing_m",
        max(math.dist(bench.look(robot).state[3:5], bench.true_pose(robot.id)[:2]) for robot in at),
        bench.caps.position_noise_m, bench.off_m,
        "after it has pushed at what stands in its way its place is another one: it counts the way of wheels that spin",
    )  # fmt: skip
    if touched_m:
        goal = first.goto(slowly, Controller.AC)
        bench.run(_HELD_UP_S)
        goal.cancel()
        bench.settle()
        bench.go(
            first, Waypoint(came_from.x_m, came_from.y_m, radius_m=2.0 * bench.near_m, timeout_s=bench.way_s()),
            cause=f"it has pushed for {_HELD_UP_S:g} s at what stood in its way, and moves no more: what protects its "
            "motors has switched them off for good, and it says so to nobody",
        )  # fmt: skip


def _see_it_pass(bench: Bench, robot: Robot, other: TrackSample, aside_m: float) -> None:
    """Judge whether a robot drives straight past another one that stands beside its way."""
    start, began_s = bench.look(robot), bench.now_s
    far_m = start.distance_m(other.x_m, other.y_m)
    bearing_rad = math.atan2(other.y_m - start.y_m, other.x_m - start.x_m) + math.asin(min(aside_m / far_m, 0.5))
    way_m = far_m + _BEYOND_M
    target = Waypoint(
        start.x_m + way_m * math.cos(bearing_rad), start.y_m + way_m * math.sin(bearing_rad),
        timeout_s=bench.way_s() + way_m / bench.caps.v_max_m_s,
    )  # fmt: skip
    bench.arrive(robot.goto(target, Controller.AC), "it does not drive past another robot that stands beside its way")
    bench.measure(
        "passing_m", max(abs(across) for _, across in along_and_across(start, target, bench.since(robot, began_s))),
        bench.caps.tube_m, bench.off_m,
        "past another robot it does not drive straight: the vehicle has an avoidance of its own, which leads it where "
        "nobody has looked; switch it off",
    )  # fmt: skip


def _judged_by_limits(bench: Bench, truth: Truth, apart_m: float) -> None:
    """Fail the clause unless the truth counts a collision below the separation that it was told to judge by."""
    limits = bench.harness.limits
    if limits is None or apart_m > limits.separation_m - _UNTOLD_M:
        return
    bench.require(
        truth.report().count("collision") > 0,
        f"two robots are {apart_m:.2f} m apart, less than the {limits.separation_m:g} m that the truth was told to "
        "judge by, and it counts no collision: the option `limits` does not reach the world",
    )
