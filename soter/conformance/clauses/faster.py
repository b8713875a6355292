"""Faster: where a simulated robot is given a clock that is faster than the host's, all of the robot follows it."""

from __future__ import annotations

from functools import partial
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.clauses.deadman import judge_lease

_SPEEDUP: Final = 2.0
_COUNTED_S: Final = 4.0
_RATE_OFF: Final = 0.1


@clause("deadman.faster", tier=Tier.WIRE)
def faster(bench: Bench) -> None:
    """Where time passes faster for a simulated robot, its clock, its motion and its lease do so alike."""
    bench.require_hook("faster")
    bench.opener = partial(bench.harness.faster, _SPEEDUP)
    robot, clock = bench.open_one(), bench.fleet.clock
    fleet_s, host_s = clock.now(), clock.steady_s()
    bench.run(_COUNTED_S)
    rate = (clock.now() - fleet_s) / (clock.steady_s() - host_s)
    bench.require(
        abs(rate / _SPEEDUP - 1.0) <= _RATE_OFF,
        f"the fleet's clock runs {rate:.2f} s by second, {_SPEEDUP:g} were asked for: the backend's option does not "
        "get to the clock, or to the program that simulates the robot",
    )
    judge_lease(
        bench, robot, f"at {_SPEEDUP:g} s by second: what ends the lease counts the host's time, not the robot's",
        (_SPEEDUP - 1.0) * bench.read_s,
    )  # fmt: skip
