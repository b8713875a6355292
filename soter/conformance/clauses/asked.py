"""Asked for: a robot that is asked for a promise of its own keeps that one, and not its class's."""

from __future__ import annotations

from dataclasses import replace

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.clauses import bounds, clocks, leases, speeds
from soter.conformance.driver import TICK_S
from soter.conformance.figure import Failed
from soter.sdk import Capabilities, Controller

_NARROWER = ("v_max_m_s", "yaw_rate_max_rad_s", "lease_s")
_SHARE = 0.75
_WEAKER = 0.25
_TWO = 2


@clause("truth.capabilities.asked", tier=Tier.TRUTH)
def asked(bench: Bench) -> None:
    """A robot that is asked for less speed, less of a turn, a shorter lease or other brakes declares and keeps that."""
    bench.require_hook("promising")
    bench.open_one()
    wanted = replace(bench.caps, **{name: _SHARE * getattr(bench.caps, name) for name in _NARROWER})
    bench.close()
    bench.opener = lambda: bench.harness.promising(wanted)
    for check in (speeds.v_max, bounds.yaw_rate, leases.lease):
        robot = bench.open_one()
        wider = robot.capabilities.widened_beyond(wanted)
        bench.require(
            wider is None,
            f"asked to promise {wider} = {getattr(wanted, wider or '', None)}, it promises "
            f"{getattr(robot.capabilities, wider or '', None)}: what a robot is asked for (RobotSpec.promised) is left "
            "out; `self.declared` has it, the class's own does not",
        )
        bench.close()
        try:
            check(bench)
        except Failed as failure:
            raise Failed(
                f"asked to promise less, it keeps to what its kind declares, or rounds what it was asked for: {failure}"
            ) from failure
        bench.close()
    _keeps_it_with_the_power(bench, wanted)
    if bench.harness.robots_most >= _TWO:
        bench.opener = lambda: bench.harness.promising(wanted, _TWO)
        robots = bench.open(_TWO)
        goals = [robot.goto(bench.place(robot, 0.9), Controller.AC) for robot in robots]
        bench.run(bench.way_s(), lambda: not any(goal.active for goal in goals))
        free_m_s, asked_m_s = (bench.fastest(robot)[0].speed_m_s for robot in robots)
        bench.require(
            asked_m_s < 0.5 * (1.0 + _SHARE) * robots[0].capabilities.v_max_m_s < free_m_s,
            f"robot {robots[0].id}, of which nothing is asked, goes {free_m_s:.2f} m/s, and beside it robot "
            f"{robots[1].id}, asked for {wanted.v_max_m_s:.2f} m/s at most, {asked_m_s:.2f} m/s: what one is asked for "
            "counts for all, or for another",
        )
        bench.close()
        weaker = replace(robots[1].capabilities, brake_m_s2=_WEAKER * wanted.brake_m_s2)
        bench.opener = lambda: bench.harness.promising(weaker, _TWO)
        *_, robot = bench.open(_TWO)
        began, target = bench.look(robot), bench.place(robot, 0.8, radius_m=bench.near_m)
        bench.go(robot, target)
        bench.settle()
        way_m = began.distance_m(target.x_m, target.y_m)
        gone_m = max(each.distance_m(began.x_m, began.y_m) for each in bench.tracks[robot.id])
        bench.measure(
            "weak_overshoot_m", max(gone_m - way_m, 0.0), weaker.overshoot_m, bench.still_m,
            f"robot {robot.id}, whose brakes are weaker than those of robot {robots[0].id}, brakes as late for its "
            "target: what one can do counts for all",
        )  # fmt: skip


def _keeps_it_with_the_power(bench: Bench, wanted: Capabilities) -> None:
    """Fail the clause if a robot that has been off and on goes as fast as its kind, where it was asked for less."""
    robot = bench.open_one()
    impair = getattr(robot, "impair", None) if bench.caps.in_process else None
    if bench.harness.gives("restart"):
        bench.faulty = True
        bench.harness.restart(robot.id)
        bench.run(clocks.LEARNS_S)
    elif impair is not None:
        for alive in (False, True):
            impair(1.0, 1.0, 1.0, alive)
            bench.run(bench.caps.latency_s + 2 * TICK_S)
    else:
        return
    for to in (Controller.SC, Controller.AC):
        robot.switch_ac_sc(to, "conformance")
        bench.run(bench.caps.latency_s + 2 * TICK_S)
    bench.go(robot, bench.place(robot, 0.9))
    fastest, off = bench.fastest(robot)
    bench.measure(
        "asked_m_s", fastest.speed_m_s, wanted.v_max_m_s, off * wanted.v_max_m_s + bench.speed_noise_m_s,
        "what it was asked for is lost with the power: off and on again, it goes as fast as its kind",
    )  # fmt: skip
    bench.close()
