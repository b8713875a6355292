"""Several robots: a command to one never moves another, and no robot hands out another's samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import cycle

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.clauses import goals, leases, samples, state
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.track import TrackSample, quantile
from soter.conformance.trials import Shuttle
from soter.sdk import Controller, GoalStatus, Robot

_SLOWLY = 0.5
_FAST = 0.7
_TRIALS = 3
_SAME = 2e-3
_TWO = 2
_SEVERAL = 3
_MOSTLY = 0.9
_TURNS, _SHARE_OF_TURN = 6, 0.8
_DRIVES_S = 4.0


@clause("several.ids", truth=True)
def ids(bench: Bench) -> None:
    """Robots come in the order asked for, each with its own id, place and samples."""
    robots = bench.open(2)
    bench.require(
        robots[0].id != robots[1].id and [robot.spec.id for robot in robots] == [robot.id for robot in robots],
        f"the robots have the ids {[robot.id for robot in robots]}: each needs its own, that of its spec",
    )
    for robot in robots:
        sample = bench.look(robot)
        bench.require(
            sample.state.robot_id == robot.id,
            f"robot {robot.id} hands out a sample of robot {sample.state.robot_id}: keep each robot's samples apart",
        )
        off_m = sample.distance_m(robot.spec.x_m, robot.spec.y_m)
        bench.require(
            off_m <= bench.caps.position_noise_m + bench.back_m + 0.02,
            f"robot {robot.id} stands {off_m:.2f} m from its start: it has another robot's samples (check whom a "
            "message is from, not who sent last)",
        )
    apart = math.dist((robots[0].spec.x_m, robots[0].spec.y_m), (robots[1].spec.x_m, robots[1].spec.y_m))
    bench.require(apart >= bench.harness.room_m - 1e-6, "the rooms of the two robots overlap: correct the harness")


@clause("several.chosen")
def chosen(bench: Bench) -> None:
    """Of the robots that are there those are opened that were asked for, and no other, in the order asked for."""
    bench.require_hook("choosing")
    most = bench.harness.robots_most
    specs = [robot.spec for robot in bench.open_raw(most).robots]
    bench.close()
    bench.opener = lambda: bench.harness.choosing((most - 1, 0))
    robots, wanted = bench.open(2), [specs[-1], specs[0]]
    left_out = []
    if bench.fleet.truth is not None or bench.harness.gives("observe"):
        # In process they are not there at all.
        with suppress(LookupError):
            left_out = [(spec, bench.true_pose(spec.id)) for spec in specs[1:-1]]
    bench.require(
        [robot.id for robot in robots] == [spec.id for spec in wanted],
        f"of the robots {[spec.id for spec in specs]}, as a fleet of all of them has them, the last and the first were "
        f"asked for, and {[robot.id for robot in robots]} opened: those of a table of addresses, or sorted; they are "
        "to come in the order asked for",
    )
    for robot, spec in zip(robots, wanted, strict=True):
        off_m = bench.look(robot).distance_m(spec.x_m, spec.y_m)
        bench.require(
            off_m <= bench.caps.position_noise_m + bench.back_m + 0.02,
            f"robot {robot.id} stands {off_m:.2f} m from its start: it has the address of another one",
        )
        bench.go(robot, bench.place(robot, 0.4), cause="its targets go to the address of another robot")
    for spec, before in left_out:
        moved_m = math.dist(before[:2], bench.true_pose(spec.id)[:2])
        bench.require(
            moved_m <= bench.still_m,
            f"robot {spec.id}, which nobody has opened, moved by {moved_m:.2f} m: it hears what is for another one, "
            f"such as one whose name begins with its own, as {wanted[0].id} may",
        )


@clause("several.goto", truth=True)
def goto(bench: Bench) -> None:
    """A goto to one robot moves that one and no other."""
    robots = bench.open_most()
    for mover in robots:
        before = [(other, bench.look(other)) for other in robots if other is not mover]
        goal = mover.goto(bench.place(mover, 0.6), Controller.AC)
        bench.run(bench.way_s(), lambda goal=goal: not goal.active)  # type: ignore[misc]
        for other, was in before:
            moved = bench.look(other).distance_m(was.x_m, was.y_m)
            bench.require(
                moved <= bench.held_m,
                f"a goto to robot {mover.id} moved robot {other.id} by {moved:.2f} m: commands are addressed to the "
                "wrong robot or broadcast, or goals are kept by their ids, which count anew for each robot",
            )
        bench.require_status(
            goal, GoalStatus.REACHED, f"a goto to robot {mover.id} does not move it: it is not sent, or is taken for "
            "one of another robot's, since goals' ids count anew for each",
        )  # fmt: skip
        bench.settle()


@clause("several.switch")
def switch(bench: Bench) -> None:
    """A switch of one robot pre-empts nothing of another."""
    *others, last = bench.open_most()
    kept = [robot.goto(bench.place(robot, 0.7), Controller.AC) for robot in others]
    bench.get_going(last, bench.place(last, 0.8))
    last.switch_ac_sc(Controller.SC, "conformance")
    for goal in kept:
        bench.arrive(goal, "a switch of one robot took charge of another")
    for robot in (*others, last):
        found = bench.look(robot).state.controller
        bench.require(
            found in (robot.in_charge, None),
            f"robot {robot.id} reports {found} in charge, expected {robot.in_charge}: hand-overs are addressed to the "
            "wrong robot, or reports are taken for another's",
        )


@clause("several.cancel", truth=True)
def cancel(bench: Bench) -> None:
    """A cancel to one robot stops that one and no other."""
    robots = bench.open_most()
    for number, stopped in enumerate(robots[: bench.trials(len(robots))]):
        others = [robot for robot in robots if robot is not stopped]
        way = -0.7 if number % 2 else 0.7
        goals = [(kept, kept.goto(bench.place(kept, way), Controller.AC)) for kept in others]
        bench.get_going(stopped, bench.place(stopped, way)).cancel()
        for kept, goal in goals:
            bench.arrive(
                goal, f"a cancel to robot {stopped.id} stopped robot {kept.id}: stops are broadcast, or name goals by "
                "their ids, which count anew for each robot",
            )  # fmt: skip


@clause("several.charge", needs=("reports_battery",))
def charge(bench: Bench) -> None:
    """Each robot reports its own charge: that of one that drives falls, while that of one on its charger does not."""
    if not bench.harness.charges_at_start:
        raise NotTested("not declared: the harness's attribute 'charges_at_start'")
    robots = bench.open(2)
    for driver, other in (robots, robots[::-1]):
        bench.go(driver, bench.place(driver, 0.8))
        before = [bench.look(robot).state.battery or 0.0 for robot in (driver, other)]
        goal = driver.goto(bench.place(driver, -0.8), Controller.AC)
        bench.run(bench.way_s(), lambda goal=goal: not goal.active)  # type: ignore[misc]
        drove, stood = ((bench.look(robot).state.battery or 0.0) for robot in (driver, other))
        bench.require(
            drove <= before[0] and stood >= before[1],
            f"robot {driver.id} drove and its charge went from {before[0]:.4f} to {drove:.4f}, while that of robot "
            f"{other.id} on its charger went from {before[1]:.4f} to {stood:.4f}: "
            f"{_whose(bench, {driver.id: drove, other.id: stood})}",
        )
        bench.go(driver, bench.place(driver, 0.0, radius_m=bench.near_m))


def _whose(bench: Bench, said: dict[int, float]) -> str:
    """Return the likely cause of a charge that rose while its robot drove, or fell on the charger."""
    truth = bench.fleet.truth
    real = {} if truth is None else truth.report().charges
    mixed_up = "one has the charge of the other"
    lags = "it lags behind: smoothed, or old"
    if not said.keys() <= real.keys():
        return f"{mixed_up}, or {lags}"
    off = max(abs(each - real[number]) for number, each in said.items())
    of_other = min(abs(each - real[other]) for (_, each), other in zip(said.items(), reversed(said), strict=True))
    return mixed_up if of_other < _SAME < off else lags


@clause("several.second")
def second(bench: Bench) -> None:
    """What holds of the first robot holds of the second."""
    bench.judged = 2
    starts = [state.start] if bench.harness.starts_robots else []
    for check in (*starts, state.frame, state.velocity, state.yaw_rate, samples.age, goals.cancel, leases.lease):
        check(bench)
        bench.close()


@clause("several.last")
def last(bench: Bench) -> None:
    """What holds of two robots holds of the last of many: a cancel stops it, and so does its lease when it ends."""
    bench.judged = bench.harness.robots_most
    if bench.judged <= _TWO:
        raise NotTested("not declared: the harness's attribute 'robots_most'")
    for check in (state.start, goals.cancel):
        check(bench)
        bench.close()
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, -0.4))
    state.moves_as_said(bench, bench.tracks[robot.id])
    bench.get_going(robot, bench.place(robot, 0.9))
    bench.expect_stop(
        robot, "what watches the leases of two robots leaves out those behind them", renew=False,
        extra_s=bench.caps.lease_s,
    )  # fmt: skip


@clause("several.lease", truth=True)
def lease(bench: Bench) -> None:
    """Renewing one robot's lease keeps no other alive."""
    *others, last = bench.open_most()
    bench.get_going(last, bench.place(last, 0.9))

    def renew_others() -> bool:
        for robot in others:
            robot.renew_lease()
        return False

    bench.run(bench.orphaned_s() + TICK_S + bench.caps.sample_age_s, renew_others, renew=False)
    rest = bench.look(last)
    bench.run(0.5, renew_others, renew=False)
    later = bench.look(last)
    moved = later.distance_m(rest.x_m, rest.y_m)
    bench.require(
        moved <= bench.held_m,
        f"robot {last.id} went on by {moved:.2f} m without a renewal while the others were renewed: the lease is the "
        "fleet's instead of the robot's",
    )


@clause("several.both")
def both(bench: Bench) -> None:
    """While one robot drives the other one obeys as soon as it does alone."""
    robots, caps = bench.open(2), bench.caps
    for mine, other in (robots, robots[::-1]):
        goal = other.goto(bench.place(other, 0.9, speed_m_s=_SLOWLY * caps.v_max_m_s), Controller.AC)
        begins_s = [trial.end.begins_s for trial in Shuttle(bench, mine).trials(_TRIALS, lambda goal: goal.cancel())]
        goal.cancel()
        bench.measure(
            "both_s", max(begins_s), caps.latency_s + caps.jitter_s, bench.fit_s,
            f"while robot {other.id} drives robot {mine.id} obeys later: they share what carries or makes commands",
            spread=begins_s,
        )  # fmt: skip


@clause("several.close")
def close(bench: Bench) -> None:
    """Closing one robot leaves the others working, and their leases ending."""
    first, second = bench.open(2)
    first.close(5.0)
    del bench.tracks[first.id]
    clock = bench.fleet.clock

    def drive(seconds: float, until: Callable[[], bool] = lambda: False, *, renew: bool = True) -> TrackSample:
        ends_s = clock.now() + seconds
        while not until() and clock.now() < ends_s:
            clock.sleep_until(clock.now() + TICK_S)
            bench.look(second)
            if renew:
                second.renew_lease()
        return bench.look(second)

    goal = second.goto(bench.place(second, 0.5), Controller.AC)
    drive(bench.way_s(), lambda: not goal.active)
    bench.require_status(
        goal, GoalStatus.REACHED, "close() of one robot closed what the others share; that is Fleet._close()"
    )
    drive(bench.settle_s())
    second.goto(bench.place(second, -0.85), Controller.AC)
    fast_m_s = _FAST * bench.caps.v_max_m_s
    drive(bench.way_s(), lambda: bench.tracks[second.id][-1].speed_m_s > fast_m_s)
    bench.require(
        bench.tracks[second.id][-1].speed_m_s > fast_m_s,
        f"after another robot was closed its second goal does not bring it to {fast_m_s:.2f} m/s",
    )
    at = drive(bench.orphaned_s() + bench.caps.sample_age_s, renew=False)
    moved_m = drive(1.0, renew=False).distance_m(at.x_m, at.y_m)
    bench.require(
        moved_m <= bench.still_m,
        f"after another robot was closed it drives on without renewals, by {moved_m:.2f} m in a second: what watches "
        "the leases of all ended with the one",
    )


@clause("several.age")
def age(bench: Bench) -> None:
    """While all robots turn, and then drive, the latest sample of each is no older than declared."""
    robots, caps = bench.open(min(max(bench.harness.robots_most, 2), _SEVERAL)), bench.caps
    turn_s = _SHARE_OF_TURN * math.pi / caps.yaw_rate_max_rad_s
    for doing, lasts_s, every_s in (("turn", _TURNS * turn_s, turn_s), ("drive", _DRIVES_S, bench.way_s())):
        seen = _ages_of(bench, robots, lasts_s, every_s)
        worst = max(quantile(each, _MOSTLY) for each in seen.values())
        if worst > caps.sample_age_s and not caps.in_process:
            # One pause of the host makes many samples old; a fault of the robots' shows again.
            seen = _ages_of(bench, robots, lasts_s, every_s)
        for robot_id, ages_s in seen.items():
            bench.measure(
                "sample_age_s", quantile(ages_s, _MOSTLY), caps.sample_age_s, 1e-4,
                f"while {len(robots)} robots {doing} the samples of robot {robot_id} come too seldom: robots take "
                "turns, or one that is busy says less", spread=ages_s,
            )  # fmt: skip


def _ages_of(bench: Bench, robots: Sequence[Robot], lasts_s: float, every_s: float) -> dict[int, list[float]]:
    """Return the ages of the latest samples of robots that are sent ahead and back in turn, every so often."""
    ages_s: dict[int, list[float]] = {robot.id: [] for robot in robots}
    ways = cycle((-0.8, 0.8))
    due_s = bench.now_s

    def look() -> bool:
        nonlocal due_s
        if bench.now_s >= due_s:
            due_s += every_s
            ahead = next(ways)
            for robot in robots:
                robot.goto(bench.place(robot, ahead), Controller.AC)
        for robot in robots:
            # Taken before the read: the host's delay between the two is not the sample's age.
            now_s = bench.now_s
            ages_s[robot.id].append(robot.read_state().age_s(now_s))
        return False

    bench.run(lasts_s, look, closely=True)
    return ages_s
