"""Ramps: how hard a robot brakes, and how it gains speed, each compared with what is declared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import CRUISE_S, Ramp, fit_start, fit_stop, quantile
from soter.conformance.trials import Shuttle, measure_braking, share_off
from soter.errors import Unsupported
from soter.sdk import Controller, Robot

_STOPS = 12
_REVERSALS = 3
_ALMOST_AT_REST, _AT_SPEED = 0.2, 0.95
_SLOW_STOPS = 4
_BLUR = 4.0
_LEAST_M_S = 0.02
_ASIDE = 0.12
_EVEN = 0.7
_STEERS_S = 0.3
_STEERS_RAD_S = 0.25


@clause("bounds.braking", truth=True)
def braking(bench: Bench) -> None:
    """From the first deceleration on the robot stops as brake_m_s2 promises, whatever latency_s would still allow."""
    robot = bench.open_one()
    shuttle, cap_m_s = Shuttle(bench, robot), 0.5 * bench.caps.v_max_m_s
    trials = [*shuttle.trials(bench.trials(_STOPS), lambda goal: goal.cancel())]
    measure_braking(bench, trials, "after a cancel")
    if cap_m_s > _LEAST_M_S:
        slow = [*shuttle.trials(bench.trials(_SLOW_STOPS), lambda goal: goal.cancel(), speed_m_s=cap_m_s)]
        # From half the speed, the braking distance to measure is only a quarter.
        measure_braking(bench, slow, "after a cancel at half its speed", "slow_brake_m_s2", _BLUR)
    if bench.caps.in_process:
        _in_curves(bench, robot)


def _in_curves(bench: Bench, robot: Robot) -> None:
    """Judge how hard a robot brakes while it steers."""
    seen = []
    for left in (_ASIDE, -_ASIDE) * bench.trials(_REVERSALS):
        bench.go(robot, bench.place(robot, -0.7))
        bench.settle()
        bench.get_going(robot, bench.place(robot, 0.8))
        bench.run(2.0 * CRUISE_S)
        goal = robot.goto(bench.place(robot, 0.8, left), Controller.AC)
        steers = bench.run(_STEERS_S, lambda: abs(bench.tracks[robot.id][-1].yaw_rate_rad_s) > _STEERS_RAD_S)
        # A robot that comes to rest before it turns does not steer.
        steers = steers and bench.tracks[robot.id][-1].speed_m_s > _EVEN * bench.caps.v_max_m_s
        called_s = bench.now_s
        goal.cancel()
        bench.settle()
        end = fit_stop(bench.tracks[robot.id], called_s)
        if steers and end is not None:
            seen.append(end.rate_m_s2)
    if seen:
        brake = bench.caps.brake_m_s2
        bench.measure(
            "curve_brake_m_s2", min(seen), brake, _BLUR * share_off(bench, brake, at_least=True) * brake,
            "while it steers it brakes more weakly than straight ahead, as if both shared what its wheels can do",
            at_least=True, spread=seen,
        )  # fmt: skip


@clause("bounds.acceleration", truth=True, needs=("accel_m_s2",))
def acceleration(bench: Bench) -> None:
    """The robot gains speed no faster than accel_m_s2."""
    robot = bench.open_one()
    accel = bench.caps.accel_m_s2 or 0.0
    trials = Shuttle(bench, robot).trials(bench.trials(_STOPS), lambda goal: goal.cancel())
    seen = [trial.start.rate_m_s2 for trial in trials]
    bench.measure(
        "accel_m_s2", quantile(seen, 0.5), accel, share_off(bench, accel) * accel,
        "it gains speed faster than promised: accel_m_s2 is declared too small", spread=seen,
    )  # fmt: skip
    back = [ramp.rate_m_s2 for ramp in _reversals(bench, robot)]
    if back:
        bench.measure(
            "accel_m_s2", quantile(back, 0.5), accel, share_off(bench, accel) * accel,
            "where it turns from forwards to backwards without a rest it gains speed faster than promised", spread=back,
        )  # fmt: skip


def _reversals(bench: Bench, robot: Robot) -> Iterator[Ramp]:
    """Yield how the robot got going backwards directly from driving forwards."""

    def share() -> float:
        return bench.tracks[robot.id][-1].speed_m_s / bench.caps.v_max_m_s

    for _ in range(bench.trials(_REVERSALS) if bench.caps.reverses else 0):
        bench.go(robot, bench.place(robot, -0.3))
        bench.settle()
        bench.get_going(robot, bench.place(robot, 0.9), closely=True)
        at, called_s = bench.look(robot), bench.now_s
        with suppress(Unsupported):
            back = bench.place(robot, -0.85)._replace(heading_rad=at.heading_rad)
            robot.goto(back, Controller.AC)
            bench.run(bench.orphaned_s(), lambda: share() < _ALMOST_AT_REST, closely=True)
            bench.run(2.0 * bench.gains_s + CRUISE_S, lambda: share() > _AT_SPEED, closely=True)
            bench.run((1.0 - _AT_SPEED) * bench.gains_s + CRUISE_S + TICK_S, closely=True)
            seen = bench.since(robot, called_s)
            turns_s = max(seen, key=lambda each: each.distance_m(back.x_m, back.y_m)).at_s
            ramp = fit_start([each for each in seen if each.at_s >= turns_s], turns_s)
            if ramp is not None:
                bench.ramps.append(ramp)
                yield ramp
