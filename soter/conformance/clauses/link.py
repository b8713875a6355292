"""Link: how an adapter copes with messages that are lost, late, doubled or out of order, and with silence."""

from __future__ import annotations

import math
from statistics import median

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.track import quantile
from soter.errors import RobotUnavailable, Uncontrolled
from soter.sdk import Controller, GoalStatus, Link, Robot

_LOST_S = 4.0
_GONE_S = 0.2
_PATIENCE_S = 2.0
_SILENT_S = 2.0
_SLACK_S = 1.0
_RETURNS_S = 10.0
_SWITCHES = 8
_SWITCH_S = 0.6
_MOST = 0.7
_CHARGES = 0.025


def arrives(bench: Bench, robot: Robot, fault: str) -> None:
    """Fail the clause unless a robot reaches two goals in turn in spite of a fault of the link."""
    for ahead, left in ((0.5, 0.0), (0.0, 0.4)):
        target = bench.place(robot, ahead, left)
        goal = robot.goto(target, Controller.AC)
        bench.run(2 * bench.way_s(), lambda goal=goal: not goal.active)  # type: ignore[misc]
        bench.require_status(
            goal, GoalStatus.REACHED, f"with {fault} a goal must still be reached: send it again until it is seen"
        )


def _cut(bench: Bench, *robots: Robot) -> None:
    """Cut the links of robots; from then on their silence is expected."""
    bench.faulty = True
    for robot in robots:
        bench.harness.cut(robot.id)


@clause("link.age", tier=Tier.WIRE, hooks=("cut",))
def age(bench: Bench) -> None:
    """While the link is cut the age of the sample grows, and the link goes STALE, then DOWN."""
    robot = bench.open_one()
    _cut(bench, robot)
    began_s = bench.now_s
    links: list[Link] = []

    def look() -> bool:
        link = robot.read_state().link
        if not links or links[-1] is not link:
            links.append(link)
        return False

    bench.run(_LOST_S, look)
    grown_s = robot.read_state().age_s(bench.now_s)
    waited_s = bench.now_s - began_s
    bench.measure("age_after_cut_s", grown_s)
    bench.require(
        grown_s >= waited_s - bench.caps.latency_s - TICK_S,
        f"{waited_s:.1f} s after the link was cut the sample is said to be {grown_s:.2f} s old: it is stamped when it "
        "is read, or its age is computed in the receiving thread",
    )
    bench.require(
        links[-1] is Link.DOWN and Link.STALE in links,
        f"the link went {' -> '.join(link.value for link in links)}, expected UP -> STALE -> DOWN: stale_after_s or "
        "down_after_s is overridden, or read_state() is",
    )
    said = bench.fleet.lost()
    bench.require(
        not said,
        f"the link is cut, and the program that simulates its robot runs; the fleet's lost() says '{said}', which ends "
        "the run: silence is no end; ask the process itself",
    )


@clause("link.no_success", tier=Tier.WIRE, hooks=("cut",))
def no_success(bench: Bench) -> None:
    """No goal is REACHED while the link is cut, and after a long cut all of the robot is heard, and it obeys again."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9, timeout_s=bench.way_s() + 5.0))
    _cut(bench, robot)
    # By then the robot would have arrived if it had driven on.
    silent_s = bench.harness.room_m / bench.caps.v_max_m_s + 3.0
    bench.run(silent_s)
    bench.require(
        goal.status is not GoalStatus.REACHED,
        "a goal is REACHED although nothing has been heard of the robot: arrival is predicted, or silence counts as "
        "success",
    )
    bench.harness.restore(robot.id)
    bench.require(
        bench.run(5.0, lambda: robot.read_state().link is Link.UP),
        f"the link was cut for {silent_s:.0f} s, and 5 s after it came back the robot is not heard: what hears gives "
        "up for good after some seconds of silence; it must go on for as long as the robot is open",
    )
    _get_ready_again(bench, robot)
    bench.go(
        robot, bench.place(robot, -0.2, 0.3),
        cause=f"after a silence of {silent_s:.0f} s samples came back, but the way to the robot did not",
    )  # fmt: skip
    _charges_as_before(bench, robot)


def _charges_as_before(bench: Bench, robot: Robot) -> None:
    """Judge whether the charge, which may have a message of its own, is heard anew as well once the link is back."""
    if not (bench.caps.reports_battery and bench.harness.charges_at_start):
        return
    bench.go(robot, bench.place(robot, 0.0, radius_m=bench.near_m))
    low = robot.read_state().battery or 0.0
    bench.require(
        bench.run(
            _RETURNS_S + _CHARGES * robot.spec.charge_s,
            lambda: (robot.read_state().battery or 0.0) > low + ROUNDING,
        ),
        f"since the link is back the charge stays at {low:.3f} although the robot is on its charger: the rest of a "
        "sample came back with the link, and what tells the charge did not",
    )


@clause("link.stops", tier=Tier.WIRE, hooks=("cut",))
def stops(bench: Bench) -> None:
    """A robot whose link is cut stops on its own within the lease, and hears of a switch made meanwhile."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    before = bench.look(robot)
    _cut(bench, robot)
    caps = bench.caps
    bench.run(caps.lease_s + caps.latency_s + _LOST_S)
    # The goal ends now, so that the robot is still where it stopped by itself when the link is back.
    robot.switch_ac_sc(Controller.SC, "conformance")
    # It must be lost, not wait where the link is cut.
    bench.run(_GONE_S)
    bench.harness.restore(robot.id)
    bench.run(5.0, lambda: robot.read_state().link is Link.UP)
    run_m = bench.look(robot).distance_m(before.x_m, before.y_m)
    stop_s = caps.lease_s + 2 * caps.latency_s + caps.setpoint_period_s + TICK_S
    allowed_m = caps.v_max_m_s * (stop_s + caps.sample_age_s) + caps.v_max_m_s**2 / (2 * caps.brake_m_s2)
    bench.measure(
        "cut_run_m", run_m, allowed_m, bench.still_m,
        "the vehicle drives on without SOTER: the lease must live on the vehicle's side of the link",
    )  # fmt: skip
    lost = "the switch made while the link was cut is lost, or undone by what is restored when the link is back"
    bench.run(caps.latency_s + caps.sample_age_s + caps.jitter_s + 2 * TICK_S)
    found = bench.look(robot).state.controller
    bench.require(found in (Controller.SC, None), f"the robot reports {found} in charge, expected SC: {lost}")
    bench.go(robot, bench.place(robot, 0.1), Controller.SC, cause=lost)


@clause("link.reconnects", tier=Tier.WIRE, hooks=("cut",))
def reconnects(bench: Bench) -> None:
    """Once the link is back the robot works again without being opened anew, and hears what it is told as before."""
    robot = bench.open_one()
    bench.go(robot, bench.place(robot, 0.3))
    _cut(bench, robot)
    bench.run(_LOST_S)
    # Calls to an unheard robot must not fail; this goal is over when the link is back.
    robot.goto(bench.place(robot, 0.8), Controller.AC).cancel()
    bench.harness.restore(robot.id)
    came_back = bench.run(5.0, lambda: robot.read_state().link is Link.UP)
    bench.require(
        came_back, "5 s after the link came back no new sample has arrived: the adapter must reconnect by itself"
    )
    _get_ready_again(bench, robot)
    if bench.caps.reports_controller:
        _hands_over_as_before(bench, robot)
    bench.go(
        robot, bench.place(robot, -0.2, 0.3), cause="samples came back with the link, but the way to the robot did not"
    )
    bench.settle()
    bench.expect_still(robot, 1.0, "what was sent while the link was cut is delivered late")


def _hands_over_as_before(bench: Bench, robot: Robot) -> None:
    """Judge whether hand-overs come within the latency once a robot is heard again and its lease renewed."""
    taken_s: list[float] = []
    caps, until_s = bench.caps, bench.now_s + _RETURNS_S
    while len(taken_s) < _SWITCHES and bench.now_s < until_s:
        bench.run(_RETURNS_S, lambda: _renewed(robot))
        called_s, to = bench.now_s, Controller.SC if robot.in_charge is Controller.AC else Controller.AC
        robot.switch_ac_sc(to, "conformance")

        def reported_s(to: Controller = to, called_s: float = called_s) -> float:
            reports = (each.state for each in bench.since(robot, called_s))
            return next((each.stamp_s for each in reports if each.controller is to), math.inf) - called_s

        bench.run(_SWITCH_S, lambda reported_s=reported_s: reported_s() < math.inf, closely=True)  # type: ignore[misc]
        if _renewed(robot):
            taken_s.append(min(reported_s(), _SWITCH_S))
    robot.switch_ac_sc(Controller.AC, "conformance")
    if len(taken_s) == _SWITCHES:
        # A few may meet a host that is busy.
        bench.measure(
            "switch_after_s", quantile(taken_s, _MOST), caps.latency_s + caps.jitter_s + caps.setpoint_period_s,
            bench.fit_s, "since the link is back the robot is told things late: an adapter that holds back for a while "
            "after an outage, to spare a link that is bad, holds hand-overs and renewals back", spread=taken_s,
        )  # fmt: skip


def _get_ready_again(bench: Bench, *robots: Robot) -> None:
    """Wait for robots that the kit did not start, and that are heard again, as long as they say that they do not obey.

    Fail-safes of their own may have acted, so that they have to arm or to take off again.
    """
    if not bench.harness.starts_robots:
        bench.run(bench.harness.connect_timeout_s, lambda: all(_renewed(robot) for robot in robots))


def _renewed(robot: Robot) -> bool:
    """Renew a robot's lease; return whether it did what it was told, and is not being made ready again."""
    try:
        robot.renew_lease()
    except Uncontrolled:
        return False
    return True


@clause("link.revives_nothing", tier=Tier.WIRE, hooks=("cut",))
def revives_nothing(bench: Bench) -> None:
    """When the link comes back nothing moves before the lease is renewed."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))
    _cut(bench, robot)
    bench.run(bench.orphaned_s() + _SILENT_S, renew=False)
    before = bench.true_place(robot)
    bench.harness.restore(robot.id)
    bench.run(5.0, lambda: robot.read_state().link is Link.UP, renew=False)
    bench.run(1.0, renew=False)
    bench.require(goal.active, "a goal ends when the link is cut: it is in force until something ends it")
    moved_m = math.dist(before, bench.true_place(robot))
    bench.require(
        moved_m <= bench.still_m,
        f"once its link was back it moved by {moved_m:.3f} m, and nothing has renewed its lease since it was cut: "
        "what is repeated then to make up for what was lost must not renew it",
    )


@clause("link.in_time", tier=Tier.WIRE, hooks=("cut",))
def in_time(bench: Bench) -> None:
    """Of a robot that does not answer init() raises RobotUnavailable, until it does; it and close() keep their time."""
    (robot,) = bench.open_raw().robots
    _cut(bench, robot)
    began_s = robot.clock.steady_s()
    bench.require_raises(RobotUnavailable, lambda: robot.init(_PATIENCE_S), "init() of a robot whose link is cut")
    bench.measure(
        "init_s", robot.clock.steady_s() - began_s, _PATIENCE_S, _SLACK_S,
        "init() must give up after its time-out: the time of each step in it counts, not of each alone",
    )  # fmt: skip
    bench.harness.restore(robot.id)
    try:
        robot.init(bench.harness.connect_timeout_s)
    except RobotUnavailable as failure:
        bench.fail(
            f"its link is back after an init() that failed, and the next one fails, {str(failure)!r}: what an init() "
            "that has failed leaves behind, such as a connection that is half made, is in the way of the next one"
        )
    bench.close()
    robot = bench.open_one()
    _cut(bench, robot)
    bench.run(1.0)
    began_s = robot.clock.steady_s()
    robot.close(_PATIENCE_S)
    bench.measure(
        "close_s", robot.clock.steady_s() - began_s, _PATIENCE_S, _SLACK_S,
        "close() must give up after its time-out where nobody answers: the other robots wait to be stopped",
    )  # fmt: skip


@clause("link.one_of_two", tier=Tier.WIRE, hooks=("cut",))
def one_of_two(bench: Bench) -> None:
    """Cutting either robot's link costs the other one nothing."""
    robots = bench.open(2)
    for lost, kept in (robots, robots[::-1]):
        # A busy host makes samples older, too, before and after the cut.
        before_s = median(latest_ages_s(bench, kept))
        _cut(bench, lost)
        bench.measure(
            "waits_for_other_s", max(0.0, median(latest_ages_s(bench, kept)) - before_s), bench.caps.sample_age_s, 1e-4,
            f"samples of robot {kept.id} wait for those of robot {lost.id}, whose link is cut",
        )  # fmt: skip
        bench.go(
            kept,
            bench.place(kept, 0.5),
            cause=f"robot {kept.id} is held up by robot {lost.id}, whose link is cut: a call waits for it, or one "
            "thread serves both",
        )
        bench.harness.restore(lost.id)
        bench.run(5.0, lambda lost=lost: lost.read_state().link is Link.UP)  # type: ignore[misc]
        _get_ready_again(bench, lost)


@clause("link.reconnects_each", tier=Tier.WIRE, hooks=("cut",))
def reconnects_each(bench: Bench) -> None:
    """After both links were cut, each robot is itself again: its own samples, and its own targets."""
    robots = bench.open(2)
    _cut(bench, *robots)
    bench.run(_LOST_S)
    for robot in robots:
        bench.harness.restore(robot.id)
    back = bench.run(5.0, lambda: all(robot.read_state().link is Link.UP for robot in robots))
    bench.require(back, "5 s after both links came back not both robots are heard of: the adapter must reconnect each")
    _get_ready_again(bench, *robots)
    for robot, other in (robots, robots[::-1]):
        off_m = bench.look(robot).distance_m(robot.spec.x_m, robot.spec.y_m)
        bench.require(
            off_m <= bench.caps.position_noise_m + bench.back_m + 0.05 + bench.still_m,
            f"after its link came back robot {robot.id}, which stands at its start, is said to be {off_m:.2f} m from "
            f"there: it has the samples of robot {other.id}",
        )
    for robot, other in (robots, robots[::-1]):
        before = bench.look(other)
        bench.go(
            robot, bench.place(robot, 0.4), cause=f"after both links came back robot {robot.id} no longer gets its own"
        )
        moved_m = bench.look(other).distance_m(before.x_m, before.y_m)
        bench.require(
            moved_m <= bench.still_m,
            f"after both links came back a goto to robot {robot.id} moved robot {other.id} by {moved_m:.2f} m: they "
            "are confused",
        )
        bench.settle()


@clause("link.loss", tier=Tier.WIRE, hooks=("loss",))
def loss(bench: Bench) -> None:
    """With a fifth of all messages lost goals are still reached."""
    robot = bench.open_one()
    bench.faulty = True
    bench.harness.loss(0.2)
    arrives(bench, robot, "a fifth of all messages lost")


def latest_ages_s(bench: Bench, robot: Robot) -> list[float]:
    """Return how old the latest sample of a robot was, each time that it was read within a second."""
    ages: list[float] = []

    def look() -> bool:
        now_s = bench.now_s
        ages.append(robot.read_state().age_s(now_s))
        return False

    bench.run(1.0, look, closely=True)
    return ages
