"""Leases: how long a robot moves on after the last renewal of its lease, also where its time passes faster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from statistics import mean
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.clauses.deadman import RENEWED
from soter.conformance.trials import Shuttle, measure_braking
from soter.sdk import Robot

_TRIALS: Final = 8
_FEW: Final = 3
_SPEEDUP: Final = 2.0
_COUNTED_S: Final = 4.0
_RATE_OFF: Final = 0.1


@clause("deadman.lease", truth=True)
def lease(bench: Bench) -> None:
    """From the last renewal to the first deceleration no more passes than lease_s, and what a cancel takes as well."""
    _judge(
        bench, bench.open_one(),
        "the vehicle's lease is longer than lease_s, is counted from something later than the renewal, grows where it "
        f"is renewed twice at once, or ends no motion backwards{RENEWED}",
    )  # fmt: skip


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
    _judge(
        bench, robot, f"at {_SPEEDUP:g} s by second: what ends the lease counts the host's time, not the robot's",
        (_SPEEDUP - 1.0) * bench.read_s,
    )  # fmt: skip


def _judge(bench: Bench, robot: Robot, cause: str, late_s: float = 0.0) -> None:
    """Judge how soon a robot at speed begins to stop once its lease is not renewed, and how it brakes.

    Args:
        bench: the clause's bench.
        robot: the robot, ready.
        cause: the likely cause if its lease is longer than it promises.
        late_s: how much later than usual the moments of its samples may be.
    """
    caps = bench.caps
    shuttle, many = Shuttle(bench, robot), _FEW if bench.judged > 1 or bench.opener else bench.trials(_TRIALS)
    told = [trial.end.begins_s for trial in shuttle.trials(many, lambda goal: goal.cancel())]
    stops = [
        *shuttle.trials(
            many, lambda _: robot.renew_lease(), waits_s=caps.lease_s, renew=False,
            cause="the lease never ends, or renewals add up",
        )
    ]  # fmt: skip
    seen = [trial.end.begins_s for trial in stops]
    # Trials begin at any phase of the vehicle's period, by which two such means may differ.
    phase_s = 0.0 if caps.in_process else caps.setpoint_period_s * 0.9 / math.sqrt(many)
    # Both means contain the time of a message and the vehicle's period.
    bench.measure(
        "lease_s", _middle(seen) - max(_middle(told), 0.0), caps.lease_s,
        bench.read_s + bench.fit_s + phase_s + late_s, cause, spread=seen,
    )  # fmt: skip
    most_s = caps.lease_s + caps.latency_s + caps.jitter_s
    bench.measure("lease_worst_s", max(seen), most_s, bench.fit_s + late_s, cause)
    measure_braking(bench, stops, "when its lease ends")


def _middle(seen: Sequence[float]) -> float:
    """Return the mean of the values without the least and the largest, which may have met a busy host."""
    return mean(sorted(seen)[1:-1] if len(seen) > _FEW else seen)
