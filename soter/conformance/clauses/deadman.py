"""Dead man: motion lives on a lease that only its renewal renews."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import CRUISE_S, fit_stop, turn
from soter.errors import Unsupported
from soter.sdk import Controller, Goal, Robot, Waypoint

_MOVING_SHARE = 0.4
_TURNED_RAD = 0.4
_TURN_ENDS_S = 0.25
_LEFT_M = 0.05
_FIRST_S = 1.0
_STAYS_S = 70.0
"""Longer than a counter of milliseconds in 16 bits lasts."""

_RESTS_S = 25.0
"""Together with the rest before it, longer than most vehicles wait until they sleep."""

_RESUMES_S = 3.0
_RESUMED_SHARE = 0.5
_SLOW = 0.25
_LEFT_S = 0.2
_STALL_SHARE = 0.3
_HANGS_S = 3.0
_OLD_S = 0.5
_WAYS: tuple[tuple[str, Callable[[Robot, Goal], object], bool], ...] = (
    ("a cancel", lambda _, goal: goal.cancel(), True),
    ("a switch", lambda robot, _: robot.switch_ac_sc(Controller.SC, "conformance"), True),
    ("the last renewal of its lease", lambda robot, _: robot.renew_lease(), False),
)
RENEWED = "; only renew_lease() and switch_ac_sc() may renew it"


@clause("deadman.silence", truth=True)
def silence(bench: Bench) -> None:
    """When SOTER falls silent, the robot stops within the lease."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    called_s = bench.now_s
    caps = bench.caps
    allowed_s = bench.orphaned_s()
    before = bench.look(robot)
    clock = bench.fleet.clock
    clock.sleep_until(called_s + allowed_s + caps.sample_age_s)
    first = bench.look(robot)
    clock.sleep_until(clock.now() + TICK_S)
    rest = bench.look(robot)
    jumped = rest.distance_m(first.x_m, first.y_m)
    bench.require(
        jumped <= 2.0 * caps.v_max_m_s * TICK_S + bench.still_m,
        f"from the first sample after a pause to the next one it moved by {jumped:.3f} m, farther than it can drive: "
        "each read hands out the sample that was due at the one before; take the newest when it is read",
    )
    clock.sleep_until(clock.now() + 1.0)
    later = bench.look(robot)
    slipped = later.distance_m(rest.x_m, rest.y_m)
    bench.require(
        slipped <= bench.held_m,
        f"{allowed_s:.2f} s after the last call it still moves, {slipped:.3f} m within another second: the last "
        "set-point is repeated for ever, or a timer or thread renews the lease" + RENEWED,
    )
    allowed_m = caps.v_max_m_s * (allowed_s + caps.sample_age_s)
    bench.measure(
        "silent_run_m", rest.distance_m(before.x_m, before.y_m), allowed_m, bench.still_m, "the lease lives too long"
    )


@clause("deadman.first")
def first(bench: Bench) -> None:
    """Before its lease is renewed for the first time a robot moves for no goal."""
    (robot,) = bench.open_raw().robots
    robot.init(bench.harness.connect_timeout_s)
    bench.capabilities = robot.capabilities
    # A robot that the kit did not start stands where it was left; others must not leave their start to get ready.
    at = robot.spec if bench.harness.starts_robots else bench.look(robot)
    bench.run(2 * TICK_S, renew=False)
    robot.goto(bench.place(robot, 0.8), robot.in_charge)
    bench.run(bench.caps.latency_s + TICK_S, renew=False)
    bench.run(_FIRST_S, renew=False)
    moved_m = bench.look(robot).distance_m(at.x_m, at.y_m)
    bench.require(
        moved_m <= bench.still_m + bench.caps.position_noise_m,
        f"it went {moved_m:.2f} m before its lease was renewed for the first time: there is none until then, or init() "
        f"or goto() renews it{RENEWED}",
    )


@clause("deadman.stays")
def stays(bench: Bench) -> None:
    """When its lease has ended a robot stays where it is; a switch revives nothing, and long after that it obeys."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    bench.run(bench.orphaned_s() + TICK_S + bench.caps.sample_age_s, renew=False)
    rest = bench.true_place(robot)
    clock, ends_s = bench.fleet.clock, bench.now_s + _STAYS_S
    while bench.now_s < ends_s:
        clock.sleep_until(bench.now_s + 1.0)
        moved_m = math.dist(rest, bench.true_place(robot))
        bench.require(
            moved_m <= bench.still_m,
            f"it stood when its lease had ended, and moved by {moved_m:.2f} m within the next "
            f"{_STAYS_S - (ends_s - bench.now_s):.0f} s without a renewal: the vehicle's own fail-safe drives it home, "
            "what it was told comes back, or a count of too few digits of how old its lease is begins anew",
        )
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.run(bench.caps.latency_s + 2 * TICK_S)
    bench.expect_still(
        robot, _RESTS_S,
        "a switch is lost where the lease is long dead: the renewal behind it resumes what was interrupted",
    )  # fmt: skip
    bench.go(
        robot, bench.place(robot, -0.4), Controller.SC,
        cause=f"after {_STAYS_S + _RESTS_S:.0f} s of rest it takes no goal: it has gone to sleep, or was disarmed for "
        "having nothing to do, and neither a renewal nor a goto wakes it up",
    )  # fmt: skip


@clause("deadman.reading", truth=True)
def reading(bench: Bench) -> None:
    """Reading the state does not renew the lease."""
    robot = bench.open_one()
    for ahead, cap_m_s, cause in (
        (0.9, None, "read_state() renews the lease" + RENEWED),
        (-0.9, _SLOW * bench.caps.v_max_m_s, "the lease does not count at a low speed, or the second time"),
    ):
        bench.get_going(robot, bench.place(robot, ahead)._replace(speed_m_s=cap_m_s))
        bench.expect_stop(robot, cause, extra_s=bench.caps.lease_s, renew=False)


def _renews_nothing(bench: Bench, robot: Robot, call: Callable[[], object], what: str) -> None:
    """Fail the clause unless a robot without renewals stops and stays, whatever else is sent at every tick."""

    def tell() -> bool:
        call()
        return False

    allowed_s = bench.orphaned_s() + TICK_S
    bench.run(allowed_s + bench.caps.sample_age_s, tell, renew=False)
    rest = bench.look(robot)
    bench.run(0.5, tell, renew=False)
    later = bench.look(robot)
    slipped = later.distance_m(rest.x_m, rest.y_m)
    bench.require(
        slipped <= bench.held_m,
        f"{allowed_s:.2f} s after the last renewal it still moves while {what}, {slipped:.3f} m within half a second: "
        f"what is no renewal renews the lease{RENEWED}",
    )


@clause("deadman.goto", truth=True)
def goto(bench: Bench) -> None:
    """A goto does not renew the lease, however many are sent."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    _renews_nothing(
        bench, robot, lambda: robot.goto(bench.place(robot, 0.9), Controller.AC),
        "gotos are sent (goto() renews the lease, so that a runaway controller keeps itself alive)",
    )  # fmt: skip


@clause("deadman.cancel", truth=True)
def cancel(bench: Bench) -> None:
    """A cancel does not renew the lease, however many are sent."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))

    def again() -> None:
        nonlocal goal
        goal.cancel()
        goal = robot.goto(bench.place(robot, 0.9), Controller.AC)

    _renews_nothing(bench, robot, again, "goals are cancelled and sent anew (a cancel renews the lease)")


@clause("deadman.hand_over", truth=True)
def hand_over(bench: Bench) -> None:
    """A hand-over renews the lease for lease_s, by the renewal that goes with it; one that is sent again does not."""
    robot = bench.open_one()
    for old, to, ahead in ((Controller.AC, Controller.SC, 0.9), (Controller.SC, Controller.AC, -0.9)):
        _see_lease_end(bench, robot, old, to, bench.place(robot, ahead))
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.get_going(robot, bench.place(robot, 0.9))

    def again() -> None:
        robot.hand_over_again()
        robot.goto(bench.place(robot, 0.9), Controller.AC)

    _renews_nothing(bench, robot, again, "hand-overs are sent again (_hand_over() renews the lease)")


def _see_lease_end(bench: Bench, robot: Robot, old: Controller, to: Controller, target: Waypoint) -> None:
    """Judge whether a robot that drives on for a new controller stops when nothing is renewed after the hand-over."""
    caps = bench.caps
    robot.switch_ac_sc(old, "conformance")
    bench.run(caps.latency_s + 2 * TICK_S)
    bench.get_going(robot, target, old, closely=True)
    bench.keep_on()
    called_s = bench.now_s
    robot.switch_ac_sc(to, "conformance")
    robot.goto(target, to)
    bench.run(bench.orphaned_s() + 1.5 * bench.brakes_s + caps.sample_age_s + CRUISE_S, renew=False, closely=True)
    end = fit_stop(bench.tracks[robot.id], called_s)
    # A host that paused for longer than the lease has stopped the robot before.
    if end is not None:
        bench.ramps.append(end)
        bench.measure(
            "lease_handed_s", end.begins_s, caps.lease_s + caps.latency_s + caps.jitter_s, bench.fit_s,
            f"after a hand-over to the {to}, and a goto, the lease is longer than otherwise: the new controller is "
            f"given time to begin{RENEWED}",
        )  # fmt: skip


@clause("deadman.stalled", tier=Tier.WIRE)
def stalled(bench: Bench) -> None:
    """A robot whose program stands still stops when its lease ends, and nobody is said to be in charge of it."""
    bench.require_hook("stall")
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, -0.8))
    bench.get_going(robot, bench.place(robot, 0.9))
    stands_s = bench.orphaned_s() + _STALL_SHARE * bench.harness.room_m / bench.caps.v_max_m_s
    before, bench.faulty = bench.true_place(robot), True
    bench.harness.stall(robot.id, stands_s)
    bench.run(stands_s + 1.0, renew=False)
    bench.measure(
        "stalled_run_m", math.dist(before, bench.true_place(robot)),
        bench.caps.v_max_m_s * (bench.orphaned_s() + bench.caps.sample_age_s), bench.still_m,
        f"while what hears and talks for the robot stood still for {stands_s:.1f} s it drove on, lease or not: ask in "
        "the loop that drives whether the lease lives",
    )  # fmt: skip
    bench.harness.stall(robot.id, _HANGS_S)
    bench.run(_HANGS_S - 2.0 * TICK_S)
    state = robot.read_state()
    bench.require(
        state.controller is None or state.age_s(bench.now_s) > bench.caps.sample_age_s + _OLD_S,
        f"what hears and talks for the robot has stood still for {_HANGS_S:g} s, and the {state.controller} is said to "
        "be in charge: what was reported last counts for ever, or for as long as something is sent; forget it once "
        "nothing has been answered for a while",
    )


@clause("deadman.turning", needs=("pivots_first",))
def turning(bench: Bench) -> None:
    """A robot that turns in place, first or last, ends that, too, at a cancel, at a switch and when its lease ends."""
    for what, call, renew in _WAYS:
        robot = bench.open_one()
        # A target behind the robot takes half a turn; so does a heading to the rear at its own place.
        _see_turn_end(bench, robot, bench.place(robot, -0.8), what, call, renew=renew)
        robot.switch_ac_sc(Controller.AC, "conformance")
        bench.run(bench.orphaned_s())
        at = bench.look(robot)
        with suppress(Unsupported):
            there = Waypoint(at.x_m, at.y_m, heading_rad=turn(math.pi, at.heading_rad))
            _see_turn_end(bench, robot, there, f"{what} at its target", call, renew=renew)
        bench.close()


def _see_turn_end(
    bench: Bench, robot: Robot, target: Waypoint, what: str, call: Callable[[Robot, Goal], object], *, renew: bool
) -> None:
    """Judge whether a robot that turns in place for a target stops turning when it is told to."""
    caps, began = bench.caps, bench.look(robot)
    goal = robot.goto(target, robot.in_charge)
    turns = bench.run(
        bench.way_s(),
        lambda: abs(turn(began.heading_rad, bench.tracks[robot.id][-1].heading_rad)) > _TURNED_RAD,
    )
    bench.require(turns, "it does not turn to a target behind it, although pivots_first is declared")
    at = bench.look(robot)
    call(robot, goal)
    begin_s = (0.0 if renew else caps.lease_s) + caps.latency_s + caps.jitter_s + caps.setpoint_period_s + TICK_S
    bench.run(begin_s + 2.0 * _TURN_ENDS_S + caps.sample_age_s, renew=renew)
    bench.measure(
        "turned_on_rad", abs(turn(at.heading_rad, bench.look(robot).heading_rad)),
        caps.yaw_rate_max_rad_s * (begin_s + caps.sample_age_s + _TURN_ENDS_S), bench.still_rad,
        f"after {what} it goes on to turn: what it is told waits until the turn is done",
    )  # fmt: skip


@clause("deadman.arriving", truth=True)
def arriving(bench: Bench) -> None:
    """Near its target, too, a robot stops at a cancel, at a switch and when its lease ends."""
    for number, (what, call, renew) in enumerate(reversed(_WAYS), start=1):
        robot, caps = bench.open_one(), bench.caps
        begin_s = (0.0 if renew else caps.lease_s) + caps.latency_s + caps.jitter_s + caps.setpoint_period_s + TICK_S
        run_m = caps.v_max_m_s * (begin_s + caps.sample_age_s) + caps.v_max_m_s**2 / (2.0 * caps.brake_m_s2)
        left_m = _LEFT_M + _LEFT_S * caps.v_max_m_s
        target = bench.place(robot, 0.8, radius_m=0.5 * _LEFT_M)
        goal = bench.get_going(robot, target)
        x_m, y_m = target.x_m, target.y_m
        bench.run(
            bench.way_s(),
            lambda robot=robot, x_m=x_m, y_m=y_m, near_m=run_m + left_m: (  # type: ignore[misc]
                bench.tracks[robot.id][-1].distance_m(x_m, y_m) <= near_m
            ),
        )
        call(robot, goal)
        bench.run(begin_s + bench.brakes_s + 1.0, renew=renew)
        bench.measure(
            "left_m", bench.look(robot).distance_m(x_m, y_m), left_m - caps.v_max_m_s * TICK_S - caps.overshoot_m,
            bench.still_m, at_least=True,
            cause=f"after {what} near its target it goes on to it: what was begun is ended first, as in docking",
        )  # fmt: skip
        bench.close()
        if number == bench.trials(len(_WAYS)):
            return


@clause("deadman.kept_alive")
def kept_alive(bench: Bench) -> None:
    """While the lease is renewed each tick the robot does not stop."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))
    began_s = bench.now_s
    # Beyond the distance at which it may begin to brake for the target.
    far_m = 0.3 * bench.harness.room_m / 2.0
    bench.run(
        bench.way_s(),
        lambda: bench.tracks[robot.id][-1].distance_m(goal.target.x_m, goal.target.y_m) < far_m or not goal.active,
    )
    seen = bench.since(robot, began_s)
    slowest = min(sample.speed_m_s for sample in seen)
    bench.require(
        slowest > _MOVING_SHARE * bench.caps.v_max_m_s,
        f"with the lease renewed every {TICK_S:g} s the robot slowed down to {slowest:.2f} m/s on the way: renewals do "
        "not get through, or the lease is shorter than declared",
    )


@clause("deadman.recovers")
def recovers(bench: Bench) -> None:
    """After the lease has died, renewing it makes the robot obey again, and stop when it dies again."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.8))
    bench.run(bench.caps.lease_s + bench.caps.latency_s + 1.0, renew=False)
    fast_m_s = _RESUMED_SHARE * bench.caps.v_max_m_s
    # What it was told holds on, and nothing else is sent.
    if bench.run(_RESUMES_S, lambda: bench.tracks[robot.id][-1].speed_m_s > fast_m_s):
        bench.expect_stop(
            robot, "the second time that its lease ends on the way to one goal nobody notices: what stops it works "
            "once, and is armed by a goto, not by a renewal", extra_s=bench.caps.lease_s, renew=False,
        )  # fmt: skip
    goal = robot.goto(bench.place(robot, 0.2, 0.3), Controller.AC)
    bench.arrive(goal, "a robot whose lease has died must obey again once it is renewed")
