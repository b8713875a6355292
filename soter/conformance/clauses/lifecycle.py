"""Life cycle: before init(), ready, closed."""

from __future__ import annotations

import math
from unittest import mock

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.figure import NotTested
from soter.conformance.track import turn
from soter.errors import LifecycleError, RobotUnavailable
from soter.sdk import Controller, GoalStatus, Robot, Waypoint

_TURNS_S = 0.3
_REFUSES_S = 10.0
_CLOSES_S, _LATE_S = 2.0, 1.0


def _refused(bench: Bench, robot: Robot, when: str) -> None:
    somewhere = Waypoint(robot.spec.x_m, robot.spec.y_m)
    calls = {
        "goto": lambda: robot.goto(somewhere, Controller.SC),
        "read_state": robot.read_state,
        "switch_ac_sc": lambda: robot.switch_ac_sc(Controller.AC, "conformance"),
        "renew_lease": robot.renew_lease,
    }
    for name, call in calls.items():
        bench.require_raises(LifecycleError, call, f"{name}() {when}")


@clause("lifecycle.before_init")
def before_init(bench: Bench) -> None:
    """Before init() every call raises LifecycleError, and capabilities are unknown."""
    (robot,) = bench.open_raw().robots
    _refused(bench, robot, "before init()")
    bench.require_raises(LifecycleError, lambda: robot.capabilities, "capabilities before init()")


@clause("lifecycle.init")
def init(bench: Bench) -> None:
    """A robot that is ready is at rest, the SC is in charge, and a sample is there."""
    robot = bench.open_one(Controller.SC)
    state = bench.look(robot).state
    bench.require(
        state.controller in (Controller.SC, None),
        f"after init() the robot reports {state.controller} in charge, expected SC: init() must hand over to the SC",
    )
    bench.expect_still(robot, 1.0, "init() must leave the robot at rest, with no target of an earlier session")


@clause("lifecycle.says_why", tier=Tier.WIRE)
def says_why(bench: Bench) -> None:
    """init() of a robot that refuses to get ready raises RobotUnavailable, with the robot's own words for that."""
    bench.require_hook("refusing")
    fleet, words = bench.harness.refusing()
    bench.opener = lambda: fleet
    (robot,) = bench.open_raw().robots
    try:
        robot.init(_REFUSES_S)
    except RobotUnavailable as failure:
        said = str(failure)
    else:
        bench.fail(f"a robot that refuses to get ready ({words!r}) counts as ready: what it says is not listened to")
    bench.require(
        words in said,
        f"a robot refuses to get ready and says {words!r}, and init() raises {said!r}: what it says of itself gets "
        "lost, such as by a filter of how severe it is; whoever is to mend it looks in the wrong place",
    )


@clause("lifecycle.init_twice")
def init_twice(bench: Bench) -> None:
    """A second init() raises LifecycleError and changes nothing."""
    robot = bench.open_one()
    bench.require_raises(LifecycleError, lambda: robot.init(1.0), "a second init()")
    bench.go(robot, bench.place(robot, 0.4), cause="after a second init() the robot does not obey any more")


@clause("lifecycle.after_close")
def after_close(bench: Bench) -> None:
    """After close() every call raises LifecycleError."""
    robot = bench.open_one()
    robot.close(5.0)
    _refused(bench, robot, "after close()")
    bench.require_raises(LifecycleError, lambda: robot.init(1.0), "init() after close()")


@clause("lifecycle.close_twice")
def close_twice(bench: Bench) -> None:
    """close() may be called at any time, before init() too, and again."""
    fleet = bench.open_raw()
    fleet.robots[0].close(5.0)
    fleet.robots[0].close(5.0)
    fleet.close()
    fleet.close()


@clause("lifecycle.close_ends_goals")
def close_ends_goals(bench: Bench) -> None:
    """close() ends the goal in progress as CANCELLED, within its time-out."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.8))
    before_s = bench.now_s
    robot.close(5.0)
    bench.measure("close_s", bench.now_s - before_s, 5.0, 0.5, "close() must give up after its time-out")
    bench.require_status(goal, GoalStatus.CANCELLED, "close() is overridden instead of _disconnect()")


@clause("truth.lifecycle.close_stops", tier=Tier.TRUTH)
def close_stops(bench: Bench) -> None:
    """close() leaves a robot stopped that was driving, and one that was turning."""
    bench.truth = True
    first, second = bench.open(2)
    bench.get_going(first, bench.place(first, 0.8))
    _closes_at_rest(bench, first, second)
    second.goto(bench.place(second, -0.8), Controller.AC)
    bench.fleet.robots = (second,)
    bench.run(bench.way_s(), lambda: bench.tracks[second.id][-1].moves)
    bench.run(_TURNS_S)
    _closes_at_rest(bench, second)


def _closes_at_rest(bench: Bench, robot: Robot, *others: Robot) -> None:
    """Close a robot, and fail the clause unless it stands from then on."""
    robot.close(5.0)
    clock = bench.fleet.clock
    before = bench.true_pose(robot.id)
    for _ in range(20):
        # The other robot keeps the fleet alive: closing one must be enough to stop it.
        for each in others:
            each.renew_lease()
        clock.sleep_until(clock.now() + 0.05)
    slipped, turned = _moved_since(bench, robot, before)
    bench.require(
        slipped <= bench.held_m and turned <= bench.still_rad,
        f"it moved on by {slipped:.3f} m and {turned:.2f} rad in the second after close() returned: _disconnect() must "
        "stop the vehicle and wait until it stands",
    )


def _moved_since(bench: Bench, robot: Robot, pose: tuple[float, float, float]) -> tuple[float, float]:
    """Return how far a robot truly is from a pose, in metres, and by how much it has turned since, in radians."""
    now = bench.true_pose(robot.id)
    return math.dist(pose[:2], now[:2]), abs(turn(pose[2], now[2]))


@clause("lifecycle.reopen")
def reopen(bench: Bench) -> None:
    """After close() the robots can be opened again, fresh."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, 0.4))
    bench.close()
    for before in (Controller.AC, Controller.SC):
        robot = bench.open_one(before)
        bench.get_going(robot, bench.place(robot, 0.8), before)
        bench.close()
        # With the same controller active and the lease renewed, a target that the vehicle kept would be driven to.
        again = bench.open_one(before)
        bench.expect_still(again, 1.0, f"what the {before} was on its way to when it was closed is driven to once more")
        bench.close()
    again = bench.open_one()
    bench.go(
        again,
        bench.place(again, 0.4),
        cause="it went there before it was closed: _disconnect() or Fleet._close() leaves something behind",
    )


@clause("lifecycle.close_in_time")
def close_in_time(bench: Bench) -> None:
    """close() returns in its time although the robot does not stop, so that the others are stopped as well."""
    robot = bench.open_one()
    impair = getattr(robot, "impair", None)
    if impair is None or not bench.caps.in_process:
        raise NotTested("not declared: the hook 'impair' of a robot in process")
    bench.get_going(robot, bench.place(robot, 0.9))
    bench.faulty = True
    impair(1.0, 1.0, 0.0, True)
    clock, ends_s = robot.clock, bench.now_s + _CLOSES_S + _LATE_S
    sleep_until = clock.sleep_until

    def for_so_long(time_s: float) -> None:
        bench.require(
            time_s <= ends_s,
            f"a robot whose brakes have failed rolls on, and close({_CLOSES_S:g}) has not returned after "
            f"{_CLOSES_S + _LATE_S:g} s: it waits for the robot to stop, however long that takes; give up in time, or "
            "the other robots are never told to stop",
        )
        sleep_until(time_s)

    try:
        with mock.patch.object(clock, "sleep_until", for_so_long):
            robot.close(_CLOSES_S)
    finally:
        impair(1.0, 1.0, 1.0, True)


@clause("truth.lifecycle.init_stays", tier=Tier.TRUTH)
def init_stays(bench: Bench) -> None:
    """init() moves no robot that stands on the ground: nobody has looked yet at what is around it."""
    (robot,) = bench.open_raw().robots
    before = bench.true_pose(robot.id)
    robot.init(bench.harness.connect_timeout_s)
    bench.capabilities = robot.capabilities
    moved_m, turned_rad = _moved_since(bench, robot, before)
    bench.require(
        moved_m <= bench.held_m and turned_rad <= bench.still_rad,
        f"init() moved the robot by {moved_m:.3f} m and {turned_rad:.2f} rad, without a goal and without a lease: it "
        "leaves its charger, looks for an index or tries its motors by itself; nothing may move before SOTER says so",
    )
