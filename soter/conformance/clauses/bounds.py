"""Bounds: what the proofs rely on, measured and compared with what is declared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

from soter.conformance.bench import SETTLE_S, Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.judging import FIT_S, STILL_M, STILL_RAD
from soter.conformance.track import TrackSample, fit_stop, quantile, turn
from soter.conformance.trials import Shuttle
from soter.errors import Unsupported
from soter.sdk import Controller, Robot, Waypoint

_LEGS = ((0.7, 0.0), (0.0, 0.6), (-0.6, -0.2))
_CORNERS, _CORNERS_IN_PROCESS = 5, 11
_CORNERS_AT = 0.8
_WIDE = 0.3
_THROUGH = ((0.85, 0.1), (-0.85, -0.1))
_TRIALS = 16
_WAKES, _WAKES_IN_PROCESS = 200, 1000
_RESTS_S = 8.0
_BUSY_S = 0.02
_TURNS, _TURNS_IN_PROCESS = 0.6, 0.95
_ASIDE_RAD = 0.7
_ASIDE_M = 0.6
_OFF_RAD = 0.15
_BACK = 0.4
_FAR_FROM = 0.8
_FAR_TO = 4.0


@clause("bounds.latency", truth=True)
def latency(bench: Bench) -> None:
    """From a goto, and from a cancel, to the first change of motion no more than the declared latency passes."""
    robot = bench.open_one()
    caps, seen = bench.caps, []
    for trial in Shuttle(bench, robot).trials(bench.trials(_TRIALS), lambda goal: goal.cancel()):
        seen += [trial.start.begins_s, trial.end.begins_s]
    cause = (
        "latency_s is declared too small, commands wait in a queue or some are dropped, or samples wait before they "
        "are received, each for as long, or are stamped anew"
    )
    # Nine of ten are judged sharply; of the rest one may have met a host that was busy for a moment.
    bench.measure(
        "latency_s", quantile(seen, 0.9), caps.latency_s, bench.fit_s, cause, spread=seen
    )  # fmt: skip
    bench.measure("latency_worst_s", max(seen), caps.latency_s + caps.jitter_s, bench.fit_s, cause)
    bench.measure(
        "setpoint_period_s", quantile(seen, 0.9) - quantile(seen, 0.1), caps.setpoint_period_s,
        bench.fit_s - FIT_S + caps.jitter_s, "calls at different moments wait for very different times: the vehicle "
        "looks at its commands more seldom than setpoint_period_s says",
    )  # fmt: skip


@clause("bounds.jitter")
def jitter(bench: Bench) -> None:
    """The fleet's clock wakes a tick no later than declared."""
    bench.open_one()
    clock = bench.fleet.clock
    lateness = []
    for _ in range(_WAKES_IN_PROCESS if bench.caps.in_process else _WAKES):
        due_s = clock.now() + TICK_S
        clock.sleep_until(due_s)
        late_s = clock.now() - due_s
        bench.require(late_s >= -1e-6, f"the clock's sleep_until() returned {-late_s:.4f} s early")
        lateness.append(late_s)
    cause = "the host is too slow for the speed-up, or jitter_s is declared too small"
    # One in twenty is judged less sharply: a host that is busy for a moment is no fault of the adapter's.
    bench.measure("jitter_s", quantile(lateness, 0.95), bench.caps.jitter_s, 1e-4, cause, spread=lateness)
    bench.measure(
        "jitter_rare_s", quantile(lateness, 1.0 if bench.caps.in_process else 0.99), 2.0 * bench.caps.jitter_s,
        0.0 if bench.caps.in_process else _BUSY_S, cause,
    )  # fmt: skip


@clause("bounds.rest")
def rest(bench: Bench) -> None:
    """The samples of a robot at rest show no more speed than promised, and wander no farther."""
    robot = bench.open_one()
    bench.run(SETTLE_S)
    began_s = bench.now_s
    bench.run(_RESTS_S, closely=True)
    caps, seen = bench.caps, [each.state for each in bench.since(robot, began_s)]
    shown = [math.hypot(each.vx_m_s, each.vy_m_s) for each in seen]
    cause = "at rest, samples show more than is promised: an estimate that roams, or a robot that nothing holds"
    bench.measure("speed_noise_m_s", max(shown), bench.speed_noise_m_s, bench.still_m / _RESTS_S, cause, spread=shown)
    # Of two samples either may be off.
    apart_m = max(math.hypot(each.x_m - seen[0].x_m, each.y_m - seen[0].y_m) for each in seen)
    bench.measure("position_noise_m", apart_m / 2.0, caps.position_noise_m, STILL_M / 2.0, cause)
    turned_rad = max(abs(turn(seen[0].heading_rad, each.heading_rad)) for each in seen)
    noise_rad = 0.05 if caps.heading_noise_rad is None else caps.heading_noise_rad
    bench.measure("heading_noise_rad", turned_rad / 2.0, noise_rad, STILL_RAD / 2.0, cause)


@clause("bounds.clock")
def clock(bench: Bench) -> None:
    """Fleet time goes on as promised: on a wire with the host's, in process only while somebody sleeps."""
    bench.open_one()
    clock, caps, lasts_s = bench.fleet.clock, bench.caps, 5.0
    if caps.in_process:
        before_s, host_s = clock.now(), clock.steady_s()
        while clock.steady_s() - host_s < 0.02:
            pass
        passed_s = clock.now() - before_s
        bench.require(
            passed_s == 0.0,
            f"fleet time went on by {passed_s:.3f} s while nobody slept: in_process promises virtual time; use a "
            "VirtualClock, or declare in_process=False",
        )
        return
    before_s, host_s = clock.now(), clock.steady_s()
    clock.sleep_until(before_s + lasts_s)
    fleet_s, passed_s = clock.now() - before_s, (clock.steady_s() - host_s) * bench.harness.speedup
    bench.measure(
        "clock_error", abs(fleet_s / passed_s - 1.0), 1e-3, 2.0 * bench.read_s / lasts_s,
        f"in {passed_s:.3f} s of the host fleet time went on by {fleet_s:.3f} s: the fleet's clock is fast or slow",
    )  # fmt: skip


def _legs(
    bench: Bench, more: Sequence[tuple[float, float]] = ()
) -> list[tuple[TrackSample, Waypoint, list[TrackSample]]]:
    """Drive legs from rest to rest; return where each began, its target, and what was seen of it.

    They are those of a star, which leads across the room and to all sides alike.
    """
    robot = bench.open_one()
    legs = []
    corners = _CORNERS_IN_PROCESS if bench.caps.in_process and bench.truth and not more else _CORNERS
    angles = [2.0 * math.pi * (corners // 2) * number / corners for number in range(corners + 1)]
    star = [(_CORNERS_AT * math.cos(angle), _CORNERS_AT * math.sin(angle)) for angle in angles]
    for ahead, left in (*more, *star)[: bench.trials(len(more) + len(star))]:
        began, began_s = bench.look(robot), bench.now_s
        target = bench.place(robot, ahead, left, radius_m=bench.near_m)
        bench.go(robot, target)
        bench.run(1.0)
        legs.append((began, target, bench.since(robot, began_s)))
    if bench.caps.reverses:
        began, began_s = bench.look(robot), bench.now_s
        back_m = _BACK * bench.harness.room_m / 2.0
        target = Waypoint(
            began.x_m - back_m * math.cos(began.heading_rad), began.y_m - back_m * math.sin(began.heading_rad),
            heading_rad=began.heading_rad, radius_m=0.05,
        )  # fmt: skip
        with suppress(Unsupported):
            bench.go(robot, target)
            bench.run(1.0)
            legs.append((began, target, bench.since(robot, began_s)))
    return legs


def _off_m(bench: Bench) -> float:
    """Return how far a place that was seen may be off because the measurement is."""
    return 1e-4 + 2.0 * bench.noise_m + bench.caps.v_max_m_s * bench.read_s


def _along_and_across(began: TrackSample, target: Waypoint, seen: list[TrackSample]) -> list[tuple[float, float]]:
    """Return how far beyond the target, and how far beside the straight segment to it, a robot was."""
    dx, dy = target.x_m - began.x_m, target.y_m - began.y_m
    length = math.hypot(dx, dy)
    off = [(each.x_m - began.x_m, each.y_m - began.y_m) for each in seen]
    return [((x_m * dx + y_m * dy) / length - length, (y_m * dx - x_m * dy) / length) for x_m, y_m in off]


@clause("bounds.tube", truth=True)
def tube(bench: Bench) -> None:
    """The robot stays within tube_m of the straight segment to its target."""
    widest = max((0.0, *(abs(across) for leg in _legs(bench) for _, across in _along_and_across(*leg))))
    bench.measure(
        "tube_m", widest, bench.caps.tube_m, _off_m(bench),
        "the vehicle drives a curve (it turns while it drives, or is pulled off), is sent beside its target, such as "
        "to a rounded one, or tube_m is declared too small",
    )  # fmt: skip


@clause("bounds.long_tube", truth=True)
def long_tube(bench: Bench) -> None:
    """The robot stays within tube_m of the straight segment also where its target is several metres away."""
    robot = bench.open_one()
    widest, ends = 0.0, []
    for ahead in (-1.0, 1.0)[: bench.trials(2)]:
        bench.go(robot, bench.place(robot, -_FAR_FROM * ahead))
        bench.run(SETTLE_S)
        began, began_s = bench.look(robot), bench.now_s
        # Through the whole room, towards what lies far beyond it.
        target = bench.place(robot, _FAR_TO * ahead)
        goal = robot.goto(target, Controller.AC)
        most_m = 2.0 * _FAR_FROM * bench.harness.room_m / 2.0

        def through(began: TrackSample = began, began_s: float = began_s, most_m: float = most_m) -> bool:
            gone_m = bench.tracks[robot.id][-1].distance_m(began.x_m, began.y_m)
            return gone_m > most_m or bench.stands(robot, began_s)

        bench.run(bench.way_s(), through, closely=True)
        called_s = bench.now_s
        goal.cancel()
        bench.require(
            bench.tracks[robot.id][-1].distance_m(began.x_m, began.y_m) > most_m,
            f"towards a target {_FAR_TO * bench.harness.room_m / 2.0:.0f} m away it stopped short",
        )
        beside = _along_and_across(began, target, bench.since(robot, began_s))
        widest = max((widest, *(abs(across) for _, across in beside)))
        bench.run(SETTLE_S, closely=True)
        ends.append(fit_stop(bench.tracks[robot.id], called_s))
    bench.measure(
        "long_stop_s", min((end.begins_s for end in ends if end), default=0.0), bench.caps.latency_s, bench.fit_s,
        "after a way of seconds a stop is later than after a short one: something adds up while it drives",
    )  # fmt: skip
    bench.measure(
        "long_tube_m", widest, bench.caps.tube_m, _off_m(bench),
        "on its way to a target far away the vehicle drives beside the straight segment: it steers by less the farther "
        "that is, or plans another way",
    )  # fmt: skip


@clause("bounds.overshoot", truth=True)
def overshoot(bench: Bench) -> None:
    """The robot runs no more than overshoot_m beyond its target."""
    legs = _legs(bench, _THROUGH)
    robot = bench.fleet.robots[-1]
    began, began_s = bench.look(robot), bench.now_s
    # What ends a goal from afar does not say where to stop.
    wide = bench.place(robot, 0.0, radius_m=_WIDE * bench.harness.room_m / 2.0)
    bench.go(robot, wide)
    bench.run(SETTLE_S)
    legs.append((began, wide, bench.since(robot, began_s)))
    furthest = max((0.0, *(beyond for leg in legs for beyond, _ in _along_and_across(*leg))))
    bench.measure(
        "overshoot_m", furthest, bench.caps.overshoot_m, _off_m(bench),
        "it brakes too late for its target, is sent to a place beyond it, such as a rounded one, or overshoot_m is "
        "declared too small",
    )  # fmt: skip


@clause("bounds.pivot", truth=True, needs=("pivots_first",))
def pivot(bench: Bench) -> None:
    """Where declared, the robot turns in place before it drives."""
    robot = bench.open_one()
    for ahead, left in ((-0.4, 0.5), (0.3, -0.4))[: bench.trials(2)]:
        began, began_s = bench.look(robot), bench.now_s
        target = bench.place(robot, ahead, left)
        bench.go(robot, target)
        course = math.atan2(target.y_m - began.y_m, target.x_m - began.x_m)
        strayed = 0.0
        for sample in bench.since(robot, began_s):
            off = abs(turn(course, sample.heading_rad))
            if bench.caps.reverses:
                off = min(off, math.pi - off)
            if off > 0.3:
                strayed = max(strayed, sample.distance_m(began.x_m, began.y_m))
        bench.measure(
            "pivot_m", strayed, bench.caps.tube_m, _off_m(bench),
            "it drives off before it has turned, or turns about another point than its place; declare "
            "pivots_first=False",
        )  # fmt: skip
        bench.run(SETTLE_S)
    _no_curve(bench, robot)


def _no_curve(bench: Bench, robot: Robot) -> None:
    """See a robot on its way come to rest and turn in place for a target that lies a little to the side."""
    caps = bench.caps
    bench.go(robot, bench.place(robot, -0.7))
    bench.get_going(robot, bench.place(robot, 0.9), closely=True)
    at, called_s = bench.look(robot), bench.now_s
    bearing_rad = at.heading_rad + _ASIDE_RAD
    target = Waypoint(at.x_m + _ASIDE_M * math.cos(bearing_rad), at.y_m + _ASIDE_M * math.sin(bearing_rad))
    bench.go(robot, target)
    rests_s = called_s + caps.latency_s + caps.jitter_s + 2 * TICK_S + caps.v_max_m_s / caps.brake_m_s2
    turning = [
        each
        for each in bench.since(robot, rests_s)
        if abs(turn(math.atan2(target.y_m - each.y_m, target.x_m - each.x_m), each.heading_rad)) > _OFF_RAD
        and each.distance_m(target.x_m, target.y_m) > 2.0 * target.radius_m
    ]
    curved_m = max((each.distance_m(turning[0].x_m, turning[0].y_m) for each in turning), default=0.0)
    bench.measure(
        "curve_m", curved_m, caps.tube_m, _off_m(bench),
        "a goal that replaces another on the way is driven to in a curve, without a stop and a turn; declare "
        "pivots_first=False",
    )  # fmt: skip


def turns_at_least(bench: Bench) -> float:
    """Return the turn rate that a robot is to come to: a wire's vehicle may be slow in getting there."""
    return (_TURNS_IN_PROCESS if bench.caps.in_process else _TURNS) * bench.caps.yaw_rate_max_rad_s


@clause("bounds.yaw_rate", truth=True)
def yaw_rate(bench: Bench) -> None:
    """The robot turns no faster than yaw_rate_max_rad_s, and comes near it to either side."""
    robot = bench.open_one()
    # Three eighths of a circle to the left, to the right, and again.
    for ahead, left in ((-0.4, 0.4), (0.3, 0.4), (0.0, 0.7), (0.4, 0.7)):
        bench.go(robot, bench.place(robot, ahead, left))
        bench.run(SETTLE_S)
    seen, off = bench.fastest(robot)
    cap = bench.caps.yaw_rate_max_rad_s
    bench.measure(
        "yaw_rate_max_rad_s", max(seen[1:]), cap, (0.03 + off) * cap,
        "yaw_rate_max_rad_s is declared too small, or degrees",
    )  # fmt: skip
    bench.measure(
        "yaw_rate_least_rad_s", min(seen[1:]), turns_at_least(bench), off * cap,
        "to one side, or to both, it turns more slowly than yaw_rate_max_rad_s, by which turns are paid for",
        at_least=True,
    )  # fmt: skip


@clause("truth.bounds.noise", tier=Tier.TRUTH)
def noise(bench: Bench) -> None:
    """Samples are off the truth of their own moment by no more than position_noise_m and heading_noise_rad."""
    robot = bench.open_one()
    for ahead, left in _LEGS:
        goal = robot.goto(bench.place(robot, ahead, left), Controller.AC)
        bench.run(bench.way_s(), lambda goal=goal: not goal.active, closely=True)  # type: ignore[misc]
    bench.run(0.5, closely=True)
    caps = bench.caps
    pairs = _beside(bench.tracks[robot.id])
    bench.require(bool(pairs), "no sample has the stamp of a moment at which the robot was watched: stamps are wrong")
    off_m = [math.hypot(s.state.x_m - x_m, s.state.y_m - y_m) for s, x_m, y_m, _ in pairs]
    off_rad = [abs(turn(heading_rad, s.state.heading_rad)) for s, _, _, heading_rad in pairs]
    # On a wire the truth, too, comes late where the host is busy for a moment: the rest is judged less sharply.
    share, late_s = (1.0, 0.0) if caps.in_process else (0.99, caps.sample_age_s + caps.jitter_s)
    cause = "another frame or unit, rounded, stamps newer than the sample, or position_noise_m is declared too small"
    bench.measure(
        "position_noise_m", quantile(off_m, share), caps.position_noise_m, caps.v_max_m_s * 2.0 * bench.read_s + 1e-4,
        cause, spread=off_m,
    )  # fmt: skip
    bench.measure(
        "position_noise_rare_m", max(off_m), caps.position_noise_m + caps.v_max_m_s * late_s, _off_m(bench), cause
    )
    bench.measure(
        "heading_noise_rad", quantile(off_rad, share),
        0.05 if caps.heading_noise_rad is None else caps.heading_noise_rad,
        caps.yaw_rate_max_rad_s * 2.0 * bench.read_s + 1e-3,
        "headings are off the truth: sign, unit, stamps newer than the sample, or heading_noise_rad is too small",
    )  # fmt: skip


def _beside(track: list[TrackSample]) -> list[tuple[TrackSample, float, float, float]]:
    """Return samples with the true pose at their stamps, between two looks at the truth."""
    found, first = [], 0
    for sample in track:
        stamp_s = sample.state.stamp_s
        while first + 2 < len(track) and track[first + 1].at_s < stamp_s:
            first += 1
        a, b = track[first], track[min(first + 1, len(track) - 1)]
        if not a.at_s - ROUNDING <= stamp_s <= b.at_s + ROUNDING or b.at_s - a.at_s > TICK_S + ROUNDING:
            continue
        share = 0.0 if b.at_s <= a.at_s else (stamp_s - a.at_s) / (b.at_s - a.at_s)
        heading = turn(0.0, a.heading_rad + share * turn(a.heading_rad, b.heading_rad))
        found.append((sample, a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m), heading))
    return found


@clause("truth.bounds.velocity", tier=Tier.TRUTH)
def velocity(bench: Bench) -> None:
    """The velocity of samples is off the true one by no more than speed_noise_m_s, and changes when that does."""
    robot = bench.open_one()
    caps, worst, lag, window_s = bench.caps, 0.0, 0.0, 0.1 if bench.caps.in_process else 0.3
    for ahead in (0.7, -0.7):
        began_s = bench.now_s
        bench.go(robot, bench.place(robot, ahead))
        seen = bench.since(robot, began_s)
        for first, last in zip(seen, seen[round(2 * window_s / TICK_S) :], strict=False):
            inner = [each.state for each in seen if first.at_s <= each.at_s <= last.at_s]
            fast = [math.hypot(each.vx_m_s, each.vy_m_s) for each in inner]
            passed_s, many = last.at_s - first.at_s, len(inner)
            off_x = sum(each.vx_m_s for each in inner) / many - (last.x_m - first.x_m) / passed_s
            off_y = sum(each.vy_m_s for each in inner) / many - (last.y_m - first.y_m) / passed_s
            off = math.hypot(off_x, off_y)
            if min(fast) > 0.5 * caps.v_max_m_s and max(fast) - min(fast) < 0.05 * caps.v_max_m_s:
                worst = max(worst, off)
            lag = max(lag, off)
    general = 0.05 * caps.v_max_m_s
    noise_m_s = general if caps.speed_noise_m_s is None else caps.speed_noise_m_s
    slack_m_s = caps.v_max_m_s * bench.read_s / window_s + 1e-4
    bench.measure(
        "speed_noise_m_s", worst, noise_m_s, slack_m_s,
        "velocities are off the truth: another unit or frame, too low, late, or speed_noise_m_s is declared too small",
    )  # fmt: skip
    # Means over a window agree to what one period, and the age of the sample, make of a change of speed.
    late_s = caps.sample_age_s + caps.setpoint_period_s + TICK_S
    bench.measure(
        "speed_lag_m_s", lag, noise_m_s + caps.v_max_m_s * min(late_s / (2.0 * window_s), 1.0), slack_m_s,
        "while the speed changes velocities lag behind it: they are filtered, or those of an earlier sample",
    )  # fmt: skip
