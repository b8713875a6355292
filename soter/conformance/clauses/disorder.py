"""Disorder: messages that come late, twice, in another order, or between others that make no sense."""

from __future__ import annotations

import math

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.clauses.link import arrives, latest_ages_s
from soter.conformance.driver import TICK_S
from soter.conformance.track import quantile
from soter.sdk import Controller

_STAYS_SLOW_S = 3.0
_NONSENSE = 0.5
_GARBLED_S = 3.0
"""Long enough for some messages of each kind to be cut off, on the way there and on the way back."""

_TWICE = 2
_DEAF = (
    "after messages that make no sense it does not hear those that do: what receives has ended, or gives up after some "
    "of them; drop what cannot be read, and go on"
)


@clause("link.delay", tier=Tier.WIRE, hooks=("delay",))
def delay(bench: Bench) -> None:
    """Under delay samples say how old they are, and who is in charge there and not here; goals are still reached."""
    robot = bench.open_one()
    late_s = 4 * TICK_S
    bench.run(1.0)
    before_s = min(latest_ages_s(bench, robot))
    bench.faulty = True
    bench.harness.delay(late_s)
    bench.run(1.0)
    grown_s = min(latest_ages_s(bench, robot)) - before_s
    bench.measure("age_under_delay_s", grown_s)
    bench.require(
        grown_s >= 0.5 * late_s - TICK_S / 2,
        f"with every message {late_s:.3f} s later samples are said to be {grown_s:.3f} s older: they are stamped on "
        "arrival; stamp them by the vehicle's clock",
    )
    called_s = bench.now_s
    robot.switch_ac_sc(Controller.SC, "conformance")
    bench.run(1.0)
    said_s = [each.at_s for each in bench.since(robot, called_s - late_s) if each.state.controller is Controller.SC]
    bench.require(
        min(said_s, default=math.inf) >= called_s + 0.5 * late_s,
        f"with every message {late_s:.3f} s later the SC is said to be in charge in a sample that was taken before the "
        "robot can have heard of it: that is what was sent, and not what the robot says",
    )
    robot.switch_ac_sc(Controller.AC, "conformance")
    bench.run(_STAYS_SLOW_S)
    still_s = min(latest_ages_s(bench, robot)) - before_s
    bench.require(
        still_s >= 0.5 * late_s - TICK_S / 2,
        f"a while after every message became {late_s:.3f} s later samples are said to be {still_s:.3f} s older, and "
        f"{grown_s:.3f} s at first: the slow link is taken for a slow clock within seconds; let the offset of a clock "
        "rise by what clocks may differ, and by no more the longer a session lasts",
    )
    # Shorter than the lease: a vehicle may refuse renewals that are older.
    bench.harness.delay(0.25 * bench.caps.lease_s)
    arrives(bench, robot, "a delay of a quarter of the lease")


@clause("link.duplicate", tier=Tier.WIRE, hooks=("duplicate",))
def duplicate(bench: Bench) -> None:
    """Messages that arrive twice change nothing."""
    robot = bench.open_one()
    bench.faulty = True
    bench.harness.duplicate(0.5)
    arrives(bench, robot, "half of all messages doubled")
    bench.settle()
    bench.expect_still(robot, 2.0, "a doubled message is executed again")


@clause("link.nonsense", tier=Tier.WIRE)
def nonsense(bench: Bench) -> None:
    """Messages that make no sense are dropped, and those behind them heard as before."""
    bench.require_hook("garble")
    robot = bench.open_one()
    bench.faulty = True
    bench.harness.garble(_NONSENSE)
    bench.get_going(robot, bench.place(robot, 0.8), cause=_DEAF)
    bench.run(_GARBLED_S)
    bench.harness.garble(0.0)
    bench.settle()
    ages_s = latest_ages_s(bench, robot)
    bench.measure(
        "sample_age_s", quantile(ages_s, 0.95), bench.caps.sample_age_s, 1e-4 + bench.caps.jitter_s, _DEAF,
        spread=ages_s,
    )  # fmt: skip
    for _ in range(_TWICE):
        goal = bench.get_going(robot, bench.place(robot, -0.8), cause=_DEAF)
        goal.cancel()
        bench.expect_stop(robot, _DEAF)
        robot.switch_ac_sc(Controller.SC, "conformance")
        robot.switch_ac_sc(Controller.AC, "conformance")


@clause("link.reorder", tier=Tier.WIRE, hooks=("reorder",))
def reorder(bench: Bench) -> None:
    """Messages that arrive in another order revive nothing that is over."""
    robot = bench.open_one()
    bench.faulty = True
    bench.harness.reorder(0.5)
    arrives(bench, robot, "half of all messages reordered")
    for number in range(8):
        bench.harness.reorder(0.5)
        goal = robot.goto(bench.place(robot, 0.6, -0.6 if number % 2 else 0.6), Controller.AC)
        bench.run(2 * TICK_S)
        # Messages held back now arrive after the stop and the switch.
        bench.harness.reorder(0.0)
        goal.cancel()
        robot.switch_ac_sc(Controller.SC, "conformance")
        bench.run(bench.caps.lease_s + 0.5)
        bench.expect_still(robot, 1.0, "an older goto that arrived after the switch was executed: number the messages")
        robot.switch_ac_sc(Controller.AC, "conformance")
        bench.run(4 * TICK_S)
