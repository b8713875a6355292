"""Samples: stamps that advance, ages as declared, and a read that never waits."""

from __future__ import annotations

import time
from itertools import pairwise, product
from typing import get_args, get_type_hints

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.judging import STILL_M
from soter.conformance.track import quantile
from soter.sdk import Capabilities, Controller, Goal, Robot, RobotState

_BETWEEN, _SHARE = 5, 0.4
_LONG_S = 10.0
_RATE = 2e-3
_AGES_S = 8.0
_RESTS = 0.65
_CREEPS = 0.1
_MOTION = slice(RobotState._fields.index("x_m"), RobotState._fields.index("yaw_rate_rad_s"))


@clause("state.fresh")
def fresh(bench: Bench) -> None:
    """A new stamp comes with a new position: what moves is never re-stamped."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    began_s = bench.now_s
    bench.run(0.5 * bench.harness.room_m / 2.0 / bench.caps.v_max_m_s)
    seen = bench.since(robot, began_s)
    bench.require(
        len(seen) >= 2, "no new sample arrived while the robot was driving: the age is not that of the sample"
    )
    for first, second in pairwise(seen):
        expected = (first.speed_m_s + second.speed_m_s) / 2 * (second.at_s - first.at_s)
        moved = second.distance_m(first.x_m, first.y_m)
        bench.require(
            abs(moved - expected) <= 0.5 * expected + STILL_M / 2.0 + 2.0 * bench.noise_m,
            f"between the stamps {first.at_s:.2f} and {second.at_s:.2f} s the position moved by {moved:.4f} m, at that "
            f"speed expected {expected:.4f} m: old samples get new stamps, or stamps are rounded; stamp them where "
            "they are measured",
        )


@clause("state.types")
def types(bench: Bench) -> None:
    """What samples and capabilities hold is of the types that these declare, so that it can be recorded."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, 0.5))
    goal = robot.goto(bench.place(robot, 0.9), robot.in_charge)
    bench.run(bench.caps.latency_s + 2.0 * TICK_S, lambda: not goal.active)
    for what, hints, held in (
        ("a sample", get_type_hints(RobotState), {sample.state for sample in bench.tracks[robot.id]}),
        ("the capabilities", get_type_hints(Capabilities), {bench.caps}),
    ):
        for each, (name, declared) in product(held, hints.items()):
            value, allowed = getattr(each, name), get_args(declared) or (declared,)
            # Whole numbers are written like any others.
            bench.require(
                type(value) in (*allowed, *([int] if float in allowed else [])),
                f"{name} of {what} is {value!r}, a {type(value).__name__}, declared is "
                f"{getattr(declared, '__name__', declared)}: recordings, and programs that write JSON, cannot take it",
            )


@clause("state.stamps")
def stamps(bench: Bench) -> None:
    """Stamps go on, in step with the vehicle's own; they never go back or lie in the future."""
    robot = bench.open_one()
    before = bench.look(robot).state

    def look() -> bool:
        ahead_s = robot.read_state().stamp_s - bench.now_s
        bench.require(
            ahead_s <= TICK_S, f"a sample is stamped {ahead_s:.2f} s in the future: the clock offset is wrong"
        )
        return False

    bench.run(_LONG_S, look)
    after = bench.look(robot).state
    fleet_s, vehicle_s = after.stamp_s - before.stamp_s, after.vehicle_stamp_s - before.vehicle_stamp_s
    bench.require(
        abs(fleet_s - _LONG_S) <= bench.caps.sample_age_s + 2 * TICK_S,
        f"in {_LONG_S:.0f} s of fleet time the stamps went on by {fleet_s:.2f} s: samples do not keep coming, or "
        "stamps are not in fleet time",
    )
    slack_s = ROUNDING if bench.caps.in_process else _RATE * fleet_s + bench.caps.jitter_s
    bench.require(
        abs(vehicle_s - fleet_s) <= slack_s,
        f"stamps went on by {fleet_s:.3f} s, those of the vehicle by {vehicle_s:.3f} s: milliseconds, a clock that "
        "stands still, or one that is fast or slow",
    )
    if bench.caps.in_process:
        _between_periods(bench, robot, after)


def _between_periods(bench: Bench, robot: Robot, before: RobotState) -> None:
    """Fail the clause if a sample that is read between two control periods claims to be of that moment."""
    clock = bench.fleet.clock
    for _ in range(_BETWEEN):
        clock.sleep_until(clock.now() + _SHARE * TICK_S)
        state = robot.read_state()
        late_s = (state.stamp_s - before.stamp_s) - (state.vehicle_stamp_s - before.vehicle_stamp_s)
        bench.require(
            abs(late_s) <= ROUNDING,
            f"read between two of its periods, a sample is stamped {late_s:.3f} s later than by its vehicle: it "
            "has the time at which it is read, and not the one at which the robot was there",
        )


@clause("state.age")
def age(bench: Bench) -> None:
    """When it is read, the latest sample is no older than declared: of a robot that drives, that creeps, that rests."""
    robot = bench.open_one()
    # All open robots: they may share the channel that carries their samples.
    ages: dict[int, list[float]] = {}
    rare_s = bench.caps.sample_age_s + bench.caps.jitter_s
    goals: list[Goal] = []

    def look() -> bool:
        if bench.now_s >= rests_s:
            goals[-1].cancel()
        elif not goals[-1].active:
            goals.append(robot.goto(slowly, Controller.AC))
        for each in bench.fleet.robots:
            # Taken before the read: the host's delay between the two is not the sample's age.
            now_s = bench.now_s
            ages[each.id].append(each.read_state().age_s(now_s))
        return False

    # On a wire one pause of the host may make many samples old; a fault of the robot's shows again.
    for ahead, end in ((0.4, 0.9),) if bench.caps.in_process else ((0.4, 0.9), (0.0, -0.9)):
        # Samples of a robot that drives, that creeps and that rests are among them.
        goals.append(bench.get_going(robot, bench.place(robot, ahead)))
        slowly = bench.place(robot, end, speed_m_s=_CREEPS * bench.caps.v_max_m_s)
        rests_s = bench.now_s + _RESTS * _AGES_S
        ages.update({each.id: [] for each in bench.fleet.robots})
        bench.run(_AGES_S, look, closely=True)
        if max(quantile(seen, 0.995) for seen in ages.values()) <= rare_s:
            break
    for number, seen in ages.items():
        cause = (
            f"samples of robot {number} queue up (keep only the latest), come too seldom"
            f"{', are crowded out by those of another' * (len(ages) > 1)}, or sample_age_s is declared too small"
        )
        # One in twenty is judged less sharply: a host that is busy for a moment is not the adapter's fault.
        bench.measure("sample_age_s", quantile(seen, 0.95), bench.caps.sample_age_s, 1e-4, cause, spread=seen)
        bench.measure("sample_age_rare_s", quantile(seen, 0.995), rare_s, 1e-4, cause)


@clause("state.never_waits")
def never_waits(bench: Bench) -> None:
    """read_state() returns the latest sample at once, however often: no fleet time passes, and next to no host time."""
    robot = bench.open_one()
    robot.goto(bench.place(robot, 0.9), Controller.AC)
    slowest_s, passed_s = 0.0, 0.0
    for _ in range(50):
        before_s, host_s = bench.now_s, time.perf_counter()
        read = [robot.read_state() for _ in range(5)]
        slowest_s += time.perf_counter() - host_s
        passed_s = max(passed_s, bench.now_s - before_s)
        for first, second in pairwise(read):
            bench.require(
                second.stamp_s > first.stamp_s or second[_MOTION] == first[_MOTION],
                "two samples with one stamp tell different places or velocities: what they say comes of when they are "
                "read, such as a velocity taken from one read to the next",
            )
        robot.renew_lease()
        bench.fleet.clock.sleep_until(bench.now_s + TICK_S)
    bench.require(
        slowest_s / 250 < 0.01 and (passed_s == 0.0 or not bench.caps.in_process),
        f"read_state() took {slowest_s / 250 * 1e3:.1f} ms of host time and up to {passed_s:.3f} s of fleet time: it "
        "waits for a message; take the latest instead",
    )
