"""Outages: what a robot is told while messages are lost holds, at once and once the link is back."""

from __future__ import annotations

import math

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.sdk import Controller, Goal, Link, Robot

_TRIES = 8
_LOSS = 0.5
_MADE_GOOD_S = 0.5
_LOOKS_S = 0.7
_OFF_S = ((1.2, True), (2.4, False), (2.4, True))
_RETURNS_S = 5.0
_ACTS_S = 2.0
_AWAY_S = 5.0
_COMES_BACK_S = 8.0
_SHOWS_S = 3.0
_LOST = 3000
"""Renewals of two and a half minutes."""

_BETWEEN = 100


@clause("link.switch_is_not_lost", tier=Tier.WIRE, hooks=("loss",))
def switch_is_not_lost(bench: Bench) -> None:
    """A switch made while messages are lost takes effect within the lease."""
    robot = bench.open_one()
    for number in range(_TRIES):
        robot.switch_ac_sc(Controller.AC, "conformance")
        bench.get_going(robot, bench.place(robot, -0.9 if number % 2 else 0.9))
        bench.faulty = True
        bench.harness.loss(_LOSS)
        robot.switch_ac_sc(Controller.SC, "conformance")
        bench.expect_stop(
            robot, "a switch that got lost is not repeated: say with each renewal who is in charge",
            extra_s=bench.caps.lease_s + 6 * TICK_S,
        )  # fmt: skip
        bench.harness.loss(0.0)


@clause("link.lost_stop", tier=Tier.WIRE, hooks=("loss",))
def lost_stop(bench: Bench) -> None:
    """A stop that is lost is made good: where half of all messages are lost a cancel still stops the robot."""
    robot = bench.open_one()
    bench.faulty = True
    for number in range(_TRIES):
        goal = bench.get_going(robot, bench.place(robot, -0.9 if number % 2 else 0.9))
        bench.harness.loss(_LOSS)
        goal.cancel()
        bench.run(bench.orphaned_s() + _MADE_GOOD_S)
        before = bench.true_place(robot)
        bench.run(_LOOKS_S)
        moved_m = math.dist(before, bench.true_place(robot))
        bench.harness.loss(0.0)
        bench.require(
            moved_m <= bench.still_m + 2.0 * bench.noise_m,
            f"after a cancel where half of all messages were lost it drives on, {moved_m:.3f} m in {_LOOKS_S:g} s, and "
            "its lease is renewed: a stop is said once; say with each renewal what is in force",
        )
        bench.run(bench.caps.latency_s + 2 * TICK_S)


@clause("link.outage", tier=Tier.WIRE, hooks=("cut",))
def outage(bench: Bench) -> None:
    """What a robot is told during an outage of a second or two holds once the link is back, and at once."""
    robot = bench.open_one()
    for off_s, stops in _OFF_S:
        bench.go(robot, bench.place(robot, -0.5))
        old = bench.get_going(robot, bench.place(robot, 0.9))
        bench.faulty = True
        bench.harness.cut(robot.id)
        bench.run(0.5 * off_s)
        new: Goal | None = None
        if stops:
            old.cancel()
        else:
            new = robot.goto(bench.place(robot, -0.5), Controller.AC)
        bench.run(0.5 * off_s)
        bench.harness.restore(robot.id)
        bench.run(_RETURNS_S, lambda: robot.read_state().link is Link.UP)
        what = f"{'cancelled' if stops else 'replaced'} in an outage of {off_s:g} s"
        _heeds(bench, robot, old, new, what)


@clause("link.many_lost", tier=Tier.WIRE, hooks=("cut",))
def many_lost(bench: Bench) -> None:
    """A robot obeys again after an outage in which more was lost than in any that is tried in full."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, 0.3))
    bench.faulty = True
    bench.harness.cut(robot.id)
    for number in range(_LOST):
        robot.renew_lease()
        if number % _BETWEEN == 0:
            bench.run(TICK_S)
    bench.harness.restore(robot.id)
    bench.run(_RETURNS_S, lambda: robot.read_state().link is Link.UP)
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.go(
        robot, bench.place(robot, -0.3),
        cause=f"{_LOST} renewals were lost in an outage, and once the link is back, and it is heard, it does not obey: "
        "its program takes what is numbered far beyond the last for old or wrong, for good",
    )  # fmt: skip


@clause("link.left_as_ever", tier=Tier.WIRE, hooks=("cut",))
def left_as_ever(bench: Bench) -> None:
    """After an outage close() leaves a robot as it leaves one that was always heard: in that mode, disarmed as that."""
    bench.require_hook("shown")
    shown = []
    for away_s in (0.0, _AWAY_S):
        bench.faulty = False
        robot = bench.open_one()
        bench.go(robot, bench.place(robot, 0.3))
        if away_s:
            bench.faulty = True
            bench.harness.cut(robot.id)
            bench.run(away_s)
            bench.harness.restore(robot.id)
            bench.run(_COMES_BACK_S)
            bench.go(robot, bench.place(robot, 0.0), cause=f"since an outage of {away_s:g} s it does not obey any more")
        clock = bench.fleet.clock
        bench.fleet.close()
        clock.sleep_until(clock.now() + _SHOWS_S)
        shown.append(bench.harness.shown(robot.id))
        bench.harness.close()
    as_ever, after = shown
    bench.require(
        after == as_ever,
        f"after an outage of {_AWAY_S:g} s close() leaves it otherwise ({after}) than without one ({as_ever}): what "
        "was done to get it ready the first time is forgotten when it is made ready again, and so is not undone",
    )


def _heeds(bench: Bench, robot: Robot, old: Goal, new: Goal | None, what: str) -> None:
    """Fail the clause if a robot goes on to a goal that was cancelled or replaced while nothing got through."""
    here = bench.look(robot)
    bench.run(_ACTS_S)
    now = bench.look(robot)
    x_m, y_m = old.target.x_m, old.target.y_m
    nearer_m = here.distance_m(x_m, y_m) - now.distance_m(x_m, y_m)
    cause = (
        "what is told then is dropped as old or out of order, is not said again, or what the vehicle has is resumed "
        "before it is heard"
    )
    bench.require(
        nearer_m <= bench.caps.v_max_m_s * bench.caps.latency_s + bench.still_m,
        f"the goal was {what}, and once the link is back it goes on to it, by {nearer_m:.2f} m in {_ACTS_S:g} s: "
        f"{cause}",
    )
    named = now.state.goal_id
    bench.require(
        named in (None, new and new.id), f"the goal was {what}, and samples say that it works on goal {named}: {cause}"
    )
    if new is not None:
        bench.arrive(new, f"the goal before was {what}, and the new one is not driven to: {cause}")
