"""Dead man: motion lives on a lease that only its renewal renews."""

from __future__ import annotations

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.sdk import Controller, GoalStatus

_MOVING_SHARE = 0.4
_RENEWED = "; only renew_lease() and switch_ac_sc() may renew it"


@clause("deadman.silence", truth=True)
def silence(bench: Bench) -> None:
    """When SOTER falls silent, the robot stops within the lease."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    called_s = bench.now_s
    caps = bench.caps
    allowed_s = bench.orphaned_s()
    before = bench.look(robot)
    clock = bench.fleet.clock
    clock.sleep_until(called_s + allowed_s + caps.sample_age_s)
    rest = bench.look(robot)
    clock.sleep_until(clock.now() + 1.0)
    later = bench.look(robot)
    slipped = later.distance_m(rest.x_m, rest.y_m)
    bench.require(
        slipped <= bench.still_m,
        f"{allowed_s:.2f} s after the last call it still moves, {slipped:.3f} m within another second: the last "
        "set-point is repeated for ever, or a timer or thread renews the lease" + _RENEWED,
    )
    allowed_m = caps.v_max_m_s * (allowed_s + caps.sample_age_s)
    bench.measure(
        "silent_run_m", rest.distance_m(before.x_m, before.y_m), allowed_m, bench.still_m, "the lease lives too long"
    )


@clause("deadman.reading", truth=True)
def reading(bench: Bench) -> None:
    """Reading the state does not renew the lease."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    bench.expect_stop(
        robot, bench.now_s, "read_state() renews the lease" + _RENEWED, extra_s=bench.caps.lease_s, renew=False
    )


@clause("deadman.goto", truth=True)
def goto(bench: Bench) -> None:
    """A goto does not renew the lease, however many are sent."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))

    def spam() -> bool:
        robot.goto(bench.place(robot, 0.9), Controller.AC)
        return False

    allowed_s = bench.orphaned_s() + TICK_S
    bench.run(allowed_s + bench.caps.sample_age_s, spam, renew=False)
    rest = bench.look(robot)
    bench.run(0.5, spam, renew=False)
    later = bench.look(robot)
    slipped = later.distance_m(rest.x_m, rest.y_m)
    bench.require(
        slipped <= bench.still_m,
        f"{allowed_s:.2f} s after the last renewal it still moves while gotos are sent, {slipped:.3f} m within half a "
        "second: goto() renews the lease, so that a runaway controller keeps itself alive" + _RENEWED,
    )


@clause("deadman.kept_alive")
def kept_alive(bench: Bench) -> None:
    """While the lease is renewed each tick the robot does not stop."""
    robot = bench.open_one()
    goal = bench.get_going(robot, bench.place(robot, 0.9))
    began_s = bench.now_s
    # Up to where it may begin to brake for the target.
    far_m = 0.3 * bench.harness.room_m / 2.0
    bench.run(
        bench.way_s(),
        lambda: bench.tracks[robot.id][-1].distance_m(goal.target.x_m, goal.target.y_m) < far_m or not goal.active,
    )
    seen = bench.since(robot, began_s)
    slowest = min(sample.speed_m_s for sample in seen)
    bench.require(
        slowest > _MOVING_SHARE * bench.caps.v_max_m_s,
        f"with the lease renewed every {TICK_S:g} s the robot slowed down to {slowest:.2f} m/s on the way: renewals do "
        "not get through, or the lease is shorter than declared",
    )


@clause("deadman.recovers")
def recovers(bench: Bench) -> None:
    """After the lease has died, renewing it makes the robot obey again."""
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.8))
    bench.run(bench.caps.lease_s + bench.caps.latency_s + 1.0, renew=False)
    goal = robot.goto(bench.place(robot, 0.2, 0.3), Controller.AC)
    bench.run(bench.way_s(), lambda: not goal.active)
    bench.require_status(goal, GoalStatus.REACHED, "a robot whose lease has died must obey again once it is renewed")
