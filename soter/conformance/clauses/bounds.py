"""Bounds: what the proofs rely on, measured and compared with what is declared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.judging import FIT_S, STILL_M, STILL_RAD
from soter.conformance.track import TrackSample, quantile, turn
from soter.conformance.trials import GOLDEN, Shuttle
from soter.sdk import Controller

_LOST = 0.2
_LEGS = ((0.7, 0.0), (0.0, 0.6), (-0.6, -0.2))
_TRIALS = 16
_WAKES, _WAKES_IN_PROCESS = 200, 1000
_RESTS_S = 8.0
_BUSY_S = 0.02
_TURNS, _TURNS_IN_PROCESS = 0.6, 0.95
_FAST_RAD_S = 3.5


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
    # Nine of ten trials are judged sharply; one of the rest may have met a host that was busy for a moment.
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
    """The fleet's clock wakes a tick no later than declared, and never early, whatever the moment."""
    bench.open_one()
    clock = bench.fleet.clock
    lateness = []
    for number in range(_WAKES_IN_PROCESS if bench.caps.in_process else _WAKES):
        # At moments of all kinds: a clock may know only those of its own period.
        due_s = clock.now() + (0.5 + number * GOLDEN % 1.0) * TICK_S
        clock.sleep_until(due_s)
        late_s = clock.now() - due_s
        bench.require(
            late_s >= -1e-6,
            f"the clock's sleep_until() returned {-late_s:.4f} s early: it wakes only at multiples of some period, or "
            "rounds a time down",
        )
        lateness.append(late_s)
    cause = "the host is too slow for the speed-up, or jitter_s is declared too small"
    # One in twenty is judged less sharply: a host that is busy for a moment is not the adapter's fault.
    bench.measure("jitter_s", quantile(lateness, 0.95), bench.caps.jitter_s, 1e-4, cause, spread=lateness)
    bench.measure(
        "jitter_rare_s", quantile(lateness, 1.0 if bench.caps.in_process else 0.99), 2.0 * bench.caps.jitter_s,
        0.0 if bench.caps.in_process else _BUSY_S, cause,
    )  # fmt: skip


@clause("bounds.rest")
def rest(bench: Bench) -> None:
    """The samples of a robot at rest show no more speed than promised, and wander no farther."""
    robot = bench.open_one()
    bench.settle()
    began_s = bench.now_s
    bench.run(_RESTS_S, closely=True)
    caps, seen = bench.caps, [each.state for each in bench.since(robot, began_s)]
    shown = [math.hypot(each.vx_m_s, each.vy_m_s) for each in seen]
    cause = "at rest, samples show more than is promised: an estimate that roams, or a robot that nothing holds"
    bench.measure("speed_noise_m_s", max(shown), bench.speed_noise_m_s, bench.still_m / _RESTS_S, cause, spread=shown)
    # Either of the two samples may be off.
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


def turns_at_least(bench: Bench) -> float:
    """Return the turn rate that a robot must reach: less on a wire, where vehicles may take long to get there.

    Few robots gain a very fast rate within three eighths of a circle.
    """
    share = _TURNS_IN_PROCESS if bench.caps.in_process else _TURNS
    return share * min(bench.caps.yaw_rate_max_rad_s, _FAST_RAD_S)


@clause("bounds.yaw_rate", truth=True)
def yaw_rate(bench: Bench) -> None:
    """The robot turns no faster than yaw_rate_max_rad_s, and comes near it to either side."""
    robot = bench.open_one()
    # Three eighths of a circle to the left, to the right, and again.
    for ahead, left in ((-0.4, 0.4), (0.3, 0.4), (0.0, 0.7), (0.4, 0.7)):
        bench.go(robot, bench.place(robot, ahead, left))
        bench.settle()
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
    """Samples are off the truth of their own moment by no more than is promised, also where messages are lost."""
    robot, caps = bench.open_one(), bench.caps
    for lost in (0.0, _LOST) if bench.harness.gives("loss") else (0.0,):
        if lost:
            bench.faulty = True
            bench.harness.loss(lost)
        for ahead, left in _LEGS:
            goal = robot.goto(bench.place(robot, ahead, left), Controller.AC)
            bench.run(bench.way_s(), lambda goal=goal: not goal.active, closely=True)  # type: ignore[misc]
        bench.run(0.5, closely=True)
    pairs = _beside(bench.tracks[robot.id])
    bench.require(bool(pairs), "no sample has the stamp of a moment at which the robot was watched: stamps are wrong")
    off_m = [math.hypot(s.state.x_m - x_m, s.state.y_m - y_m) for s, x_m, y_m, _ in pairs]
    off_rad = [abs(turn(heading_rad, s.state.heading_rad)) for s, _, _, heading_rad in pairs]
    # On a wire the truth comes late, too, while the host is busy: the worst hundredth is judged less sharply.
    share, late_s = (1.0, 0.0) if caps.in_process else (0.99, caps.sample_age_s + caps.jitter_s)
    cause = (
        "another frame or unit, rounded, stamps newer than the sample, moved to its stamp the wrong way when one "
        "is lost, or position_noise_m is declared too small"
    )
    bench.measure(
        "position_noise_m", quantile(off_m, share), caps.position_noise_m, caps.v_max_m_s * 2.0 * bench.read_s + 1e-4,
        cause, spread=off_m,
    )  # fmt: skip
    bench.measure(
        "position_noise_rare_m", max(off_m), caps.position_noise_m + caps.v_max_m_s * late_s, bench.off_m, cause
    )
    bench.measure(
        "heading_noise_rad", quantile(off_rad, share),
        0.05 if caps.heading_noise_rad is None else caps.heading_noise_rad,
        caps.yaw_rate_max_rad_s * 2.0 * bench.read_s + 1e-3,
        "headings are off the truth: sign, unit, stamps newer than the sample, or heading_noise_rad is too small",
    )  # fmt: skip


def _beside(track: list[TrackSample]) -> list[tuple[TrackSample, float, float, float]]:
    """Return samples with the true pose at their stamps, interpolated between two readings of the truth."""
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


def _way_m(track: Sequence[TrackSample]) -> tuple[float, float]:
    """Return how far the velocities of samples lead, as if they changed evenly from one to the next."""
    x_m = y_m = 0.0
    for one, other in pairwise(track):
        half_s = 0.5 * (other.at_s - one.at_s)
        x_m += half_s * (one.state.vx_m_s + other.state.vx_m_s)
        y_m += half_s * (one.state.vy_m_s + other.state.vy_m_s)
    return x_m, y_m


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
            inner = [each for each in seen if first.at_s <= each.at_s <= last.at_s]
            fast = [math.hypot(each.state.vx_m_s, each.state.vy_m_s) for each in inner]
            passed_s, (way_x, way_y) = last.at_s - first.at_s, _way_m(inner)
            off = math.hypot(way_x - (last.x_m - first.x_m), way_y - (last.y_m - first.y_m)) / passed_s
            if min(fast) > 0.5 * caps.v_max_m_s and max(fast) - min(fast) < 0.05 * caps.v_max_m_s:
                # From one sample to the next the speed may have changed at any moment.
                step_m_s = max(abs(after - before) for before, after in pairwise(fast))
                worst = max(worst, off - 0.5 * step_m_s * TICK_S / passed_s)
            lag = max(lag, off)
    general = 0.05 * caps.v_max_m_s
    noise_m_s = general if caps.speed_noise_m_s is None else caps.speed_noise_m_s
    slack_m_s = caps.v_max_m_s * bench.read_s / window_s + 1e-4
    bench.measure(
        "speed_noise_m_s", worst, noise_m_s, slack_m_s,
        "velocities are off the truth: another unit or frame, too low, late, or speed_noise_m_s is declared too small",
    )  # fmt: skip
    # Ways over a window may differ by the change of speed within one period and the sample's age.
    late_s = caps.sample_age_s + caps.setpoint_period_s + TICK_S
    bench.measure(
        "speed_lag_m_s", lag, noise_m_s + caps.v_max_m_s * min(late_s / (2.0 * window_s), 1.0), slack_m_s,
        "while the speed changes velocities lag behind it: they are filtered, or those of an earlier sample",
    )  # fmt: skip
