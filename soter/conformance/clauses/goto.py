"""Goto: sent at once, driven to the place itself, with the goal's own radius, speed and time-out."""

from __future__ import annotations

import math
import time
from functools import partial
from itertools import pairwise

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import TrackSample, quantile, turn
from soter.conformance.trials import Shuttle
from soter.errors import Unsupported
from soter.sdk import Controller, GoalStatus, Robot, Waypoint

_HOST_S = 0.05
_OFF_RAD = 0.15
_AS_IT_CAME_RAD = 0.5
_ASKEW_RAD = 1.0
_REST_S = 0.7
_IDLE_S, _IDLE_IN_PROCESS_S = 25.0, 100.0
"""In process, longer than most adapters take to sleep or give up; on a wire `deadman.stays` rests as long."""

_GAPS = 10
# Close to where angles counted from north or from east wrap, in whole degrees and in hundredths.
_SEAMS_RAD = tuple(side - off for off in (4e-3, 4e-5) for side in (math.pi / 2.0 + 2.0 * off, 0.0, math.pi))
_SEAM = "it is rounded to where angles begin anew, such as to 360 degrees, which the vehicle refuses"
_LASTS_S = 100.0
# Vehicles may go somewhat more slowly than they may.
_GIVEN_S = 140.0
_RADII = (8.0, 1.0)
_TIGHT = 0.4
_WAYS = ((0.6, 0.0), (0.0, 0.6), (-0.6, 0.0), (0.0, -0.6), (0.0, 0.0))
# Distances and directions, each from the place of the target before.
_FAR = ((40.0, 0.3), (40.0, -2.6), (150.0, 2.0), (700.0, -1.2), (3000.0, 2.8))


@clause("goto.returns_at_once")
def returns_at_once(bench: Bench) -> None:
    """goto() sends and returns: no fleet time passes, and next to no host time."""
    robot = bench.open_one()
    host_s, before_s = time.perf_counter(), bench.now_s
    for _ in range(10):
        robot.goto(bench.place(robot, 0.8), Controller.AC)
    took_s, passed_s = (time.perf_counter() - host_s) / 10, bench.now_s - before_s
    bench.require(
        passed_s <= (0.0 if bench.caps.in_process else 10 * _HOST_S) and took_s <= _HOST_S,
        f"goto() took {took_s:.3f} s of host time, and {passed_s / 10:.2f} s of fleet time: it waits for an answer or "
        "for arrival; send, and let read_state() find out",
    )


@clause("goto.arrives", truth=True)
def arrives(bench: Bench) -> None:
    """The robot arrives in each direction, and the goal is REACHED within its own radius."""
    robot = bench.open_one()
    for ahead, left in _WAYS[: bench.trials(len(_WAYS))]:
        target = bench.place(robot, ahead, left, radius_m=bench.near_m)
        bench.go(robot, target)
        off_m = bench.look(robot).distance_m(target.x_m, target.y_m)
        # The true pose may be a little further on than the judged sample.
        slack = bench.caps.position_noise_m + bench.caps.v_max_m_s * bench.caps.sample_age_s if bench.truth else 0.0
        bench.require(
            off_m <= target.radius_m + slack + 1e-9,
            f"the goal is REACHED at {off_m:.3f} m from its target, its radius is {target.radius_m:g} m: arrival must "
            "be judged from state with the goal's own radius, not by the vehicle's word",
        )


@clause("goto.far", truth=True)
def far(bench: Bench) -> None:
    """A target far away, on either side of the origin, is set out for: coordinates are not wrapped or cut off."""
    robot = bench.open_one()
    for far_m, bearing_rad in _FAR:
        _see_it_set_out(bench, robot, _at(bench.look(robot), far_m, bearing_rad))
    # Coordinates of exactly 0 are a place; an adapter may take them for none.
    _see_it_set_out(bench, robot, Waypoint(0.0, 0.0))


def _see_it_set_out(bench: Bench, robot: Robot, target: Waypoint) -> None:
    at, began_s = bench.look(robot), bench.now_s
    bearing_rad = math.atan2(target.y_m - at.y_m, target.x_m - at.x_m)
    far_enough_m = 0.2 * bench.harness.room_m / 2.0
    if at.distance_m(target.x_m, target.y_m) <= 2.0 * far_enough_m:
        return
    try:
        goal = robot.goto(target, Controller.AC)
    except Unsupported:
        return

    def done() -> bool:
        gone_m = bench.tracks[robot.id][-1].distance_m(at.x_m, at.y_m)
        return gone_m > far_enough_m or bench.stands(robot, began_s)

    bench.run(bench.way_s(), done)
    to = bench.tracks[robot.id][-1]
    goal.cancel()
    off = abs(turn(bearing_rad, math.atan2(to.y_m - at.y_m, to.x_m - at.x_m)))
    bench.require(
        to.distance_m(at.x_m, at.y_m) > far_enough_m and off <= _OFF_RAD + 2.0 * bench.noise_m / far_enough_m,
        f"a target at ({target.x_m:.0f}, {target.y_m:.0f}) m was set out for {off:.2f} rad off its bearing, "
        f"{to.distance_m(at.x_m, at.y_m):.2f} m far: coordinates are wrapped, cut off, lose their sign, or 0 is taken "
        "for none",
    )
    bench.run(max(_REST_S, bench.orphaned_s()))


def _at(at: TrackSample, way_m: float, bearing_rad: float) -> Waypoint:
    """Return the waypoint at a distance and direction from a sample."""
    return Waypoint(at.x_m + way_m * math.cos(bearing_rad), at.y_m + way_m * math.sin(bearing_rad))


@clause("goto.accepted_is_not_reached")
def accepted_is_not_reached(bench: Bench) -> None:
    """A goal that was sent is ACTIVE until the robot is there, however near that is and however long it takes."""
    robot = bench.open_one()
    target = bench.place(robot, 0.8, radius_m=bench.near_m)
    goal = robot.goto(target, Controller.AC)
    bench.require_status(goal, GoalStatus.ACTIVE, "what was only sent has not been reached")

    def early() -> bool:
        off_m = bench.tracks[robot.id][-1].distance_m(target.x_m, target.y_m)
        return not goal.active and off_m > target.radius_m + bench.still_m

    wrong = bench.run(bench.way_s(), lambda: early() or not goal.active) and early()
    off_m = bench.tracks[robot.id][-1].distance_m(target.x_m, target.y_m)
    bench.require(
        not wrong,
        f"the goal ended {goal.status.value} at {off_m:.2f} m from its target: the vehicle's 'accepted', or its own "
        "larger acceptance radius, was taken for arrival",
    )
    bench.require_status(goal, GoalStatus.REACHED, "the robot does not get within 0.05 m of a target")
    if _ends_tightly(bench):
        bench.settle()
        at = bench.look(robot)
        bench.go(
            robot, _at(at, 0.8 * bench.near_m, at.heading_rad)._replace(radius_m=_TIGHT * bench.near_m),
            cause="a goal so near, whatever its radius, is taken for reached by the vehicle, or not sent",
        )  # fmt: skip
    target = bench.place(robot, -0.8)
    slow_m_s = bench.look(robot).distance_m(target.x_m, target.y_m) / _LASTS_S
    target = target._replace(speed_m_s=slow_m_s, timeout_s=_GIVEN_S)
    began = bench.look(robot)
    goal = robot.goto(target, Controller.AC)
    bench.run(target.timeout_s, lambda: not goal.active)
    moved = bench.look(robot).distance_m(began.x_m, began.y_m) > bench.near_m
    bench.require_status(
        goal, GoalStatus.REACHED,
        f"a leg that takes {_LASTS_S:.0f} s is given up before the {target.timeout_s:.0f} s of its timeout_s: the "
        "vehicle has a time-out of its own"
        if moved else f"it stays where it is: a speed as low as {slow_m_s:.3g} m/s is suppressed as if it were 0",
    )  # fmt: skip


@clause("goto.radius")
def radius(bench: Bench) -> None:
    """A larger radius ends a goal earlier, a smaller one later: the radius belongs to the goal."""
    wide_m, near_m = (_end_within(bench, times) for times in _RADII)
    bench.require(wide_m > near_m, "both radii ended at the same distance: the radius is not the goal's own")
    if _ends_tightly(bench):
        _end_within(bench, _TIGHT)


def _ends_tightly(bench: Bench) -> bool:
    """Return whether a robot is to end goals of a small radius, and has no larger one of its own, as vehicles may."""
    return bench.caps.in_process and _TIGHT * bench.near_m >= 2.0 * bench.caps.position_noise_m


def _end_within(bench: Bench, times: float) -> float:
    """Judge whether a goal ends just within its radius, given in `near_m`; return the distance from its target."""
    robot = bench.open_one()
    radius_m = times * bench.near_m
    target = bench.place(robot, 0.8, radius_m=radius_m)
    bench.go(robot, target)
    off_m = bench.look(robot).distance_m(target.x_m, target.y_m)
    slack = bench.caps.v_max_m_s * (2 * TICK_S + bench.caps.setpoint_period_s + bench.caps.sample_age_s)
    bench.require(
        radius_m - slack - bench.still_m <= off_m <= radius_m + 1e-9 or radius_m < slack,
        f"a goal of radius {radius_m:g} m ended {off_m:.3f} m from its target: another radius than its own was used",
    )
    bench.close()
    return off_m


@clause("goto.holds", truth=True)
def holds(bench: Bench) -> None:
    """After arrival the robot stays there."""
    robot = bench.open_one()
    target = bench.place(robot, 0.4, 0.2)
    bench.go(robot, target)
    bench.settle()
    off_m = bench.look(robot).distance_m(target.x_m, target.y_m)
    bench.require(
        off_m <= 0.5 * target.radius_m + bench.caps.overshoot_m + bench.still_m,
        f"{bench.settle_s():.0f} s after arrival it is {off_m:.2f} m from the target: the last set-point is a velocity "
        "that goes on, or it stops at the edge of the radius instead of driving to the place itself",
    )
    bench.expect_still(robot, 3.0, "it creeps, circles or works off older targets")


@clause("goto.wakes")
def wakes(bench: Bench) -> None:
    """A robot that nothing was asked of for a while has stayed where it is, and a goto moves it within the latency."""
    robot = bench.open_one()
    shuttle = Shuttle(bench, robot)
    bench.settle()
    idle_s = _IDLE_IN_PROCESS_S if bench.caps.in_process else _IDLE_S
    began_s = bench.now_s
    bench.expect_still(robot, idle_s, "it moves although nothing was asked of it")
    heard_s = [each.state.stamp_s for each in bench.since(robot, began_s)]
    gaps_s = [after_s - before_s for before_s, after_s in pairwise([began_s, *heard_s, bench.now_s])]
    # A pause of the host makes one gap; a robot that sends less at rest makes several.
    bench.measure(
        "rest_gap_s", sorted(gaps_s)[-_GAPS:][0],
        bench.caps.sample_age_s + bench.caps.jitter_s + TICK_S, bench.read_s,
        f"in {idle_s:.0f} s of rest samples come more seldom than sample_age_s promises: it saves power or messages",
    )  # fmt: skip
    bench.run(TICK_S, closely=True)
    shuttle.measure_start(
        "wakes_s", f"after {idle_s:.0f} s of rest it has to wake up: it saves power, or its brakes stick"
    )


@clause("goto.heading", truth=True)
def heading(bench: Bench) -> None:
    """A heading that is asked for is arrived with, or goto raises Unsupported and sends nothing."""
    robot = bench.open_one()
    headings = (
        (turn(0.0, bench.home(robot)[2] + 1.8),
         "the heading was dropped (raise Unsupported), or its sign or zero is another frame's"),
        (0.0, "a heading of 0.0, east, is taken for none: ask `is None`"),
        (math.pi / 2.0, "north, the 0 of a compass, is taken for none: ask `is None`"),
        (1.3 * math.pi, "a heading beyond pi is cut off or dropped: wrap it"),
        (-0.8, "a negative heading is cut off, or loses its sign; or those of the SC's goals are dropped"),
    )  # fmt: skip
    for wanted, cause in headings[: bench.trials(len(headings))]:
        by = Controller.SC if wanted < 0.0 else Controller.AC
        if by is not robot.in_charge:
            robot.switch_ac_sc(by, "conformance")
            bench.run(bench.caps.latency_s + 2 * TICK_S)
        at, began_s = bench.look(robot), bench.now_s
        # Across the heading, so that an adapter that drops it arrives with another; then back to the room's middle.
        ends = [_at(at, 0.25 * bench.harness.room_m, wanted + across) for across in (1.0, -1.0)]
        target = min(ends, key=partial(bench.from_start, robot))
        try:
            goal = robot.goto(target._replace(heading_rad=wanted), by)
        except Unsupported:
            bench.expect_still(robot, 1.0, "an unsupported goto must send nothing")
            return
        bench.arrive(goal, "a target with a heading is not driven to: refused, or longer than what is read")
        bench.run(
            bench.settle_s() + 10.0 / bench.caps.yaw_rate_max_rad_s,
            lambda began_s=began_s: bench.stands(robot, began_s),  # type: ignore[misc]
        )
        off = abs(turn(wanted, bench.look(robot).heading_rad))
        bench.require(
            off <= 0.1, f"asked for {wanted:.2f} rad, it stands with a heading {off:.2f} rad off that: {cause}"
        )
    if not bench.caps.pivots_first:
        return
    aside = turn(0.0, bench.look(robot).heading_rad + 1.5)
    for wanted in (aside, *_SEAMS_RAD)[: bench.trials(1 + len(_SEAMS_RAD))]:
        at = bench.look(robot)
        robot.goto(Waypoint(at.x_m, at.y_m, heading_rad=wanted), robot.in_charge)
        bench.run(
            bench.settle_s() + 10.0 / bench.caps.yaw_rate_max_rad_s,
            lambda wanted=wanted: abs(turn(wanted, bench.tracks[robot.id][-1].heading_rad)) <= 0.1,  # type: ignore[misc]
        )
        off = abs(turn(wanted, bench.look(robot).heading_rad))
        bench.require(
            off <= 0.1,
            f"asked for {wanted:.5f} rad where it stands, it has a heading {off:.2f} rad off that: "
            f"{'a goal so near is taken for reached, whatever its heading' if wanted == aside else _SEAM}",
        )


@clause("goto.no_heading", needs=("pivots_first",))
def no_heading(bench: Bench) -> None:
    """Without a heading the robot drives forwards, wherever to, and stands as it came, also behind a goal with one."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, 0.0, heading_rad=turn(0.0, bench.home(robot)[2] + _ASKEW_RAD)))
    bench.settle()
    for course_rad, where in ((-math.pi / 2.0, "to the south"), (math.pi, "to the west")):
        target = _at(bench.look(robot), 0.25 * bench.harness.room_m, course_rad)
        _drives_forwards(bench, robot, target, where)
        off_rad = abs(turn(course_rad, bench.look(robot).heading_rad))
        bench.require(
            off_rad <= _AS_IT_CAME_RAD,
            f"sent {where} without a heading it stands {off_rad:.2f} rad off that way: a heading that nobody asked "
            "for, such as 0 or a goal's before, is sent",
        )
    if bench.caps.reverses:
        home_rad = bench.home(robot)[2]
        bench.go(robot, bench.place(robot, 0.3, heading_rad=home_rad))
        bench.get_going(robot, bench.place(robot, -0.6, heading_rad=home_rad))
        where = "farther on the way that it drives backwards for a goal with one, but itself"
        _drives_forwards(bench, robot, bench.place(robot, -0.9), where)


def _drives_forwards(bench: Bench, robot: Robot, target: Waypoint, where: str) -> None:
    """Send a robot to a target without a heading, and require that it drives forwards."""
    began_s = bench.now_s
    bench.go(robot, target)
    bench.settle()
    driven_rad = [
        abs(turn(math.atan2(each.state.vy_m_s, each.state.vx_m_s), each.heading_rad))
        for each in bench.since(robot, began_s)
        if each.speed_m_s > 0.5 * bench.caps.v_max_m_s
    ]
    backwards_rad = quantile(driven_rad, 0.5)
    bench.require(
        backwards_rad <= math.pi / 2.0,
        f"sent {where} without a heading it drives {backwards_rad:.2f} rad off its own heading: a heading that nobody "
        "asked for, such as 0 or a goal's before, is sent, or it goes on backwards",
    )


@clause("goto.not_in_charge", truth=True)
def not_in_charge(bench: Bench) -> None:
    """A goto by the controller not in charge is REJECTED and moves nothing."""
    robot = bench.open_one(Controller.SC)
    goal = robot.goto(bench.place(robot, 0.8), Controller.AC)
    bench.require_status(goal, GoalStatus.REJECTED, "goto() is overridden, and does not check who is in charge")
    bench.expect_still(robot, 2.0, "the goto of a controller not in charge was executed")
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.expect_still(robot, 2.0, "a rejected goto was kept, and executed once its controller was in charge")


@clause("goto.rejected_disturbs_nothing")
def rejected_disturbs_nothing(bench: Bench) -> None:
    """A rejected goto does not disturb the goal in progress."""
    robot = bench.open_one(Controller.SC)
    mine = bench.get_going(robot, bench.place(robot, 0.8), Controller.SC)
    other = robot.goto(bench.place(robot, -0.8), Controller.AC)
    bench.require_status(other, GoalStatus.REJECTED, "goto() is overridden, and does not check who is in charge")
    bench.arrive(mine, "a rejected goto ended or diverted the goal of the controller in charge")


@clause("goto.invalid")
def invalid(bench: Bench) -> None:
    """A target that is not finite, absurd or no Waypoint raises ValueError or TypeError and sends nothing."""
    robot = bench.open_one()
    good = bench.place(robot, 0.8)
    bad: dict[str, Waypoint] = {
        "NaN": good._replace(x_m=float("nan")),
        "infinity": good._replace(y_m=float("inf")),
        "40 km": good._replace(x_m=40_000.0),
        "a heading of NaN": good._replace(heading_rad=float("nan")),
        "a speed of 0": good._replace(speed_m_s=0.0),
        "a negative radius": good._replace(radius_m=-1.0),
        "a time-out of NaN": good._replace(timeout_s=float("nan")),
    }
    for name, target in bad.items():
        bench.require_raises(ValueError, partial(robot.goto, target, Controller.AC), f"a goto with {name}")
    nothing: Waypoint = (good.x_m, good.y_m)  # type: ignore[assignment]
    bench.require_raises(TypeError, lambda: robot.goto(nothing, Controller.AC), "a goto with a bare tuple")
    bench.expect_still(robot, 1.0, "an invalid target was sent")
    mine = bench.get_going(robot, good)
    bench.require_raises(ValueError, lambda: robot.goto(bad["NaN"], Controller.AC), "a goto with NaN")
    bench.arrive(mine, "an invalid goto ended or diverted the goal in progress")


@clause("goto.flood", truth=True)
def flood(bench: Bench) -> None:
    """Of many goals sent at once only the last is driven to; none is queued."""
    robot = bench.open_one()
    goals = [robot.goto(bench.place(robot, -0.8 if number % 2 else 0.0, 0.8), Controller.AC) for number in range(200)]
    before = bench.look(robot)
    target = bench.place(robot, 0.7)
    began_s = bench.now_s
    bench.go(robot, target)
    bench.settle()
    ended = {goal.status for goal in goals}
    bench.require(
        ended == {GoalStatus.SUPERSEDED},
        f"of 200 goals that were replaced some are {sorted(each.value for each in ended)}, expected superseded: goto() "
        "or read_state() is overridden",
    )
    strayed = max(
        abs(turn(before.heading_rad, each.heading_rad)) if each.speed_m_s > 0.05 else 0.0
        for each in bench.since(robot, began_s)
    )
    off_m = bench.look(robot).distance_m(target.x_m, target.y_m)
    bench.require(
        strayed <= 0.2 and off_m <= target.radius_m + bench.caps.overshoot_m + bench.still_m,
        f"on the way to the last of 201 targets, straight ahead, it drove {strayed:.2f} rad off, and after "
        f"arrival it is {off_m:.2f} m away: older targets are queued and replayed; keep only the latest",
    )
    bench.expect_still(
        robot, 2.0, f"older targets are queued and replayed (turned by more than {bench.still_rad:g} rad, or moved)"
    )
