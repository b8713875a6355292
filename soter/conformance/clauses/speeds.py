"""Speeds: the caps of goals, and the robot's top speed."""

from __future__ import annotations

from contextlib import suppress

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.errors import Unsupported
from soter.sdk import Controller, Robot

_TWO = 2
_LOW = 0.25
_LEAST = 0.01
_KEPT = "the cap of an earlier goal is kept, or speeds are planned for a leg as it is started from rest"
_PLANNED_ONCE = f"the speed_m_s of a goal that takes another's place on the way is not taken up: {_KEPT}"
_THE_SAME = "a goal to the place that is driven to already is taken for the same, and its speed_m_s left out"
_CRAWLS, _CRAWLS_S, _TURNS_S = 0.04, 14.0, 5.0
_GETS_ON, _RESUMES_S = 0.5, 2.0


def _measure(bench: Bench, robot: Robot, name: str, cap_m_s: float, cause: str) -> None:
    """Fail the clause if a robot was faster than a cap."""
    seen, off = bench.fastest(robot)
    if seen.speed_m_s < 0.5 * (cap_m_s + bench.caps.v_max_m_s):
        cause = f"the cap is rounded up, as to the vehicle's own steps, or run over while it speeds up; or {cause}"
    fastest = max(bench.tracks[robot.id], key=lambda each: each.speed_m_s)
    if max(abs(fastest.state.vx_m_s), abs(fastest.state.vy_m_s)) <= (1.0 + off) * cap_m_s:
        cause = f"it counts for each axis of the workspace, so that slanted legs are driven faster; or {cause}"
    bench.measure(name, seen.speed_m_s, cap_m_s, off * cap_m_s + bench.speed_noise_m_s, cause)


def _begin_at_rest(bench: Bench, robot: Robot, cap_m_s: float) -> None:
    """Wait until the robot, driven with a cap so far, is at rest, and forget the samples so far."""
    bench.settle(cap_m_s)
    bench.tracks[robot.id].clear()


def _hand_over(bench: Bench, robot: Robot, to: Controller, ahead: float, cap_m_s: float) -> None:
    """Judge whether the first goal after a hand-over keeps to its cap, equal to that of the goal before."""
    _begin_at_rest(bench, robot, cap_m_s)
    robot.switch_ac_sc(to, "conformance")
    bench.go(robot, bench.place(robot, ahead, speed_m_s=cap_m_s), to)
    _measure(
        bench, robot, "handed_over_speed_m_s", cap_m_s,
        f"the first goal of the {to} has the speed_m_s of the last one before the hand-over, and does not keep to it: "
        "the vehicle forgets it as it is handed over, and the adapter sends what has changed only; send it with each "
        "goal",
    )  # fmt: skip


@clause("goto.speed_cap", truth=True)
def speed_cap(bench: Bench) -> None:
    """A goal's speed cap is kept, also that of the first one behind a hand-over."""
    robot = bench.open_one()
    cap = 0.5 * bench.caps.v_max_m_s
    bench.go(robot, bench.place(robot, 0.8, speed_m_s=cap))
    # Within the goal's radius it drives on, to the middle.
    bench.settle(cap)
    _measure(
        bench, robot, "capped_speed_m_s", cap,
        "the goal's speed_m_s is not passed on to the vehicle, counts for a later goal, or does not count next to the "
        "target",
    )  # fmt: skip
    low = _LOW * bench.caps.v_max_m_s
    _begin_at_rest(bench, robot, cap)
    bench.go(robot, bench.place(robot, 0.4, speed_m_s=low))
    _measure(
        bench, robot, "low_speed_m_s", low,
        "a low speed_m_s is not kept: the vehicle does not go as slowly",
    )  # fmt: skip
    if bench.trials(_TWO) < _TWO:
        return
    _hand_over(bench, robot, Controller.SC, 0.2, low)
    _begin_at_rest(bench, robot, low)
    bench.go(robot, bench.place(robot, -0.1, speed_m_s=cap), Controller.SC)
    with suppress(Unsupported):
        bench.go(
            robot, bench.place(robot, 0.4, speed_m_s=cap)._replace(heading_rad=robot.spec.heading_rad), Controller.SC
        )
    _measure(
        bench, robot, "capped_speed_m_s", cap,
        "the speed_m_s of a goal of the SC, or of one with a heading, is not passed on to the vehicle",
    )  # fmt: skip
    if bench.caps.reverses:
        with suppress(Unsupported):
            _begin_at_rest(bench, robot, cap)
            back = bench.place(robot, -0.1, speed_m_s=cap, heading_rad=bench.home(robot)[2])
            bench.go(robot, back, Controller.SC)
            _measure(
                bench, robot, "capped_speed_m_s", cap,
                "backwards a goal's speed_m_s does not count: speeds are compared with their signs",
            )  # fmt: skip
    _hand_over(bench, robot, Controller.AC, 0.15, cap)
    # A cap counts for its own goal only: the next goal is driven fast again, and the one after that slowly.
    fast = bench.place(robot, -0.8)
    for to, cause in ((-0.7, _PLANNED_ONCE), (-0.8, _THE_SAME)):
        bench.get_going(robot, fast, cause=_KEPT)
        goal = robot.goto(bench.place(robot, to, speed_m_s=cap), Controller.AC)
        bench.run(bench.orphaned_s())
        bench.tracks[robot.id].clear()
        bench.arrive(goal, "a goal to the place that is driven to already, or next to it, is not driven to")
        _measure(bench, robot, "slowed_speed_m_s", cap, cause)
        bench.go(robot, bench.place(robot, 0.15))
    _begin_at_rest(bench, robot, cap)
    goal = bench.get_going(robot, bench.place(robot, 0.8, speed_m_s=cap))
    bench.run(bench.orphaned_s(), renew=False)
    bench.run(_RESUMES_S)
    goal.cancel()
    _measure(
        bench, robot, "resumed_speed_m_s", cap,
        "a goal that goes on once its lease is renewed again does not keep to its speed_m_s: what goes on is the "
        "place, and the cap, which was sent apart from it, is not set again",
    )  # fmt: skip
    _begin_at_rest(bench, robot, cap)
    goal = robot.goto(bench.place(robot, -0.95, speed_m_s=_LEAST * bench.caps.v_max_m_s), Controller.AC)
    bench.settle()
    goal.cancel()
    _measure(
        bench, robot, "least_speed_m_s", low,
        "a speed_m_s near 0 counts as none: it is rounded to 0, which the vehicle takes for no cap",
    )  # fmt: skip


@clause("goto.crawls")
def crawls(bench: Bench) -> None:
    """A robot that gets on slowly gets on: it neither leaves its way nor turns back for want of progress."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, -0.4))
    bench.settle()
    target = bench.place(robot, 0.4, speed_m_s=_CRAWLS * bench.caps.v_max_m_s)
    goal = robot.goto(target, Controller.AC)
    # A robot that stood with its back to the target turns first.
    bench.run(_TURNS_S / bench.caps.yaw_rate_max_rad_s + bench.caps.latency_s)
    began = bench.look(robot)
    bench.run(_CRAWLS_S)
    goal.cancel()
    least_m = began.distance_m(target.x_m, target.y_m)
    for each in bench.since(robot, began.at_s):
        away_m = each.distance_m(target.x_m, target.y_m)
        least_m = min(least_m, away_m)
        bench.require(
            away_m <= least_m + bench.held_m + bench.noise_m,
            f"it was sent on at {target.speed_m_s:.3g} m/s, and {each.at_s - began.at_s:.1f} s later it was "
            f"{away_m - least_m:.3f} m farther from its target than it had been: it takes slow progress for none, and "
            "backs away to try again; nobody has certified that way",
        )
    far_m = _CRAWLS * bench.caps.v_max_m_s * _CRAWLS_S
    got_m = bench.look(robot).distance_m(began.x_m, began.y_m)
    bench.measure(
        "crawled_m", got_m, _GETS_ON * far_m, bench.noise_m,
        f"sent on at {target.speed_m_s:.3g} m/s it should have got on by {far_m:.3f} m: so low a speed is suppressed "
        "as if it were 0, on its way or by its motors",
        at_least=True,
    )  # fmt: skip


@clause("goto.v_max", truth=True)
def v_max(bench: Bench) -> None:
    """Whatever speed is asked for, the robot keeps to v_max_m_s, clamped on its own side."""
    robot = bench.open_one()
    cap = bench.caps.v_max_m_s
    # Backwards first, then forwards through the whole room: some faults show only on a long run.
    ends = [bench.place(robot, at, speed_m_s=100.0) for at in (-0.9, 0.9)]

    def judge(where: str) -> None:
        _measure(
            bench, robot, "v_max_m_s", cap,
            f"{where}the speed cap is not clamped to v_max_m_s, or along each axis by itself, so that a diagonal goes "
            "faster; or v_max_m_s is declared too small",
        )  # fmt: skip

    goal = None
    if bench.caps.reverses:
        with suppress(Unsupported):
            goal = robot.goto(ends[0]._replace(heading_rad=bench.home(robot)[2]), Controller.AC)
            bench.run(bench.way_s(), lambda: not goal.active)
            judge("on its way backwards ")
    for end in ends[goal is not None :]:
        bench.go(
            robot, end, cause="the target did not get through, as where a speed_m_s far above v_max_m_s is dropped"
        )
    judge("")
