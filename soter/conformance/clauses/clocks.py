"""Clocks: a lease ends, and the robot obeys again, whatever the vehicle's own clock does."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from statistics import median

from soter.conformance.bench import SETTLE_S, Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.track import TURNING_RAD_S, turn
from soter.sdk import Controller, Link, Robot, RobotState

LEARNS_S = 3.0
_BEGINS_ANEW_S = 0.5
_STEP_AGE_S = 0.1
_CHARGE = 0.02
_OFF_RAD = 0.1
_AWAY = 0.1
_TURNS_S, _DRIFTS_S = 1.0, 8.0
_EVEN = 0.85
_SLOW = 0.2
_COUNTED_S, _SELDOM = 2.0, 0.4
# Vehicle times at whose multiples a counter of few digits or bits wraps, and the counter.
_SOON = ((60.0, "the seconds of a minute"), (65.536, "milliseconds in 16 bits"))
# The same for clocks that can be set: both at once, and a counter that wraps only after an hour or fifty days.
_LATER = (
    (4294967.296, "milliseconds in 32 bits, or microseconds"),
    (491520.0, "the seconds of a minute, or milliseconds in 16 bits"),
)

_SET_FORWARD = {
    True: "its clock was set forward, and it does not obey since: leases and stamps are said by a clock that it no "
    "longer has, or in too few digits",
    False: "nothing is heard of it since its clock was set forward: samples are dropped whose stamps are far ahead of "
    "those before, as if they were garbled; a clock may be set at any time, so believe it once it goes on from there",
}
"""By whether the robot is heard since then, why it may not obey."""


def _silent_after(bench: Bench, change: Callable[[Robot], None], what: str) -> Robot:
    """Fail the clause unless a robot that hears nothing more after a fault of its clock stops; return the robot."""
    robot = bench.open_one()
    bench.faulty = True
    bench.get_going(robot, bench.place(robot, 0.9))
    # Away from the start, so that odometry that begins anew there shows.
    bench.run(_AWAY * bench.harness.room_m / bench.caps.v_max_m_s)
    clock = bench.fleet.clock
    # By then the last renewal has arrived, and is still valid.
    clock.sleep_until(clock.now() + min(bench.caps.latency_s, 0.5 * bench.caps.lease_s))
    change(robot)
    clock.sleep_until(clock.now() + bench.orphaned_s() + bench.caps.sample_age_s)
    before = bench.true_place(robot)
    clock.sleep_until(clock.now() + 1.0)
    slipped = math.dist(before, bench.true_place(robot))
    bench.require(
        slipped <= bench.still_m,
        f"{what} and nothing renews its lease any more, but it drives on, {slipped:.3f} m within a second: a lease "
        "must end when the clock that it is counted by goes back or stands still; count it by steady time",
    )
    return robot


@clause("deadman.clock_back", tier=Tier.WIRE)
def clock_back(bench: Bench) -> None:
    """A vehicle's clock that steps back does not prolong the lease."""
    bench.require_hook("step_clock")
    _silent_after(
        bench, lambda robot: bench.harness.step_clock(robot.id, -30.0), "the vehicle's clock went back by 30 s"
    )


@clause("deadman.clock_stands", tier=Tier.WIRE)
def clock_stands(bench: Bench) -> None:
    """A vehicle's clock that stands still does not prolong the lease."""
    bench.require_hook("stop_clock")
    _silent_after(bench, lambda robot: bench.harness.stop_clock(robot.id), "the vehicle's clock stands still")


@clause("deadman.wraps")
def wraps(bench: Bench) -> None:
    """A lease ends, and samples stay fresh, while a clock or counter of few digits begins anew."""
    robot = bench.open_one()
    if not bench.caps.in_process:
        bench.require_hook("step_clock")
    for every_s, what in _SOON if bench.caps.in_process else _LATER:
        _see_it_wrap(bench, robot, every_s, what)


def _see_it_wrap(bench: Bench, robot: Robot, every_s: float, what: str) -> None:
    """Judge whether a robot stops whose last renewal comes just before its clock shows a multiple of `every_s`."""
    caps, clock = bench.caps, bench.fleet.clock
    # How long before that time a leg may begin without ending too soon.
    room_m, gains_s = bench.harness.room_m, bench.gains_s
    even_s = min(0.25 * room_m / caps.v_max_m_s, 0.4 * room_m / caps.v_max_m_s - 0.5 * gains_s)
    leg_s = even_s + gains_s
    soon_s = LEARNS_S + 2.0 * leg_s
    state, wraps_s = robot.read_state(), 0.0
    if not caps.in_process:
        shown_s, wraps_s = state.vehicle_stamp_s + soon_s, state.stamp_s + soon_s
        bench.faulty = True
        bench.harness.step_clock(robot.id, math.ceil(shown_s / every_s) * every_s - shown_s)
        bench.run(LEARNS_S)
    heard = robot.read_state().link is Link.UP
    bench.go(robot, bench.place(robot, 0.0), cause="" if caps.in_process else _SET_FORWARD[heard])
    if caps.in_process:
        state = robot.read_state()
        wraps_s = math.ceil(state.vehicle_stamp_s / every_s) * every_s + state.stamp_s - state.vehicle_stamp_s
    bench.run(wraps_s - leg_s - bench.now_s)
    ahead = bench.place(robot, 0.9)
    bench.get_going(
        robot, ahead, cause="" if caps.in_process else "the target did not get through, or renewals next to a multiple "
        f"of {every_s:g} s are said in too few digits",
    )  # fmt: skip
    last_s = wraps_s - 0.5 * caps.lease_s
    bench.run(last_s - TICK_S - bench.now_s)
    seen = bench.since(robot, last_s - 0.5 * even_s)
    slow = sum(each.speed_m_s < _EVEN * caps.v_max_m_s for each in seen) / max(len(seen), 1)
    bench.require(
        slow <= _SLOW,
        f"while its clock shows next to a multiple of {every_s:g} s it stops and goes, though its lease is renewed: "
        "renewals are said in too few digits for so large a time, such as a float of 32 bits",
    )
    gap_s = median([after.at_s - before.at_s for before, after in pairwise(seen)] or [math.inf])
    bench.require(
        gap_s <= caps.sample_age_s + _STEP_AGE_S,
        f"while its clock shows next to a multiple of {every_s:g} s its stamps go by {gap_s:.2f} s: they have too few "
        "digits for so large a time, such as a float of 32 bits",
    )
    clock.sleep_until(last_s)
    robot.renew_lease()
    clock.sleep_until(last_s + bench.orphaned_s() + caps.sample_age_s)
    before, state = bench.true_place(robot), robot.read_state()
    clock.sleep_until(clock.now() + 1.0)
    slipped = math.dist(before, bench.true_place(robot))
    bench.require(
        slipped <= bench.still_m,
        f"nothing has renewed its lease since just before its clock showed a multiple of {every_s:g} s, but it drives "
        f"on, {slipped:.3f} m within a second: the lease is counted by {what}, which began anew",
    )
    said_s = bench.now_s - 1.0 - state.stamp_s
    bench.require(
        said_s <= caps.sample_age_s + _STEP_AGE_S,
        f"after its clock has shown a multiple of {every_s:g} s the sample is said to be {said_s:.1f} s old: stamps "
        f"are {what}, which began anew, and what comes after that is dropped as older",
    )
    # Another clause judges whether a goto is dropped while the lease is dead; here, wait until the robot acts.
    bench.run(caps.latency_s + 2 * TICK_S)
    bench.go(
        robot, bench.place(robot, -0.3),
        cause=f"the robot does not obey since its clock showed a multiple of {every_s:g} s: renewals carry {what}, "
        "which began anew",
    )  # fmt: skip


@clause("deadman.clock_steps", tier=Tier.WIRE)
def clock_steps(bench: Bench) -> None:
    """After a step of the vehicle's clock, back or forth, samples are as fresh and charged as before, and it obeys."""
    bench.require_hook("step_clock")
    robot = bench.open_one()
    for number, seconds in enumerate((-30.0, 3600.0, -0.5)):
        bench.faulty = True
        before, began_s = robot.read_state().battery, bench.now_s
        bench.harness.step_clock(robot.id, seconds)
        bench.run(LEARNS_S)
        charges = [each.state.battery for each in bench.since(robot, began_s) if each.state.battery is not None]
        most = _CHARGE + LEARNS_S / min(robot.spec.drive_s, robot.spec.charge_s)
        said = max(charges, key=lambda each: abs(each - (before or 0.0)), default=before)
        bench.require(
            before is None or said is None or abs(said - before) <= most,
            f"the vehicle's clock stepped by {seconds:+g} s, and its charge is said to be {said:.2f} then, after "
            f"{before or 0.0:.2f}: a report is aged by a clock that was set since; age it by steady time",
        )
        age_s = robot.read_state().age_s(bench.now_s)
        bench.require(
            age_s <= bench.caps.sample_age_s + _STEP_AGE_S,
            f"{LEARNS_S:.0f} s after the vehicle's clock stepped by {seconds:+g} s the sample is said to be "
            f"{age_s:.2f} s old: a clock that goes another way, if only a little, has to be learned anew",
        )
        bench.go(
            robot, bench.place(robot, 0.3 if number % 2 else -0.3),
            cause=f"after its clock stepped by {seconds:+g} s the robot does not obey: leases are said by a clock "
            "that it no longer has",
        )  # fmt: skip


@clause("deadman.restart", tier=Tier.WIRE)
def restart(bench: Bench) -> None:
    """A vehicle that restarts has forgotten its lease, and obeys again once it is told to; no other notices."""
    bench.require_hook("restart")
    said: list[RobotState] = []

    def start_anew(robot: Robot) -> None:
        said.append(robot.read_state())
        bench.harness.restart(robot.id)

    robot = _silent_after(bench, start_anew, "the vehicle has restarted")
    bench.run(LEARNS_S)
    before, now = said[0].battery, robot.read_state()
    _has_restarted(bench, said[0], now)
    rises = (now.stamp_s - said[0].stamp_s) / robot.spec.charge_s
    bench.require(
        before is None or (now.battery is not None and abs(now.battery - before) <= _CHARGE + rises),
        f"before it restarted the charge was said to be {before}, and now {now.battery}: its gauge begins anew with a "
        "guess",
    )
    known = bench.fleet.truth is not None or bench.harness.gives("observe")
    x_m, y_m, heading_rad = bench.true_pose(robot.id) if known else (said[0].x_m, said[0].y_m, said[0].heading_rad)
    off_m, off_rad = math.dist((now.x_m, now.y_m), (x_m, y_m)), abs(turn(heading_rad, now.heading_rad))
    rolled_m = 0.0 if known else bench.caps.v_max_m_s * bench.orphaned_s()
    bench.require(
        off_m <= bench.caps.position_noise_m + bench.still_m + rolled_m and off_rad <= _OFF_RAD,
        f"after the restart its samples put it {off_m:.2f} m and {off_rad:.2f} rad from where it "
        f"{'really is' if known else 'was'}: its odometry begins anew, at 0 or where it was set up first",
    )
    for to in (Controller.SC, Controller.AC):
        robot.switch_ac_sc(to, "conformance")
        bench.run(bench.caps.latency_s + 2 * TICK_S)
    deaf = "after a restart the robot does not obey any more"
    # At once, and later.
    for ahead in (-0.9, 0.9):
        bench.get_going(robot, bench.place(robot, ahead), cause=deaf)
        bench.expect_stop(
            robot, "after a restart its lease is longer than lease_s: what was set is lost with the power, or counts "
            "only once it has been on for a while", extra_s=bench.caps.lease_s, renew=False,
        )  # fmt: skip
        bench.go(robot, bench.place(robot, 0.0), cause=deaf)
        bench.settle()
    if known:
        _keeps_its_heading(bench, robot)
    _costs_the_other_nothing(bench)


def _keeps_its_heading(bench: Bench, robot: Robot) -> None:
    """Judge the heading of a robot that restarts while it turns."""
    to = turn(0.0, bench.look(robot).heading_rad - bench.home(robot)[2])
    goal = robot.goto(bench.place(robot, -0.5 * math.cos(to), -0.5 * math.sin(to)), Controller.AC)
    bench.run(bench.caps.latency_s + _TURNS_S, lambda: abs(bench.look(robot).yaw_rate_rad_s) > TURNING_RAD_S)
    bench.harness.restart(robot.id)
    # An adapter may say its goal again to a robot that is back: it would turn on while its heading is compared.
    goal.cancel()
    bench.run(LEARNS_S)
    off_rad = [bench.heading_off_rad(robot)]
    bench.run(_DRIFTS_S)
    off_rad.append(bench.heading_off_rad(robot))
    drift_rad = abs(turn(*off_rad))
    bench.require(
        drift_rad <= bench.still_rad,
        f"it restarted in a turn, and while it stood since the heading that it says moved by {drift_rad:.2f} rad in "
        f"{_DRIFTS_S:.0f} s from the one that it has: a gyro whose bias is measured as it is switched on, and which "
        "was not at rest then",
    )
    for by in (Controller.SC, Controller.AC):
        robot.switch_ac_sc(by, "conformance")
        bench.run(bench.caps.latency_s + 2 * TICK_S)


def _has_restarted(bench: Bench, before: RobotState, now: RobotState) -> None:
    """Fail the clause unless samples go on as often, with a clock that has begun anew between two of them."""
    age_s = now.age_s(bench.now_s)
    is_late = age_s > bench.caps.sample_age_s + _STEP_AGE_S
    least = _SELDOM * (often := _a_second(bench, now.robot_id, before.stamp_s))
    if is_late or _a_second(bench, now.robot_id, bench.now_s) < least:
        # Where they come seldom it takes long to learn the clock that has begun anew; or it was back late.
        bench.run(2.0 * _COUNTED_S)
    seldom = _a_second(bench, now.robot_id, bench.now_s)
    bench.require(
        not 0.0 < seldom < least,
        f"since the restart {seldom:g} samples come in a second, and before it {often:g} did: what was asked of the "
        "vehicle, such as how often it says what, is lost with the power; ask again",
    )
    bench.require(
        not is_late,
        f"{LEARNS_S:.0f} s after the restart the sample is said to be {age_s:.1f} s old: the vehicle's clock has "
        "begun anew, and what it stamps is dropped as older than what came before, or dated by the old clock, which it "
        "still has the name of; or the vehicle takes whatever it is told for older than what it was told before",
    )
    went_on_s = now.vehicle_stamp_s - before.vehicle_stamp_s
    bench.require(
        abs(went_on_s - (now.stamp_s - before.stamp_s)) > _BEGINS_ANEW_S,
        f"the hook 'restart' was called, and the vehicle's clock went on by {went_on_s:.1f} s as if nothing had been: "
        "the vehicle refuses to restart, or vehicle_stamp_s is by another clock than its own",
    )


def _a_second(bench: Bench, robot_id: int, until_s: float) -> float:
    """Return how many different samples of a robot came in a second up to a moment."""
    seen = {each.state.stamp_s for each in bench.tracks[robot_id] if 0.0 <= until_s - each.at_s < _COUNTED_S}
    return len(seen) / _COUNTED_S


def _costs_the_other_nothing(bench: Bench) -> None:
    """Judge whether a robot drives on evenly while another one restarts."""
    bench.close()
    robots = bench.open(2)
    bench.faulty = True
    for kept, anew in (robots, robots[::-1]):
        bench.get_going(kept, bench.place(kept, 0.9))
        began_s = bench.now_s
        bench.harness.restart(anew.id)
        bench.run(min(LEARNS_S, 0.25 * bench.harness.room_m / bench.caps.v_max_m_s))
        seen = bench.since(kept, began_s)
        slow = sum(each.speed_m_s < _EVEN * bench.caps.v_max_m_s for each in seen) / max(len(seen), 1)
        bench.require(
            slow <= _SLOW,
            f"while robot {anew.id} restarted robot {kept.id} did not drive on as before: what is noted of the restart "
            "of one, such as that it has to be made ready again, counts for all",
        )
        bench.go(kept, bench.place(kept, 0.0))
        bench.run(LEARNS_S)


@clause("deadman.off_and_on")
def off_and_on(bench: Bench) -> None:
    """A robot that fault injection can switch off stops then; on again it has forgotten its goal, and obeys."""
    robot = bench.open_one()
    impair = getattr(robot, "impair", None)
    # Over a wire the adapter goes on to say where the robot is to go, and a robot that has forgotten it hears it anew.
    if impair is None or not bench.caps.in_process:
        raise NotTested("not declared: the hook 'impair' of a robot in process")
    for by, ahead in ((Controller.AC, 0.9), (Controller.SC, -0.9)):
        robot.switch_ac_sc(by, "conformance")
        bench.get_going(robot, bench.place(robot, ahead), by)
        bench.faulty = True
        impair(1.0, 1.0, 1.0, False)
        bench.expect_stop(robot, "its motors are off, and it drives on")
        impair(1.0, 1.0, 1.0, True)
        bench.run(bench.caps.latency_s + 2 * TICK_S)
        bench.expect_still(
            robot, SETTLE_S, f"it has been switched off and on, and the goal of the {by} comes back as soon as its "
            "lease is renewed: what it was told outlives the power, as in a flash",
        )  # fmt: skip
        state = bench.look(robot).state
        bench.require(
            state.controller in (Controller.SC, None) and state.goal_id is None,
            f"it has been switched off and on, and says that the {state.controller} is in charge and that it works on "
            f"goal {state.goal_id}: it forgets both with the power, and the SC is in charge then",
        )
        robot.hand_over_again()
        bench.go(robot, bench.place(robot, 0.0), by, cause="switched off and on, it does not obey any more")
        bench.settle()


@clause("deadman.late", tier=Tier.WIRE, hooks=("delay",))
def late(bench: Bench) -> None:
    """A renewal that waited in some buffer for longer than the lease renews nothing: the lease counts from its call."""
    robot = bench.open_one()
    # A clock of whole seconds, or of tenths, shows only where renewals are a little late.
    for leases in (2.0, 1.0):
        _stands_though_renewed(bench, robot, leases)
    if bench.harness.gives("restart"):
        before = robot.read_state()
        bench.harness.restart(robot.id)
        bench.run(LEARNS_S)
        _has_restarted(bench, before, robot.read_state())
        for to in (Controller.SC, Controller.AC):
            robot.switch_ac_sc(to, "conformance")
            bench.run(bench.caps.latency_s + 2 * TICK_S)
        _stands_though_renewed(bench, robot, 2.0, "since the vehicle has restarted ")


def _stands_though_renewed(bench: Bench, robot: Robot, leases: float, when: str = "") -> None:
    """Fail the clause unless a robot stands whose renewals arrive later than they are good for."""
    caps = bench.caps
    bench.faulty = True
    bench.get_going(robot, bench.place(robot, 0.9))
    late_s = leases * caps.lease_s + caps.latency_s + caps.jitter_s + 2 * TICK_S
    bench.harness.delay(late_s)
    # By then renewals sent in time have expired, and late ones have long been arriving.
    bench.run(2.0 * late_s + bench.orphaned_s())
    rest = bench.look(robot)
    bench.run(1.0)
    slipped = bench.look(robot).distance_m(rest.x_m, rest.y_m)
    bench.require(
        slipped <= bench.still_m,
        f"{when}every renewal arrives {late_s:.2f} s late, and the robot still drives, {slipped:.3f} m within a "
        "second: its lease counts from when a renewal arrives, or by a clock of too few digits or one that is no more; "
        "send with it when it was made, by the vehicle's clock",
    )
    bench.harness.delay(0.0)
    bench.run(late_s + bench.orphaned_s())
    bench.go(robot, bench.place(robot, 0.0), cause="after renewals that were late it does not obey any more")
