"""Programs: a robot obeys one program at a time."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import turn
from soter.errors import Intruder, SoterError, Uncontrolled
from soter.sdk import Controller, Link, Robot

_MANY_TIMES = 25
_READY_S = 2.0
_LONGER_S = 3.0
_SEIZED_S = 4.0
_NOTICED_S = 1.5
_INTRUDED_S = 2.5
_RAISED_TIMES = 4


@clause("authority.one_program", tier=Tier.WIRE)
def one_program(bench: Bench) -> None:
    """While a program renews its lease, goal or none, a second one moves nothing, and takes nothing away."""
    bench.require_hook("second")
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.3))
    bench.go(robot, bench.place(robot, 0.6))
    bench.settle()
    with bench.harness.second() as fleet:
        _intrude(
            bench, robot, fleet.robots[0], "",
            "the vehicle must follow one program at a time, each by a name of its own",
        )  # fmt: skip
        heard = bench.run(1.0, lambda: robot.read_state().link is Link.UP)
        bench.require(
            heard,
            f"since a second program talks to the robot the first one hears it no more, its link is "
            f"{robot.read_state().link.value}: what the robot says goes to who spoke last, or connected last; say it "
            "to all, or to the program that the robot follows",
        )
        bench.go(robot, bench.place(robot, 0.4), cause="what the first one says is lost while a second one is there")
    bench.go(robot, bench.place(robot, 0.2), cause="a second program, which was not in charge, took the robot away")
    _keep_out(bench, robot)
    bench.get_going(robot, bench.place(robot, -0.9))
    before = bench.look(robot)
    with bench.harness.second() as fleet:
        # The first program is silent now, and the second one sends no goal yet.
        _get_ready(bench, fleet.robots[0], renew=False)
        bench.run(bench.orphaned_s(), renew=False)
        bench.measure(
            "orphan_run_m", bench.look(robot).distance_m(before.x_m, before.y_m),
            bench.caps.v_max_m_s * (bench.orphaned_s() + bench.caps.sample_age_s), bench.still_m,
            "what a second program says renews the lease of the first one, which is silent",
        )  # fmt: skip
        before = bench.look(robot)
        bench.run(1.0, lambda: _renews(fleet.robots[0]), renew=False)
        revived_m = bench.look(robot).distance_m(before.x_m, before.y_m)
        bench.require(
            revived_m <= bench.still_m,
            f"once the second program renews its own lease the robot drives {revived_m:.2f} m to where the first one "
            "had sent it: what one has asked for ends with it",
        )


@clause("authority.next_program", tier=Tier.WIRE)
def next_program(bench: Bench) -> None:
    """A robot that a program has left on, without close(), is free for the next one, which counts its goals alike."""
    bench.require_hook("second")
    # The next program's first goal has the same number as that of the one before, or a lower one.
    for goals in (1, 3):
        bench.opener = None
        _follow_a_program(bench, goals)
        bench.close()


def _follow_a_program(bench: Bench, goals: int) -> None:
    """Judge whether a program is free to drive a robot that another one has left after so many goals."""
    before = bench.open_one()
    ready_s = bench.now_s
    for number in range(goals):
        bench.go(before, bench.place(before, 0.5 - 0.1 * number))
    bench.run(bench.orphaned_s(), renew=False)
    bench.opener = bench.harness.second
    began_s = before.clock.steady_s()
    robot = bench.open_one()
    bench.measure(
        "takes_over_s", before.clock.steady_s() - began_s, ready_s + _LONGER_S, 2 * TICK_S,
        "the robot is held for a program that has ended without close(), though its lease is dead: whoever restarts "
        "that program waits; a robot is free as soon as the lease is",
    )  # fmt: skip
    bench.arrive(
        robot.goto(bench.place(robot, -0.3, 0.5), Controller.AC),
        "its first goal is taken for one of the program before, or for one that was overtaken: goals are known by "
        "their numbers alone, and every program begins with 1",
    )


@clause("authority.seized", tier=Tier.WIRE)
def seized(bench: Bench) -> None:
    """What a person takes from SOTER stays his: it is not driven again, and nobody is said to be in charge of it."""
    bench.require_hook("seize")
    _see_it_left_alone(bench, bench.harness.seize, "has taken the robot and stopped it")


@clause("authority.disabled", tier=Tier.WIRE)
def disabled(bench: Bench) -> None:
    """A robot whose motors a person has switched off stays so: nobody but a person switches them on again."""
    bench.require_hook("disable")
    _see_it_left_alone(bench, bench.harness.disable, "has switched the robot's motors off (disarmed it)")


@clause("authority.left", tier=Tier.WIRE)
def left(bench: Bench) -> None:
    """close() leaves a robot as it is that a person drives by hand."""
    harness = bench.harness
    for hook in ("by_hand", "shown"):
        bench.require_hook(hook)
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    bench.faulty = True
    harness.by_hand(robot.id)
    clock = bench.fleet.clock
    bench.run(bench.orphaned_s() + _SEIZED_S)
    before = harness.shown(robot.id)
    bench.fleet.close()
    ends_s = clock.now() + _SEIZED_S
    while clock.now() < ends_s:
        clock.sleep_until(clock.now() + TICK_S)
        after = harness.shown(robot.id)
        bench.require(
            after == before,
            f"a person drives it by hand ({before}), and close() takes it away ({after}): in the air, or on a slope, "
            "that may be its end; leave it alone whenever it is not in the mode in which SOTER drives it",
        )


def _see_it_left_alone(bench: Bench, take: Callable[[int], None], done: str) -> None:
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    bench.faulty = True
    take(robot.id)
    bench.run(bench.orphaned_s() + 1.0)
    refused = False
    try:
        robot.renew_lease()
    except Uncontrolled:
        refused = True
    bench.require(
        refused or bench.caps.reports_controller,
        f"a person {done}, and renew_lease() raises no Uncontrolled, though samples do not say who is in charge: "
        "nobody learns that the robot is not SOTER's any more, and it drives on at once when it is given back",
    )
    # A goal in force, and one that is new.
    for _ in range(2):
        before = bench.true_place(robot)
        bench.run(_SEIZED_S)
        state, moved_m = robot.read_state(), math.dist(before, bench.true_place(robot))
        bench.require(
            moved_m <= bench.still_m and state.controller is None,
            f"a person {done}, and it moves by {moved_m:.2f} m, while the {state.controller or 'nobody'} is said to be "
            "in charge: the adapter takes it back by itself, or does not see that it has lost it",
        )
        robot.goto(bench.place(robot, -0.5), Controller.AC)


@clause("authority.intruded", tier=Tier.WIRE)
def intruded(bench: Bench) -> None:
    """While another program moves a robot past SOTER its renew_lease() raises Intruder; later the robot obeys again."""
    bench.require_hook("intrude")
    robot = bench.open_one()
    for turns in (False, True):
        _see_it_noticed(bench, robot, turns)


def _see_it_noticed(bench: Bench, robot: Robot, turns: bool) -> None:
    """Judge a robot that another program drives, or only turns."""
    moves, what = ("turns", "that only turns it") if turns else ("moves", "that drives it")
    bench.faulty = True
    bench.harness.intrude(robot.id, _NOTICED_S + _INTRUDED_S, turns)
    bench.run(_NOTICED_S, renew=False)
    raised = renewed = 0

    def try_to_renew() -> bool:
        nonlocal raised, renewed
        try:
            robot.renew_lease()
            renewed += 1
        except Intruder:
            raised += 1
        return False

    bench.run(_INTRUDED_S - 0.5, try_to_renew, renew=False)
    bench.require(
        renewed <= raised / _RAISED_TIMES,
        f"another program {moves} the robot past its supervisor, and {renewed} of {renewed + raised} calls of "
        "renew_lease() renew the lease: nobody learns that the robot is not SOTER's; raise Intruder as long as that "
        "program goes on, by the clock that it was heard by",
    )
    bench.run(0.5 + _NOTICED_S, renew=False)
    bench.go(robot, bench.place(robot, 0.5), cause=f"another program {what} is gone, and it obeys no more")


def _renews(robot: Robot) -> bool:
    with suppress(SoterError):
        robot.renew_lease()
    return False


def _keep_out(bench: Bench, robot: Robot) -> None:
    """Judge whether a second program can take away an idle robot whose lease is renewed."""
    cause = "with no goal under way renew_lease() does not renew the lease; it must, whatever is under way"
    bench.get_going(robot, bench.place(robot, 0.9)).cancel()
    for done in ("cancelled its goal", "handed over, and sent no goal"):
        bench.run(bench.orphaned_s() + TICK_S)
        with bench.harness.second() as fleet:
            _intrude(bench, robot, fleet.robots[0], f", which had {done}", cause)
        robot.switch_ac_sc(Controller.SC, "conformance")
    robot.switch_ac_sc(Controller.AC, "conformance")


def _intrude(bench: Bench, mine: Robot, other: Robot, done: str, cause: str) -> None:
    """Let a second program try all calls on a robot at rest, while the first one renews its lease."""

    def tell() -> bool:
        with suppress(SoterError):
            other.switch_ac_sc(Controller.AC, "a second program")
            # More calls than the first program made, so that a sequence number is not refused as too low.
            for _ in range(_MANY_TIMES):
                other.goto(bench.place(mine, -0.8), Controller.AC)
        return False

    before = bench.look(mine)
    _get_ready(bench, other, renew=True)
    bench.run(2.0, tell)
    after = bench.look(mine)
    moved_m, turned_rad = after.distance_m(before.x_m, before.y_m), abs(turn(before.heading_rad, after.heading_rad))
    bench.require(
        moved_m <= bench.still_m + 2.0 * bench.near_m and turned_rad <= bench.still_rad,
        f"a second program moved the robot by {moved_m:.2f} m and turned it by {turned_rad:.2f} rad while the lease of "
        f"the first one lived{done}: {cause}",
    )


def _get_ready(bench: Bench, other: Robot, *, renew: bool) -> None:
    """Let a second program try to get ready; `renew` says whether the first one's leases are renewed meanwhile."""
    # In a thread, since it may have to wait while the first program goes on.
    done = Event()

    def get_ready() -> None:
        with suppress(SoterError):
            other.init(_READY_S)
        done.set()

    if bench.fleet.clock is other.clock:
        get_ready()
    else:
        Thread(target=get_ready, daemon=True).start()
    bench.run(2.5 * _READY_S, done.is_set, renew=renew)
