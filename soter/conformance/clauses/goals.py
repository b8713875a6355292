"""Goals: every goto has an id, ends once, and is ended only by calls that are about it."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import TrackSample, quantile, turn
from soter.conformance.trials import Shuttle
from soter.errors import Unsupported
from soter.sdk import Controller, Goal, GoalStatus, Robot, Waypoint

_MANY = 300
_REPLACED_IN_PROCESS = 8
_REPLACED = 4
_EARLY = 2
_GAINS = 0.15
_SAMPLE_S = 0.02
_CANCELS_IN_PROCESS = 200
_CANCELS = 12
_STARTS_S = 0.1
_SEES_S = 0.2
_AWAY_M = 0.05
_AWAY = 2.0
_WIDE = 8.0
_EARLY_STOPS: tuple[tuple[str, str, Callable[[Robot, Goal], object]], ...] = (
    ("cancel_early_s", "a stop", lambda _, goal: goal.cancel()),
    ("switch_early_s", "a switch", lambda robot, _: robot.switch_ac_sc(Controller.SC, "conformance")),
    ("lease_early_s", "the end of its lease", lambda robot, _: robot.renew_lease()),
)


@clause("goal.ids")
def ids(bench: Bench) -> None:
    """Every goal has an id of its own, and samples name the goal in progress, or none."""
    robot = bench.open_one()
    # More goals than eight bits can number.
    goals = [robot.goto(bench.place(robot, 0.5), Controller.AC) for _ in range(_MANY)]
    bench.require(len({goal.id for goal in goals}) == _MANY, "two goals have one id: goto() is overridden")
    bench.run(bench.caps.latency_s + bench.caps.sample_age_s + 4 * TICK_S)
    seen = bench.look(robot).state.goal_id
    bench.require(
        seen in (None, goals[-1].id),
        f"the sample names goal {seen}, the one in progress is {goals[-1].id}: an older goal, the vehicle's own count, "
        "a number of too few bits, or what was sent to the same place again was taken for one goal",
    )
    goals[-1].cancel()
    bench.run(bench.caps.latency_s + bench.caps.sample_age_s + 4 * TICK_S)
    seen = bench.look(robot).state.goal_id
    bench.require(
        seen is None,
        f"the sample names goal {seen}, which was cancelled: say what the robot works on, not what it was told last",
    )


@clause("goal.superseded", truth=True)
def superseded(bench: Bench) -> None:
    """A new goal ends the one before as SUPERSEDED, and the robot turns to the new one."""
    robot = bench.open_one()
    first = bench.get_going(robot, bench.place(robot, 0.8))
    target = bench.place(robot, -0.3, 0.5)
    second = robot.goto(target, Controller.AC)
    bench.require_status(first, GoalStatus.SUPERSEDED, "the goal before must end when another takes its place")
    at = bench.look(robot)
    began_s = bench.now_s
    bench.arrive(second, "after a new goal the robot does not get to it")
    caps = bench.caps
    allowed = caps.v_max_m_s * (caps.latency_s + caps.setpoint_period_s + TICK_S + caps.sample_age_s)
    allowed += caps.v_max_m_s**2 / (2 * caps.brake_m_s2) + caps.tube_m
    x_m, y_m = first.target.x_m, first.target.y_m
    nearer = at.distance_m(x_m, y_m) - min(each.distance_m(x_m, y_m) for each in bench.since(robot, began_s))
    bench.require(
        nearer <= allowed + bench.still_m,
        f"after it was superseded, the robot went on to the old target for {nearer:.2f} m, allowed {allowed:.2f} m: "
        "targets are queued instead of replaced",
    )
    bench.settle()
    bench.expect_still(robot, 2.0, "the old target is driven to after the new one")
    bench.require_status(first, GoalStatus.SUPERSEDED, "a goal ends once")
    bench.get_going(robot, bench.place(robot, 0.8))
    away_m = _AWAY * target.radius_m
    bench.run(bench.way_s(), lambda: bench.tracks[robot.id][-1].distance_m(target.x_m, target.y_m) > away_m)
    bench.arrive(
        robot.goto(target, Controller.AC),
        "it was there last, and set out for another place before it was called back: a goal to where the last one that "
        "was reached has led is taken for that one, and done, wherever the robot is by now",
    )
    bench.settle()
    bench.get_going(robot, bench.place(robot, 0.8))
    at, began_s = bench.look(robot), bench.now_s
    robot.goto(Waypoint(at.x_m, at.y_m), Controller.AC)
    bench.run(caps.latency_s + bench.brakes_s + 1.0)
    # The robot may go back to its target, but not drive on.
    bench.measure(
        "held_after_m", max(each.distance_m(at.x_m, at.y_m) for each in bench.since(robot, began_s)), allowed,
        bench.still_m, "a goal where the robot is, or near it, is taken for reached and not sent: it goes on to the "
        "one before",
    )  # fmt: skip


@clause("goal.replaced", needs=("pivots_first",))
def replaced(bench: Bench) -> None:
    """A goal that replaces another one on the way is acted upon within the latency."""
    robot, caps = bench.open_one(), bench.caps
    # To the side, and without a heading: the robot has to come to rest and turn before it can drive there.
    shuttle = Shuttle(bench, robot)
    trials = shuttle.trials(
        _REPLACED_IN_PROCESS if caps.in_process else bench.trials(_REPLACED),
        lambda _: robot.goto(bench.place(robot, 0.0, 3.0), Controller.AC),
        cause="a goal to the side is not turned to", after=lambda: robot.goto(shuttle.end, Controller.AC).cancel(),
    )  # fmt: skip
    begins_s = [trial.end.begins_s for trial in trials]
    bench.measure(
        "replaced_s", max(begins_s), caps.latency_s + caps.jitter_s, bench.fit_s,
        "a robot on its way goes on to the old target before it turns to the new one: a stop is obeyed sooner than a "
        "goto, or what it plans by works in cycles that are longer than latency_s", spread=begins_s,
    )  # fmt: skip


@clause("goal.cancel", truth=True)
def cancel(bench: Bench) -> None:
    """Cancelling a goal ends it as CANCELLED and stops the robot."""
    robot = bench.open_one()
    for cause in (
        "",
        "a goto to the place of one that was cancelled is taken for the same, and not sent",
    ):
        goal = bench.get_going(robot, bench.place(robot, 0.9), cause=cause)
        goal.cancel()
        bench.require_status(goal, GoalStatus.CANCELLED, "_cancel() is overridden")
        bench.expect_stop(robot, "_halt() does nothing, or is not passed on to the vehicle")
    bench.go(robot, bench.place(robot, 0.2, 0.2), cause="after a cancel the robot takes no new goal")
    goal = bench.go(robot, bench.place(robot, -0.8, radius_m=_WIDE * bench.near_m))
    goal.cancel()
    bench.expect_stop(robot, "a cancel within a goal's radius is dropped as needless: it drives on to the middle")
    if bench.caps.reverses:
        bench.settle()
        at = bench.look(robot)
        way_m = 0.7 * bench.harness.room_m / 2.0
        behind = bench.place(robot, 0.0)._replace(
            x_m=at.x_m - way_m * math.cos(at.heading_rad), y_m=at.y_m - way_m * math.sin(at.heading_rad),
            heading_rad=at.heading_rad,
        )  # fmt: skip
        with suppress(Unsupported):
            goal = bench.get_going(robot, behind)
            goal.cancel()
            bench.expect_stop(robot, "while it drives backwards a cancel does not stop it")


@clause("goal.of_sc")
def of_sc(bench: Bench) -> None:
    """What ends a goal of the AC ends one of the SC: a cancel, its time-out, and a lease that ends."""
    robot = bench.open_one(Controller.SC)
    goal = bench.get_going(robot, bench.place(robot, 0.9), Controller.SC)
    goal.cancel()
    bench.expect_stop(robot, "a cancel stops goals of the AC only")
    bench.get_going(robot, bench.place(robot, -0.9), Controller.SC)
    bench.expect_stop(robot, "the lease counts for goals of the AC only", extra_s=bench.caps.lease_s, renew=False)
    timeout_s = 0.5 * bench.harness.room_m / 2.0 / bench.caps.v_max_m_s
    goal = robot.goto(bench.place(robot, 0.9, timeout_s=timeout_s), Controller.SC)
    bench.run(timeout_s + 1.0, lambda: not goal.active)
    bench.require_status(goal, GoalStatus.TIMED_OUT, "the goal's own time-out counts, in fleet time")
    bench.expect_stop(robot, "the time-out of a goal stops goals of the AC only")


@clause("goal.cancel_early")
def cancel_early(bench: Bench) -> None:
    """A cancel, a switch, or the end of its lease, stops a robot that gains speed as soon as one that drives evenly."""
    robot, caps = bench.open_one(), bench.caps
    # In process there is a sample at the very moment at which the robot begins to brake.
    late_s = caps.latency_s + (0.0 if caps.in_process else caps.setpoint_period_s)
    for name, what, call in _EARLY_STOPS:
        renews, begins_s = name != "lease_early_s", []
        for ahead in (0.8, -0.8) * (_EARLY if caps.in_process or name == "cancel_early_s" else 1):
            robot.switch_ac_sc(Controller.AC, "conformance")
            goal = robot.goto(bench.place(robot, ahead), Controller.AC)
            bench.run(
                bench.way_s(), lambda: bench.tracks[robot.id][-1].speed_m_s > _GAINS * caps.v_max_m_s, closely=True
            )
            called_s = bench.now_s
            call(robot, goal)
            bench.settle(renew=renews, closely=True)
            goal.cancel()
            seen = bench.since(robot, called_s)
            fastest = max(seen, key=lambda each: each.speed_m_s)
            begins_s.append(fastest.at_s - called_s)
        # The fastest sample is the last one before the robot begins to brake.
        bench.measure(
            name, quantile(begins_s, 0.5), late_s + (0.0 if renews else caps.lease_s), bench.fit_s + _SAMPLE_S,
            f"{what} waits until the robot is up to speed, or until a ramp that has begun is at its end",
            spread=begins_s,
        )  # fmt: skip
    robot.goto(bench.place(robot, 0.8), Controller.AC).cancel()
    bench.run(caps.latency_s + 2 * TICK_S)
    bench.expect_still(
        robot, 1.0, "a cancel right after its goto is lost: it stops only what moves already, or is taken for a "
        "repetition of the cancel right before it",
    )  # fmt: skip


@clause("goal.cancels")
def cancels(bench: Bench) -> None:
    """Of many goals each is turned to, and each cancel stops the robot; none is lost or confused with another."""
    robot, caps = bench.open_one(), bench.caps
    starts_s = caps.latency_s + caps.jitter_s + caps.setpoint_period_s + _STARTS_S
    stops_s = starts_s + bench.brakes_s + TICK_S
    bench.go(robot, bench.place(robot, 0.0))
    for number in range(_CANCELS_IN_PROCESS if caps.in_process else _CANCELS):
        # To and fro about one place, so that it turns most of the time.
        began = bench.look(robot)
        goal = robot.goto(bench.place(robot, 0.8 if number % 2 else -0.8), Controller.AC)
        bench.run(starts_s)
        goal.cancel()
        bench.run(stops_s)
        before = bench.look(robot)
        bench.run(_SEES_S)
        after = bench.look(robot)
        moved_m, turned_rad = after.distance_m(before.x_m, before.y_m), turn(before.heading_rad, after.heading_rad)
        bench.require(
            moved_m <= bench.still_m and abs(turned_rad) <= bench.still_rad,
            f"{stops_s:.2f} s after cancel number {number + 1} it still moves, {moved_m:.3f} m and "
            f"{abs(turned_rad):.2f} rad within {_SEES_S:g} s: one cancel of many is lost",
        )
        away_m = after.distance_m(*goal.target[:2]) - began.distance_m(*goal.target[:2])
        away_rad = (_aside_rad(after, goal.target) - _aside_rad(began, goal.target)) * caps.pivots_first
        bench.require(
            away_m <= _AWAY_M + bench.still_m and away_rad <= bench.still_rad,
            f"goal number {number + 1} made it go {max(away_m, 0.0):.2f} m and turn {max(away_rad, 0.0):.2f} rad away "
            "from its target: one of many goals is driven to with the target of the one before",
        )


def _aside_rad(sample: TrackSample, target: Waypoint) -> float:
    """Return how far a robot would have to turn to look at a target."""
    return abs(turn(sample.heading_rad, math.atan2(target.y_m - sample.y_m, target.x_m - sample.x_m)))


@clause("goal.cancel_own")
def cancel_own(bench: Bench) -> None:
    """cancel() ends its own goal, also one that has just replaced another, and none that is sent behind it."""
    robot = bench.open_one()
    first = robot.goto(bench.place(robot, 0.8), Controller.AC)
    second = bench.get_going(robot, bench.place(robot, 0.7))
    first.cancel()
    bench.require_status(first, GoalStatus.SUPERSEDED, "a goal ends once; a late cancel() changes nothing")
    bench.require_status(second, GoalStatus.ACTIVE, "cancel() ended a goal that it does not name")
    bench.arrive(second, "cancel() of an old goal stopped the robot: stop acts on its own goal only")
    bench.get_going(robot, bench.place(robot, -0.7)).cancel()
    behind = robot.goto(bench.place(robot, -0.3), Controller.AC)
    bench.arrive(
        behind,
        "a goal that is sent right behind a cancel is lost: both wait, and the stop is done last; or it is refused "
        "while the robot still brakes",
    )
    bench.settle()
    bench.get_going(robot, bench.place(robot, 0.9))
    robot.goto(bench.place(robot, 0.95), Controller.AC).cancel()
    bench.expect_stop(
        robot, "a cancel right behind a goto that took the place of another is lost: it names the goal that the last "
        "sample named, or that the vehicle has taken so far",
    )  # fmt: skip


@clause("goal.timeout", truth=True)
def timeout(bench: Bench) -> None:
    """At its time-out a goal is TIMED_OUT, in fleet time, and the robot stops; no goal that comes after is stopped."""
    robot = bench.open_one()
    timeout_s = 0.5 * bench.harness.room_m / 2.0 / bench.caps.v_max_m_s
    goal = robot.goto(bench.place(robot, 0.9, timeout_s=timeout_s), Controller.AC)
    sent_s = bench.now_s
    bench.run(timeout_s + 1.0, lambda: not goal.active)
    called_s = bench.now_s
    bench.require_status(goal, GoalStatus.TIMED_OUT, "the goal's own time-out counts, in fleet time")
    bench.measure(
        "timeout_s",
        called_s - sent_s,
        timeout_s,
        2 * TICK_S + bench.caps.jitter_s,
        "the time-out is not kept in fleet time",
    )
    bench.require(called_s - sent_s >= timeout_s - 1e-6, "it timed out early: host time instead of fleet time")
    bench.expect_stop(robot, "a goal that timed out is not stopped on the vehicle")
    bench.get_going(
        robot, bench.place(robot, -0.9),
        cause="the goal behind one that timed out is lost: what ends a goal on the vehicle ends, or refuses, the next "
        "one, too",
    )  # fmt: skip
    robot.goto(bench.place(robot, -0.9, timeout_s=timeout_s), Controller.AC)
    bench.run(timeout_s / 2.0)
    goal = robot.goto(bench.place(robot, -0.8), Controller.AC)
    bench.arrive(goal, "the time-out of the goal that it took the place of has stopped it")


@clause("goal.written_in_read_state")
def written_in_read_state(bench: Bench) -> None:
    """Goals change when the state is read, and at no other time."""
    robot = bench.open_one()
    goal = robot.goto(bench.place(robot, 0.4), Controller.AC)
    bench.run(bench.way_s() / 2, read=False)
    bench.require_status(
        goal, GoalStatus.ACTIVE, "something besides read_state() wrote the handle: a thread or a callback"
    )
    robot.read_state()
    bench.require(
        not (goal.active and bench.run(2 * TICK_S, lambda: not goal.active)),
        "only the read after the next one brought the goal up to date: each read hands out the sample that was due at "
        "the one before; take the newest when it is read",
    )
    bench.require_status(goal, GoalStatus.REACHED, "read_state() did not bring the goal up to date with the sample")
