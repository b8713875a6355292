"""Authority: one controller is in charge; a switch pre-empts, flushes and is confirmed in bounded time."""

from __future__ import annotations

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.sdk import Controller, GoalStatus

_ALTERNATIONS = 1000


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


@clause("authority.flushes", truth=True)
def flushes(bench: Bench) -> None:
    """A switch flushes what the other had in flight, on the vehicle too: the robot stops."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    called_s = bench.now_s
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.expect_stop(
        robot, called_s, "_hand_over() leaves the old controller's set-points in force, or comes too late"
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
    bench.run(bench.way_s(), lambda: not goal.active)
    bench.require_status(
        goal, GoalStatus.REACHED, "a goto right after a switch is ignored: streaming must end before it"
    )
    beyond = max(
        at.distance_m(each.x_m, each.y_m) for each in bench.since(robot, called_s)[: 1 + int((begin_s + 0.5) / TICK_S)]
    )
    bench.measure(
        "switch_reaction_m", beyond, allowed, bench.still_m + caps.tube_m,
        "the old controller's set-points stay in force for longer than the latency",
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
    """A switch to the controller in charge renews the lease and disturbs nothing."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.8))

    def renew() -> bool:
        robot.switch_ac_sc(Controller.AC, "conformance")
        return not goal.active

    bench.run(bench.way_s(), renew, renew=False)
    bench.require_status(
        goal,
        GoalStatus.REACHED,
        "switch_ac_sc() to the same controller must renew the lease, and neither flush nor end goals",
    )


@clause("authority.nothing_revived")
def nothing_revived(bench: Bench) -> None:
    """What was pre-empted is not taken up again when its controller is back in charge."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.run(1.5)
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.run(bench.caps.latency_s + 2 * TICK_S)
    bench.expect_still(robot, 2.0, "the old goal came back with its controller: flush it on the vehicle too")
    bench.require_status(goal, GoalStatus.PREEMPTED, "a goal ends once")


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
    called_s = bench.now_s
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.expect_stop(robot, called_s, "the switch waits behind gotos in a queue, or they are executed after it")


@clause("authority.old_cancel")
def old_cancel(bench: Bench) -> None:
    """cancel() of a goal that was pre-empted does not stop the controller in charge."""
    robot = bench.open_one()
    old = robot.goto(bench.place(robot, 0.8), Controller.AC)
    robot.switch_ac_sc(Controller.SC, "conformance")
    mine = bench.get_going(robot, bench.place(robot, 0.7), Controller.SC)
    old.cancel()
    bench.run(bench.way_s(), lambda: not mine.active)
    bench.require_status(mine, GoalStatus.REACHED, "cancel() of a pre-empted goal stopped the controller in charge")


@clause("authority.alternations")
def alternations(bench: Bench) -> None:
    """The robot survives 1000 switches to and fro and still obeys."""
    robot = bench.open_one()
    for number in range(_ALTERNATIONS):
        to = Controller.AC if number % 2 else Controller.SC
        robot.switch_ac_sc(to, "conformance")
        robot.goto(bench.place(robot, 0.5 if number % 2 else -0.5), to)
        if number % 50 == 0:
            bench.run(TICK_S)
    bench.run(bench.caps.latency_s + bench.caps.sample_age_s + 3 * TICK_S)
    state = bench.look(robot).state
    bench.require(
        state.controller in (Controller.AC, None),
        f"after {_ALTERNATIONS} switches {state.controller} is in charge, expected AC: switches are queued or "
        "reordered",
    )
    bench.go(
        robot,
        bench.place(robot, 0.2, 0.4),
        cause=f"after {_ALTERNATIONS} switches the AC is not obeyed: hand-overs are queued, lost or reordered",
    )
