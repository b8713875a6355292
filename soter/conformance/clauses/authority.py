"""Authority: one controller is in charge; a switch pre-empts, flushes and is confirmed in bounded time."""

from __future__ import annotations

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.track import quantile
from soter.conformance.trials import Shuttle, Trial, measure_braking
from soter.sdk import Controller, GoalStatus, Robot

_TWO = 2
_SILENT_S = 12.0
_ALTERNATIONS = 1000
_CHECKED = 100
_HAND_OVERS_IN_PROCESS = 60
_HAND_OVERS = 26


@clause("authority.preempts")
def preempts(bench: Bench) -> None:
    """A switch ends the other's goal as PREEMPTED at once and is effective within the latency."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.8))
    switch = robot.switch_ac_sc(Controller.SC, "conformance")
    bench.require_status(goal, GoalStatus.PREEMPTED, "the goal of a controller that lost charge must end")
    bench.run(1.0, lambda: switch.effective_s is not None)
    effective_s = switch.effective_s
    bench.require(
        effective_s is not None,
        "a switch was not effective within 1 s: switch_ac_sc() is overridden; fill _hand_over() instead",
    )
    assert effective_s is not None
    bench.measure(
        "switch_effective_s", effective_s - switch.requested_s, bench.caps.latency_s, 0.0,
        "the old controller's stream is shut too late",
    )  # fmt: skip


@clause("authority.keeps")
def keeps(bench: Bench) -> None:
    """A controller that was given control keeps it while leases are renewed, however long it says nothing."""
    robot = bench.open_one(Controller.SC)
    began_s = bench.now_s
    bench.expect_still(robot, _SILENT_S, "it moves although nothing was asked of it")
    lost = next(
        (each for each in bench.since(robot, began_s) if each.state.controller not in (Controller.SC, None)), None
    )
    why = "a mux that gives way to the other input when one says nothing, which a lease that is renewed must prevent"
    if lost is not None:
        bench.fail(
            f"nobody has switched, and {lost.at_s - began_s:.1f} s after the last command the sample says that the "
            f"{lost.state.controller} is in charge and not the SC: {why}"
        )
    bench.go(
        robot, bench.place(robot, 0.3), Controller.SC,
        cause=f"the SC was in charge and said nothing for {_SILENT_S:.0f} s, and its goal is not driven to: {why}",
    )  # fmt: skip


@clause("authority.flushes", truth=True)
def flushes(bench: Bench) -> None:
    """A switch flushes what the other had in flight, on the vehicle too: the robot stops."""
    robot = bench.open_one()
    for old, to, ahead in ((Controller.AC, Controller.SC, 0.9), (Controller.SC, Controller.AC, -0.9))[
        : bench.trials(_TWO)
    ]:
        bench.get_going(robot, bench.place(robot, ahead), old)
        robot.switch_ac_sc(to, "conformance")
        bench.expect_stop(robot, f"_hand_over() to the {to} leaves the old controller's set-points, or comes late")


@clause("authority.at_once", truth=True)
def at_once(bench: Bench) -> None:
    """A switch flushes a goto right before it too, and one to and fro at once flushes what was in force."""
    robot = bench.open_one()
    robot.goto(bench.place(robot, 0.8), Controller.AC)
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.run(bench.caps.latency_s + 2 * TICK_S)
    bench.expect_still(
        robot, 1.5, "a switch leaves in force what the robot has not begun to do: flush it in whatever state it is"
    )
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.get_going(robot, bench.place(robot, 0.9))
    for to in (Controller.SC, Controller.AC):
        robot.switch_ac_sc(to, "conformance")
    bench.expect_stop(
        robot, "two switches at once, to and fro, are none to the vehicle, which looks at the last one only: "
        "each flushes"
    )  # fmt: skip


@clause("authority.while_dead")
def while_dead(bench: Bench) -> None:
    """A cancel or a switch made while the lease is dead counts: a renewal revives nothing."""
    robot = bench.open_one()
    for what in ("a cancel", "a switch"):
        goal = bench.get_going(robot, bench.place(robot, 0.9))
        bench.run(bench.orphaned_s() + TICK_S, renew=False)
        if what == "a cancel":
            goal.cancel()
        else:
            robot.switch_ac_sc(Controller.SC, "conformance")
        bench.run(bench.caps.latency_s + 2 * TICK_S)
        bench.expect_still(
            robot, 1.5, f"{what} while the lease is dead is lost: the renewal revives what it was to end"
        )


@clause("authority.obeys_at_once", truth=True)
def obeys_at_once(bench: Bench) -> None:
    """After a switch the new controller's goal moves the robot within the latency."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    at = bench.look(robot)
    called_s = bench.now_s
    robot.switch_ac_sc(Controller.SC, "conformance")
    target = bench.place(robot, -0.5)
    goal = robot.goto(target, Controller.SC)
    caps = bench.caps
    begin_s = caps.latency_s + caps.setpoint_period_s + TICK_S + caps.sample_age_s
    allowed = caps.v_max_m_s * begin_s + caps.v_max_m_s**2 / (2 * caps.brake_m_s2)
    bench.arrive(
        goal, "a goto right after a switch is ignored, or sent with an earlier target: streaming must end before it"
    )
    beyond = max(
        at.distance_m(each.x_m, each.y_m) for each in bench.since(robot, called_s)[: 1 + int((begin_s + 0.5) / TICK_S)]
    )
    bench.measure(
        "switch_reaction_m", beyond, allowed, bench.still_m + caps.tube_m,
        "the old controller's set-points stay in force for longer than the latency",
    )  # fmt: skip
    _from_rest(bench, robot)


def _from_rest(bench: Bench, robot: Robot) -> None:
    """Judge whether a robot at rest gets going within the latency when a new controller sends a goal at once."""
    bench.settle()
    robot.switch_ac_sc(Controller.AC, "conformance")
    shuttle = Shuttle(bench, robot)
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.settle(closely=True)
    shuttle.measure_start(
        "switch_to_motion_s", "a goto right after a switch waits: the vehicle is deaf until the switch is over",
        lambda: robot.switch_ac_sc(Controller.AC, "conformance"),
    )  # fmt: skip


@clause("authority.confirmed", needs=("reports_controller",))
def confirmed(bench: Bench) -> None:
    """A switch is confirmed by the robot's own report."""
    robot = bench.open_one(Controller.SC)
    slowest_s = 0.0
    caps = bench.caps
    bound_s = 2 * caps.latency_s + caps.sample_age_s
    for to in (Controller.AC, Controller.SC) * 3:
        switch = robot.switch_ac_sc(to, "conformance")
        bench.run(bound_s + 1.0, lambda switch=switch: switch.confirmed_s is not None)  # type: ignore[misc]
        bench.require(
            switch.confirmed_s is not None and bench.look(robot).state.controller is to,
            f"the robot never reported {to} in charge: RobotState.controller is not the vehicle's own report",
        )
        assert switch.confirmed_s is not None
        slowest_s = max(slowest_s, switch.confirmed_s - switch.requested_s)
        bench.run(0.2)
    bench.measure(
        "switch_confirmed_s", slowest_s, bound_s, TICK_S + caps.setpoint_period_s, "the vehicle hands over too slowly"
    )


@clause("authority.idempotent")
def idempotent(bench: Bench) -> None:
    """A switch to the controller in charge renews the lease and disturbs nothing, nor does a hand-over sent again."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.8))
    # Samples that do not name the goal in progress now need not do so later.
    numbered = robot.read_state().goal_id == goal.id

    def renew() -> bool:
        robot.switch_ac_sc(Controller.AC, "conformance")
        return not goal.active

    bench.run(bench.way_s(), renew, renew=False)
    bench.require_status(
        goal,
        GoalStatus.REACHED,
        "switch_ac_sc() to the same controller must renew the lease, and neither flush nor end goals",
    )
    bench.settle()
    goal = bench.get_going(robot, bench.place(robot, -0.8))
    robot.hand_over_again()
    cause = "_hand_over() to the controller in charge flushes that one's own goal: say again who is in charge, no more"
    bench.run(bench.caps.latency_s + bench.caps.sample_age_s + 2 * TICK_S)
    named = bench.look(robot).state.goal_id
    began_s = bench.now_s
    bench.run(bench.way_s(), lambda: not goal.active or bench.stands(robot, began_s))
    bench.require_status(goal, GoalStatus.REACHED, f"after hand_over_again() the robot stands; {cause}")
    if numbered:
        bench.require(named == goal.id, f"after hand_over_again() samples name goal {named}, not {goal.id}: {cause}")


@clause("authority.nothing_revived")
def nothing_revived(bench: Bench) -> None:
    """What was pre-empted or cancelled is not taken up again, by its controller or a hand-over that is sent again."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.settle()
    _stays_when_told_again(bench, robot, "was pre-empted")
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.run(bench.caps.latency_s + 2 * TICK_S)
    bench.expect_still(robot, 2.0, "the old goal came back with its controller: flush it on the vehicle too")
    bench.require_status(goal, GoalStatus.PREEMPTED, "a goal ends once")
    bench.get_going(robot, bench.place(robot, 0.8))
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.go(robot, bench.place(robot, 0.5, 0.2), Controller.SC)
    bench.settle()
    bench.expect_still(robot, 2.0, "what was pre-empted is taken up again once the new controller's goal is reached")
    bench.get_going(robot, bench.place(robot, -0.8), Controller.SC).cancel()
    bench.settle()
    _stays_when_told_again(bench, robot, "was cancelled")


def _stays_when_told_again(bench: Bench, robot: Robot, ended: str) -> None:
    """Fail the clause unless a robot at rest stays there when its hand-over is sent again."""
    robot.hand_over_again()
    bench.run(bench.caps.latency_s + 2 * TICK_S)
    bench.expect_still(
        robot, 1.0, f"a hand-over that is sent again brings back the goal that {ended}: what is repeated is the last "
        "message, with what was in it, and not who is in charge"
    )  # fmt: skip


@clause("authority.flood")
def flood(bench: Bench) -> None:
    """A flood of gotos by the controller not in charge does not disturb the one in charge."""
    robot = bench.open_one(Controller.SC)
    mine = robot.goto(bench.place(robot, 0.7), Controller.SC)
    statuses: set[GoalStatus] = set()

    def spam() -> bool:
        statuses.update(robot.goto(bench.place(robot, -0.8), Controller.AC).status for _ in range(20))
        return not mine.active

    bench.run(bench.way_s(), spam)
    bench.require(
        statuses == {GoalStatus.REJECTED},
        f"gotos of the controller not in charge are {sorted(each.value for each in statuses)}, expected rejected: "
        "goto() is overridden",
    )
    bench.require_status(mine, GoalStatus.REACHED, "gotos of the controller not in charge reached the vehicle")


@clause("authority.flood_then_switch", truth=True)
def flood_then_switch(bench: Bench) -> None:
    """A flood of gotos by the controller in charge does not delay a switch."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    for _ in range(500):
        robot.goto(bench.place(robot, 0.9), Controller.AC)
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.expect_stop(robot, "the switch waits behind gotos in a queue, or they are executed after it")


@clause("authority.old_cancel")
def old_cancel(bench: Bench) -> None:
    """cancel() of a goal that was pre-empted does not stop the controller in charge."""
    robot = bench.open_one()
    old = robot.goto(bench.place(robot, 0.8), Controller.AC)
    robot.switch_ac_sc(Controller.SC, "conformance")
    mine = bench.get_going(robot, bench.place(robot, 0.7), Controller.SC)
    old.cancel()
    bench.arrive(mine, "cancel() of a pre-empted goal stopped the controller in charge")


@clause("authority.alternations")
def alternations(bench: Bench) -> None:
    """Of many switches to and fro each is reported, none is lost or out of order, and the robot still obeys."""
    robot, caps = bench.open_one(), bench.caps
    for number in range(_ALTERNATIONS):
        to = Controller.AC if number % 2 else Controller.SC
        robot.switch_ac_sc(to, "conformance")
        robot.goto(bench.place(robot, 0.5 if number % 2 else -0.5), to)
        if number % 50 == 0:
            bench.run(TICK_S)
    within_s = caps.latency_s + caps.sample_age_s + caps.jitter_s + 2 * TICK_S
    goal = robot.goto(bench.place(robot, 0.5), robot.in_charge)
    bench.run(within_s)
    numbered = robot.read_state().goal_id == goal.id
    for number in range(_ALTERNATIONS if caps.in_process else _CHECKED):
        to = Controller.AC if number % 2 else Controller.SC
        switch = robot.switch_ac_sc(to, "conformance")
        goal = robot.goto(bench.place(robot, 0.5), to)

        def done(to: Controller = to, named: int | None = goal.id if numbered else None) -> bool:
            state = robot.read_state()
            return state.controller in (to, None) and named in (state.goal_id, None)

        # No renewals meanwhile: they repeat the active controller, and would hide a hand-over that was lost.
        bench.run(within_s, done, renew=False)
        state = bench.look(robot).state
        found, old = state.controller, state.stamp_s < switch.requested_s + caps.latency_s
        why = "the report is old, and says nothing of it" if old else "it was lost, queued or came out of order"
        bench.require(
            found in (to, None),
            f"{within_s:.2f} s after switch number {number + 1} to {to} the robot reports {found} in charge, of "
            f"{state.age_s(bench.now_s):.2f} s ago: {why}",
        )
        bench.require(
            not numbered or state.goal_id == goal.id,
            f"{within_s:.2f} s after switch number {number + 1} samples name goal {state.goal_id}, not {goal.id}, sent "
            "right behind it: what is sent together with a hand-over is lost now and then",
        )
    bench.go(
        robot,
        bench.place(robot, 0.2, 0.4),
        cause=f"after {_ALTERNATIONS} switches the AC is not obeyed: hand-overs are queued, lost or reordered",
    )


@clause("authority.effective", truth=True)
def effective(bench: Bench) -> None:
    """Each of many switches stops what the other had in flight within the latency, and none is reported before."""
    robot, caps = bench.open_one(), bench.caps
    stops: list[Trial] = []
    early: list[float] = []

    def hand_back() -> None:
        robot.switch_ac_sc(Controller.AC, "conformance")
        bench.run(caps.latency_s + 2 * TICK_S)

    trials = Shuttle(bench, robot).trials(
        _HAND_OVERS_IN_PROCESS if caps.in_process else bench.trials(_HAND_OVERS),
        lambda _: robot.switch_ac_sc(Controller.SC, "conformance"),
        cause="a hand-over was lost, and left the old controller's target in force", after=hand_back,
    )  # fmt: skip
    for trial in trials:
        stops.append(trial)
        reports = [each.state for each in bench.since(robot, trial.called_s)]
        said_s = next((each.stamp_s for each in reports if each.controller is Controller.SC), None)
        if said_s is not None:
            early.append(trial.called_s + trial.end.begins_s - said_s)
    slow = [trial.end.begins_s for trial in stops]
    bench.measure(
        "switch_s", quantile(slow, 0.9), caps.latency_s, bench.fit_s,
        "the vehicle hands over later than latency_s", spread=slow,
    )  # fmt: skip
    bench.measure(
        "switch_worst_s", max(slow), caps.latency_s + caps.jitter_s, bench.fit_s,
        "one hand-over of many was late: it was lost, and made good by something later",
    )  # fmt: skip
    measure_braking(bench, stops, "after a switch")
    if early:
        bench.measure(
            "reported_early_s", quantile(early, 0.5), caps.setpoint_period_s, 2.0 * bench.read_s + ROUNDING,
            "a switch is reported before it is effective: report what the vehicle does, and not what it was told",
            spread=early,
        )  # fmt: skip
