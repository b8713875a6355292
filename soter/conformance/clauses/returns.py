"""Returns: a robot whose program ends and begins anew is heard again."""

from __future__ import annotations

from contextlib import suppress
from statistics import median

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.errors import Uncontrolled
from soter.sdk import Controller, Link

# Spread so that an adapter that doubles its waits between tries is waiting at the end of one of these outages.
_OFF_S = (1.0, 13.0, 19.0)
_WAITS_S = 0.25
_RETURNS_S = 10.0
_LATER_S = 5.0
_SELDOM = (
    "the longer a robot was away, the longer it takes to be heard again: who waits twice as long after each try to "
    "connect looks for it seldom in the end"
)


@clause("link.returns", tier=Tier.WIRE)
def returns(bench: Bench) -> None:
    """A robot whose program ends and begins anew is heard again and obeys, each time, and calls wait for nothing."""
    bench.require_hook("switchable")
    fleet, off, on = bench.harness.switchable()
    bench.opener = lambda: fleet
    robot = bench.open_one()
    bench.faulty, returns_s = True, []
    for number, off_s in enumerate(_OFF_S, start=1):
        off()
        took_s: list[float] = []
        ends_s = bench.now_s + off_s
        while bench.now_s < ends_s:
            began_s = bench.now_s
            robot.read_state()
            robot.goto(bench.place(robot, 0.5), Controller.AC)
            with suppress(Uncontrolled):
                robot.renew_lease()
            took_s.append(bench.now_s - began_s)
            bench.fleet.clock.sleep_until(began_s + TICK_S)
        # A busy host holds up some calls, and not most of them.
        bench.require(
            max(took_s) <= _WAITS_S and median(took_s) <= TICK_S,
            f"while the robot's program is not there the calls of a tick take up to {max(took_s):.2f} s, and "
            f"{median(took_s):.2f} s as a rule: they wait for a connection or for an answer, and the leases of all "
            "other robots with them",
        )
        on()
        began_s = bench.now_s
        back = bench.run(_RETURNS_S, lambda: robot.read_state().link is Link.UP)
        returns_s.append(bench.now_s - began_s)
        # Who looks ever more seldom hears of it in the end, after about as long as it was away.
        late = not back and bench.run(2.0 * sum(_OFF_S), lambda: robot.read_state().link is Link.UP)
        bench.require(
            back,
            f"the robot was away for {off_s:.0f} s, and is heard only {bench.now_s - began_s:.0f} s after its program "
            f"has begun anew: {_SELDOM}" if late else
            f"{_RETURNS_S:.0f} s after the robot's program began for the {number + 1}. time nothing is heard of it: "
            "what hears took an error, such as a refused connection, for the end, or connects, asks or sends to "
            "where it was",
        )  # fmt: skip
        bench.go(
            robot, bench.place(robot, 0.3 if number % 2 else -0.3),
            cause="a robot whose program began anew is heard, and not told anything: what was open to it is dead, or "
            "what is sent goes to the address that it had",
        )  # fmt: skip
    bench.measure(
        "returns_s", max(returns_s[1:]), min(returns_s) + _LATER_S, 2 * TICK_S, spread=returns_s,
        cause=_SELDOM,
    )  # fmt: skip
