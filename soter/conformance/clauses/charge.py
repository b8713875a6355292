"""Charge: what a robot says is left in its battery."""

from __future__ import annotations

import math
from contextlib import suppress
from itertools import cycle, pairwise
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import ROUNDING
from soter.conformance.figure import NotTested
from soter.conformance.trials import ToAndFro
from soter.errors import RobotUnavailable
from soter.sdk import Controller, Link, Robot, RobotState, Truth, Waypoint

_PERCENT = 0.01
_ABOVE = 0.002
_ROUNDED = 0.016
_DRIVES_S = 10.0
_RESTS_S = 30.0
_ROUND_S, _LONG_ROUND_S = 40.0, 120.0
_SELDOM_S = 1.0
_CHARGES_S, _CHARGES_IN_PROCESS_S = 10.0, 40.0
_AWAY, _AHEAD_RAD = 0.6, 0.25
_FLAT = 0.002
"""A charge so low that it rounds to 0 per cent, which some adapters take for unknown."""

_NEARLY_FULL = 0.94
_CHARGES_FULL_S = 80.0
_FULL_S = 5.0
_EMPTIES_S = 30.0
_AROUND = 0.03
_LATE_S = 0.05
_TWICE = 2
_NOW_AND_THEN = 0.3
_TURNS = 0.15

_LAST = 1e-9
"""A charge so low that it is used up as soon as the robot moves."""


@clause("state.charge", needs=("reports_battery",))
def charge(bench: Bench) -> None:
    """The charge falls while the robot drives, no faster than declared, and rises while it is being charged."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, 0.8))
    began = bench.look(robot).state
    full_s = robot.spec.drive_s
    shuttle = ToAndFro(bench, robot)

    def fallen() -> bool:
        shuttle.go_on()
        return _charge(robot.read_state()) < _charge(began)

    bench.run(_DRIVES_S, shuttle.go_on)
    # A charge in whole percent changes once in a hundredth of this.
    fell = bench.run(2.5 * _PERCENT * full_s, fallen)
    driven_s = bench.now_s - began.stamp_s
    bench.require(
        fell,
        f"after {driven_s:.0f} s of driving the charge is still {_charge(began):.3f}: it is frozen, read seldom, or "
        f"made up; a robot goes from full to empty in {full_s:.0f} s",
    )
    fallen_by = _charge(began) - _charge(robot.read_state())
    bench.measure(
        "discharge", fallen_by, 1.05 * driven_s / full_s + _PERCENT, 1e-6,
        f"in {driven_s:.1f} s the charge fell by more than driving from full to empty in {full_s:.0f} s explains: "
        "it is rounded, or of another unit",
    )  # fmt: skip
    shuttle.goal.cancel()
    _never_jumps(bench, robot)
    _falls_evenly(bench, robot)
    if not bench.harness.charges_at_start:
        return
    bench.go(robot, bench.place(robot, 0.0, radius_m=bench.near_m))
    low = _charge(robot.read_state())
    # It may have to turn round first, to its middle.
    charges_s = bench.way_s() + 2.5 * _PERCENT * robot.spec.charge_s
    bench.run(charges_s, lambda: _charge(robot.read_state()) > low + ROUNDING)
    bench.require(
        _charge(robot.read_state()) > low,
        f"at rest on its charger the charge stays at {low:.3f}: it is frozen, or only ever falls",
    )
    _never_jumps(bench, robot)


def _never_jumps(bench: Bench, robot: Robot) -> None:
    """Fail the clause if the charge changed between two samples by more than driving or charging explains."""
    fastest_per_s = 1.0 / min(robot.spec.charge_s, robot.spec.drive_s)
    for first, second in pairwise(bench.tracks[robot.id]):
        by, passed_s = _charge(second.state) - _charge(first.state), second.at_s - first.at_s
        bench.require(
            abs(by) <= 2.0 * _PERCENT + 1.05 * fastest_per_s * passed_s,
            f"within {passed_s:.2f} s the charge went from {_charge(first.state):.3f} to {_charge(second.state):.3f}: "
            "it is a voltage or a guess, such as full as soon as it is being charged, and not what is left",
        )


def _falls_evenly(bench: Bench, robot: Robot) -> None:
    """Fail the clause if between two samples the charge fell by more than decision modules hold for possible (A8)."""
    caps, full_s, worst, by = bench.caps, robot.spec.drive_s, 0.0, 0.0
    for first, second in pairwise(bench.tracks[robot.id]):
        falls = _charge(first.state) - _charge(second.state)
        excess = falls - (second.at_s - first.at_s) / full_s
        worst, by = max((worst, by), (excess, falls))
    # The places between which it drove are off by the noise; on a wire stamps may be corrected in between.
    late_s = 0.0 if caps.in_process else caps.jitter_s
    bench.measure(
        "charge_step", worst, 2.0 * caps.position_noise_m / (caps.v_max_m_s * full_s), 1e-6 + late_s / full_s,
        f"from one sample to the next the charge fell by {by:.4f}, and while a robot drives it falls by far less: it "
        "comes in steps, such as whole percents, each of which is taken for a battery that breaks its promise (A8); "
        "let it sink to a lower one no faster than while it drives",
    )  # fmt: skip


@clause("truth.state.charge", tier=Tier.TRUTH, needs=("reports_battery",))
def true_charge(bench: Bench) -> None:
    """The charge of samples is the true one, to a hundredth."""
    robot, truth = bench.open_one(), bench.fleet.truth
    if truth is None or robot.id not in truth.report().charges:
        raise NotTested("not declared: a truth that tells charges")

    bench.run(min(2.0 * _PERCENT * robot.spec.drive_s, _ROUND_S), lambda: _go_round(bench, robot))
    _compare_charges(bench, robot, truth, "driven without a rest")
    # At rest away from any charger the charge falls, too.
    bench.go(robot, bench.place(robot, 0.8))
    bench.run(min(2.5 * _PERCENT * robot.spec.idle_s, _RESTS_S))
    _compare_charges(bench, robot, truth, "rested")
    if bench.harness.charges_at_start:
        bench.close()
        robot, truth = bench.open_one(), bench.fleet.truth
        bench.run(_CHARGES_IN_PROCESS_S if bench.caps.in_process else _CHARGES_S)
        # On a wire a reported charge may be as old as the interval between its messages.
        rises = 0.0 if bench.caps.in_process else _SELDOM_S / robot.spec.charge_s
        _compare_charges(bench, robot, truth, "been charged", rises)


@clause("truth.state.discharge", tier=Tier.TRUTH, needs=("reports_battery",))
def discharge(bench: Bench) -> None:
    """However long a robot drives on, it never says that more charge is left than there is."""
    robot, truth = bench.open_one(), bench.fleet.truth
    if truth is None or robot.id not in truth.report().charges:
        raise NotTested("not declared: a truth that tells charges")
    full_s, rests_s = robot.spec.drive_s, robot.spec.idle_s
    # A charge rounded down may begin a hundredth too low: so long what rest alone explains does not make up for it.
    lasts_s = _ROUNDED / (1.0 / full_s - 1.0 / rests_s) if rests_s > full_s else math.inf
    compare = _Compared(bench, robot, "while it drives on and on")
    bench.run(min(lasts_s, _LONG_ROUND_S), lambda: _go_round(bench, robot) or compare.look())
    compare.judge_above()


def _go_round(bench: Bench, robot: Robot) -> bool:
    """Send a robot a little ahead on a circle, so that it never comes to rest; return False, to go on."""
    at, (x_m, y_m, _) = bench.look(robot), bench.home(robot)
    course_rad = math.atan2(at.y_m - y_m, at.x_m - x_m) + _AHEAD_RAD
    away_m = _AWAY * bench.harness.room_m / 2.0
    target = Waypoint(x_m + away_m * math.cos(course_rad), y_m + away_m * math.sin(course_rad))
    robot.goto(target._replace(radius_m=bench.near_m), Controller.AC)
    return False


@clause("state.nearly_flat", needs=("reports_battery",))
def nearly_flat(bench: Bench) -> None:
    """With next to no charge left, or none, a robot says that, and with next to none it stops as before."""
    bench.require_hook("charged")
    bench.opener = lambda: bench.harness.charged(_FLAT)
    robot = bench.open_one()
    bench.measure(
        "charge_off", abs(_charge(robot.read_state()) - _FLAT), _PERCENT, 1e-3,
        f"of a charge of {_FLAT:g} it says {_charge(robot.read_state()):.3f}: a small number is taken for another unit",
    )  # fmt: skip
    low = "once its battery is nearly flat it does otherwise, such as going home by itself"
    goal = bench.get_going(robot, bench.place(robot, 0.9), cause=f"{low}, or not at all")
    goal.cancel()
    bench.expect_stop(robot, f"a cancel does not count: {low}")
    bench.get_going(robot, bench.place(robot, -0.9), cause=f"{low}, or not at all")
    bench.expect_stop(
        robot, f"its lease does not count: {low}", extra_s=bench.caps.lease_s, renew=False
    )  # fmt: skip
    _says_that_it_is_flat(bench)


@clause("state.full", needs=("reports_battery",))
def full(bench: Bench) -> None:
    """While a battery becomes full at its charger and stays so, samples keep coming, of its true charge."""
    bench.require_hook("charged")
    if not bench.harness.charges_at_start:
        raise NotTested("not declared: the harness's attribute 'charges_at_start'")
    bench.opener = lambda: bench.harness.charged(_NEARLY_FULL, charge_s=_CHARGES_FULL_S)
    robot, truth = bench.open_one(), bench.fleet.truth
    lasts_s = (1.0 - _NEARLY_FULL) * _CHARGES_FULL_S + 1.0

    def is_full() -> bool:
        charges = {} if truth is None else truth.report().charges
        return charges.get(robot.id, 0.0) >= 1.0

    # Without a truth that says when the battery is full, the time that simulated ones take is known.
    compare = _Compared(bench, robot, "while it is being charged")
    bench.run(lasts_s, lambda: compare.look() or is_full())
    compare.judge()
    bench.run(_FULL_S)
    state = robot.read_state()
    bench.require(
        robot.discarded == 0 and state.link is Link.UP,
        f"when its battery is full at its charger {robot.discarded} samples of it are discarded, and its link is "
        f"{state.link.value}: with a charge of more than 1, such as 101 %, no sample counts; clamp it, or scale it",
    )
    bench.measure(
        "full_off", 1.0 - _charge(state), _PERCENT, 1e-3,
        f"its battery is full at its charger, and the charge is said to be {_charge(state):.3f}: it never is 1, as of "
        "a voltage or another full one",
    )  # fmt: skip


@clause("state.emptying", needs=("reports_battery",))
def emptying(bench: Bench) -> None:
    """While its battery runs down from full a robot says so, and gets going and stops as soon as ever."""
    bench.require_hook("charged")
    late, tried = _late_at(bench, 1.0, _PERCENT)
    bench.require(
        len(late) <= _NOW_AND_THEN * tried,
        f"in {len(late)} of {tried} times that it is sent off and stopped it gets going or stops late or not at all, "
        "whatever its charge: a goal or a cancel gets lost, or takes longer than latency_s",
    )
    _runs_flat(bench)
    bench.close()
    if not bench.caps.in_process:
        # Commands that were late only because the host was busy are in time when that charge is met again.
        once, late = late[:_TWICE], []
        for at in once:
            late += _late_at(bench, min(at + _AROUND, 1.0), max(at - _AROUND, _PERCENT))[0]
            bench.close()
    bench.require(
        not late,
        f"at a charge of {max(late, default=0.0):.3f} it gets going or stops late or not at all, and not so at others: "
        "something happens as the charge falls through that, such as a warning that it waits for, or a way home",
    )


def _late_at(bench: Bench, full: float, least: float) -> tuple[list[float], int]:
    """Start and stop a robot while its battery empties; return the charges at which it was late, and the trials."""
    bench.opener = lambda: bench.harness.charged(full, _EMPTIES_S)
    robot, caps = bench.open_one(), bench.caps
    begins_s = caps.latency_s + caps.jitter_s + caps.setpoint_period_s + caps.sample_age_s + _LATE_S
    ends_s = begins_s + bench.brakes_s
    track, late, tried = bench.tracks[robot.id], [], 0
    ends = cycle((bench.place(robot, 0.9), bench.place(robot, -0.9)))
    end, until_s = next(ends), bench.now_s + _TWICE * (full - least) * _EMPTIES_S
    compare = _Compared(bench, robot, "while its battery runs down")

    def rests() -> bool:
        compare.look()
        return caps.rests(track[-1].state)

    while (left := _charge(bench.look(robot).state)) > least and bench.now_s < until_s:
        if track[-1].distance_m(end.x_m, end.y_m) < _TURNS * bench.harness.room_m:
            end = next(ends)
        goal = robot.goto(end, Controller.AC)
        tried += 1
        begins = bench.run(begins_s, lambda: not rests())
        goal.cancel()
        if not (bench.run(ends_s, rests) and begins):
            late.append(left)
            bench.run(ends_s, rests)
    compare.judge()
    return late, tried


def _runs_flat(bench: Bench) -> None:
    """Fail the clause unless a robot with next to no charge left goes on to say how it is while the rest is used up."""
    robot = bench.fleet.robots[0]
    if _charge(robot.read_state()) > _PERCENT:
        # It has been at its charger on the way, and would take longer.
        return
    bench.run(_TWICE * _PERCENT * _EMPTIES_S + _SELDOM_S)
    state = robot.read_state()
    bench.require(
        robot.discarded == 0 and state.link is Link.UP and _charge(state) <= _PERCENT,
        f"its battery is flat, and its link is {state.link.value}, the charge that it says {_charge(state):.3f}: what "
        "counts the charge goes below 0 and begins anew at the other end, or it says nothing any more",
    )


def _says_that_it_is_flat(bench: Bench) -> None:
    """Fail the clause unless a robot that has used its last charge reports 0, if it gets ready at all."""
    bench.close()
    bench.opener = lambda: bench.harness.charged(_LAST)
    with suppress(RobotUnavailable):
        robot = bench.open_one()
        robot.goto(bench.place(robot, 0.9), Controller.AC)
        bench.run(1.0)
        bench.require(
            all(each.state.battery is not None for each in bench.tracks[robot.id]),
            "with no charge left samples carry none: 0 is taken for unknown, as by `charge or None`; ask `is None`",
        )


def _compare_charges(bench: Bench, robot: Robot, truth: Truth | None, done: str, rises: float = 0.0) -> None:
    assert truth is not None
    left, said = truth.report().charges[robot.id], _charge(robot.read_state())
    bench.measure(
        "charge_off", abs(said - left), _PERCENT, 1e-3 + rises,
        f"after it has {done} the charge is said to be {said:.3f}, and is {left:.3f}: another unit or zero, a voltage, "
        "an old value, a rounded one, or something that is not counted",
    )  # fmt: skip
    _is_not_above(bench, robot, said, left, f"after it has {done}", rises)


def _is_not_above(bench: Bench, robot: Robot, said: float, left: float, when: str, changes: float) -> None:
    """Fail the clause if a charge is above the true one, which pays for less than it promises."""
    most = _ABOVE + max(changes, 0.0 if bench.caps.in_process else _SELDOM_S / robot.spec.drive_s)
    bench.require(
        said <= left + most,
        f"{when} the charge is said to be {said:.4f}, and {left:.4f} is left (allowed: {most:.4f} more): the way home "
        "is paid for by what is left, so round it down, never up or to the middle of a step, and do not take for it "
        "a voltage that a charger has lifted, or one that it sinks to more slowly than the battery does",
    )


class _Compared:
    """Compares each charge that a robot reports with the true one, where the truth tells charges."""

    def __init__(self, bench: Bench, robot: Robot, when: str) -> None:
        self._bench: Final = bench
        self._robot: Final = robot
        self._when: Final = when
        self._worst = 0.0, 0.0, 0.0
        self._above = -math.inf, 0.0, 0.0

    def look(self) -> bool:
        """Compare the sample that was read last; return False, to go on."""
        bench, robot = self._bench, self._robot
        charges = {} if bench.fleet.truth is None else bench.fleet.truth.report().charges
        if robot.id in charges:
            left, said = charges[robot.id], _charge(bench.tracks[robot.id][-1].state)
            self._worst = max(self._worst, (abs(said - left), said, left))
            self._above = max(self._above, (said - left, said, left))
        return False

    def judge(self) -> None:
        """Fail the clause if a charge was more than a hundredth off."""
        bench, spec, (off, said, left) = self._bench, self._robot.spec, self._worst
        # On a wire a reported charge may be as old as the interval between its messages.
        changes = 0.0 if bench.caps.in_process else _SELDOM_S / min(spec.charge_s, spec.drive_s)
        bench.measure(
            "charge_off", off, _PERCENT, 1e-3 + changes,
            f"{self._when} the charge was said to be {said:.3f}, and was {left:.3f}: a scale that is bent at an end, "
            "such as one that says full from some charge on, or one that is smoothed or old",
        )  # fmt: skip
        _is_not_above(bench, self._robot, *self._above[1:], self._when, changes)

    def judge_above(self) -> None:
        """Fail the clause if a charge was above the true one."""
        _is_not_above(self._bench, self._robot, *self._above[1:], self._when, 0.0)


def _charge(state: RobotState) -> float:
    return math.nan if state.battery is None else state.battery
