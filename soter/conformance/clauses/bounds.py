"""Bounds: what the proofs rely on, measured and compared with what is declared."""

from __future__ import annotations

import math

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import Sample, turn
from soter.sdk import Controller, Waypoint

_LEGS = ((0.7, 0.0), (0.0, 0.6), (-0.6, -0.2), (0.5, -0.5), (0.0, 0.0))


def _resolution_s(bench: Bench) -> float:
    """Return how well the moment at which a robot begins to react shows."""
    return TICK_S + bench.caps.setpoint_period_s + bench.caps.sample_age_s


@clause("bounds.latency", truth=True)
def latency(bench: Bench) -> None:
    """From a goto to the first motion no more than the declared latency passes."""
    slowest_s = 0.0
    for _ in range(3):
        robot = bench.open_one()
        sent_s = bench.now_s
        robot.goto(bench.place(robot, 0.6), Controller.AC)
        began = bench.run(bench.caps.latency_s + 3.0, lambda robot=robot: bench.tracks[robot.id][-1].moves)  # type: ignore[misc]
        bench.require(began, "it did not move within 3 s of a goto: the target does not get through")
        # When it was first seen to move, and not when the sample that shows it came in, unless it was re-stamped.
        slowest_s = max(slowest_s, bench.tracks[robot.id][-1].at_s - sent_s)
        bench.fleet.close()
        bench.harness.close()
    bench.measure(
        "latency_s", slowest_s, bench.caps.latency_s, _resolution_s(bench),
        "latency_s is declared too small, commands wait in a queue, or old samples are stamped as new",
    )  # fmt: skip


@clause("bounds.jitter")
def jitter(bench: Bench) -> None:
    """The fleet's clock wakes a tick no later than declared."""
    bench.open_one()
    clock = bench.fleet.clock
    lateness = []
    for _ in range(100):
        due_s = clock.now() + TICK_S
        clock.sleep_until(due_s)
        late_s = clock.now() - due_s
        bench.require(late_s >= -1e-6, f"the clock's sleep_until() returned {-late_s:.4f} s early")
        lateness.append(late_s)
    lateness.sort()
    # One in a hundred is left out: a host that is busy for a moment is no fault of the adapter's.
    bench.measure(
        "jitter_s", lateness[-2], bench.caps.jitter_s, 0.002 if bench.caps.in_process else 0.02,
        "the host is too slow for the speed-up, or jitter_s is declared too small",
    )  # fmt: skip


def _legs(bench: Bench) -> list[tuple[Sample, Waypoint, list[Sample]]]:
    """Drive legs from rest to rest; return where each began, its target, and what was seen of it."""
    robot = bench.open_one()
    legs = []
    for ahead, left in _LEGS:
        began, began_s = bench.look(robot), bench.now_s
        target = bench.place(robot, ahead, left, radius_m=0.05)
        bench.go(robot, target)
        bench.run(1.0)
        legs.append((began, target, bench.since(robot, began_s)))
    return legs


@clause("bounds.tube", truth=True)
def tube(bench: Bench) -> None:
    """The robot stays within tube_m of the straight segment to its target."""
    widest = 0.0
    for began, target, seen in _legs(bench):
        dx, dy = target.x_m - began.x_m, target.y_m - began.y_m
        length = math.hypot(dx, dy)
        for sample in seen:
            across = ((sample.y_m - began.y_m) * dx - (sample.x_m - began.x_m) * dy) / length
            widest = max(widest, abs(across))
    bench.measure(
        "tube_m", widest, bench.caps.tube_m, bench.still_m / 2,
        "the vehicle drives a curve (it turns while it drives, or is pulled off), or tube_m is declared too small",
    )  # fmt: skip


@clause("bounds.overshoot", truth=True)
def overshoot(bench: Bench) -> None:
    """The robot runs no more than overshoot_m beyond its target."""
    furthest = 0.0
    for began, target, seen in _legs(bench):
        dx, dy = target.x_m - began.x_m, target.y_m - began.y_m
        length = math.hypot(dx, dy)
        for sample in seen:
            along = ((sample.x_m - began.x_m) * dx + (sample.y_m - began.y_m) * dy) / length
            furthest = max(furthest, along - length)
    bench.measure(
        "overshoot_m", furthest, bench.caps.overshoot_m, bench.still_m / 2,
        "it brakes too late for its target, or overshoot_m is declared too small",
    )  # fmt: skip


@clause("bounds.braking", truth=True)
def braking(bench: Bench) -> None:
    """From its top speed the robot stops as brake_m_s2 and latency_s promise."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))
    bench.run(0.3)
    speed, called_s, before = bench.tracks[robot.id][-1].speed_m_s, bench.now_s, bench.look(robot)
    goal.cancel()
    bench.run(3.0 + speed / bench.caps.brake_m_s2)
    caps = bench.caps
    if not caps.in_process:
        # Two readings a tick apart say little of the speed; by now it is that of the declaration.
        speed = caps.v_max_m_s
    seen = bench.since(robot, called_s)
    rest = seen[-1]
    # From the first sample below the speed at the call until the last that moves.
    falls = [each for each in seen if each.speed_m_s > 0.02]
    reaction_s = caps.latency_s + caps.jitter_s + caps.setpoint_period_s
    bound_m = speed * (reaction_s + caps.sample_age_s) + speed**2 / (2 * caps.brake_m_s2)
    run_m = rest.distance_m(before.x_m, before.y_m)
    stop_s = (falls[-1].at_s if falls else called_s) - called_s
    bench.measure("braking_s", stop_s, reaction_s + speed / caps.brake_m_s2, _resolution_s(bench), "see braking_m")
    bench.measure(
        "braking_m", run_m, bound_m, bench.still_m,
        f"it ran on too far from {speed:.2f} m/s: brake_m_s2 or latency_s is declared better than it is",
    )  # fmt: skip


@clause("bounds.pivot", truth=True, needs=("pivots_first",))
def pivot(bench: Bench) -> None:
    """Where declared, the robot turns in place before it drives."""
    robot = bench.open_one()
    began, began_s = bench.look(robot), bench.now_s
    target = bench.place(robot, -0.4, 0.5)
    bench.go(robot, target)
    course = math.atan2(target.y_m - began.y_m, target.x_m - began.x_m)
    strayed = 0.0
    for sample in bench.since(robot, began_s):
        off = abs(turn(course, sample.heading_rad))
        # A vehicle that can reverse may drive with its back to the target.
        if min(off, math.pi - off if bench.caps.reverses else off) > 0.2:
            strayed = max(strayed, sample.distance_m(began.x_m, began.y_m))
    bench.measure(
        "pivot_stray_m",
        strayed,
        bench.caps.tube_m,
        bench.still_m,
        "it drives off before it has turned; declare pivots_first=False",
    )


@clause("bounds.yaw_rate", truth=True)
def yaw_rate(bench: Bench) -> None:
    """The robot turns no faster than yaw_rate_max_rad_s."""
    robot = bench.open_one()
    for ahead, left in ((-0.4, 0.0), (0.0, 0.4), (0.0, -0.4)):
        bench.go(robot, bench.place(robot, ahead, left))
    _, fastest, off = bench.fastest(robot)
    cap = bench.caps.yaw_rate_max_rad_s
    bench.measure(
        "yaw_rate_rad_s", fastest, cap, (0.05 + off) * cap, "yaw_rate_max_rad_s is declared too small, or degrees"
    )


@clause("truth.bounds.noise", tier=Tier.TRUTH)
def noise(bench: Bench) -> None:
    """Samples are off the truth by no more than position_noise_m and what their age explains."""
    robot = bench.open_one()
    worst, worst_rad = 0.0, 0.0
    caps = bench.caps

    def compare() -> bool:
        nonlocal worst, worst_rad
        state = robot.read_state()
        x_m, y_m, heading_rad = bench.true_pose(robot.id)
        age_s = state.age_s(bench.now_s)
        off = math.hypot(state.x_m - x_m, state.y_m - y_m)
        worst = max(worst, off - caps.v_max_m_s * age_s)
        worst_rad = max(worst_rad, abs(turn(heading_rad, state.heading_rad)) - caps.yaw_rate_max_rad_s * age_s)
        return not goal.active

    for ahead, left in _LEGS[:3]:
        goal = robot.goto(bench.place(robot, ahead, left), Controller.AC)
        bench.run(bench.way_s(), compare)
    # A simulator behind a wire may have moved on by a period between the two readings.
    slack_s = 0.0 if caps.in_process else TICK_S + caps.setpoint_period_s
    bench.measure(
        "position_noise_m", worst, caps.position_noise_m, caps.v_max_m_s * slack_s + 1e-4,
        "another frame or unit, stamps newer than the sample, or position_noise_m is declared too small",
    )  # fmt: skip
    bench.require(
        worst_rad <= 0.05 + caps.yaw_rate_max_rad_s * slack_s,
        f"headings are {worst_rad:.2f} rad off the truth: sign, unit, or stamps newer than the sample",
    )
