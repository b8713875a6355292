"""The generator finds faults that are planted in the stack: a drawn mission breaks a rule, by both judges."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from soter.campaign.job import Done, Job, carry_out
from soter.rta import Region, SpeedBound, Timing, UnicycleBound
from soter.stack.collision import Separation
from soter.stack.recovery import RecoveryPlanner

Mutation = Callable[[pytest.MonkeyPatch], None]

MOST_S = 200.0
OTHERS = range(1, 40)


def no_noise(patch: pytest.MonkeyPatch) -> None:
    for region in (Region, Separation):
        patch.setattr(region, "noise", lambda *_: 0.0)


def one_delta(patch: pytest.MonkeyPatch) -> None:
    """Modules look one Delta ahead in place of two, and leave noise and stopping out."""
    no_noise(patch)
    patch.setattr(Timing, "ahead_s", lambda _, delta_s: delta_s)
    patch.setattr(SpeedBound, "bound", lambda self, time_s: self.v_max_m_s * time_s)


def no_horizon(patch: pytest.MonkeyPatch) -> None:
    """Modules do not look ahead: they leave both Deltas, latency, age and noise out."""
    no_noise(patch)
    for name in ("look_s", "horizon_s"):
        patch.setattr(Timing, name, lambda *_: 0.0)


def no_halves(patch: pytest.MonkeyPatch) -> None:
    """Safe controllers drive legs that use up more than half of the gap to a peer."""
    patch.setattr(RecoveryPlanner, "_pair_spare_m", lambda *_: math.inf)


def wrong_heading(patch: pytest.MonkeyPatch) -> None:
    """Unicycles are taken to point backwards."""

    def extent(self: UnicycleBound, sample: object, time_s: float, ux: float, uy: float, uz: float = 0.0) -> float:
        return self._along(sample, time_s, -ux, -uy, self.brake_m_s2)  # type: ignore[arg-type]

    patch.setattr(UnicycleBound, "extent", extent)


PLANTED: dict[Mutation, tuple[int, float]] = {
    one_delta: (39, 60.0),
    no_horizon: (177, 40.0),
    no_halves: (79, 60.0),
    wrong_heading: (50, MOST_S),
}
"""A seed that shows it, and for how long its mission runs, in simulated seconds."""


def ran(seed: int, duration_s: float) -> Done:
    return carry_out(Job("random", seed, "", {"seed": seed, "duration_s": duration_s}, {}), lambda: False)


def planted(plant: Mutation, seed: int, duration_s: float) -> Done:
    with pytest.MonkeyPatch.context() as patch:
        plant(patch)
        return ran(seed, duration_s)


@pytest.mark.parametrize("plant", PLANTED, ids=lambda plant: plant.__name__)
def test_a_planted_fault_is_found_and_without_it_nothing_is(plant: Mutation) -> None:
    # Where seeds come to draw something else, another one shows it: it takes longer.
    drawn = [PLANTED[plant], *((seed, MOST_S) for seed in OTHERS)]
    tried = ((each, planted(plant, *each)) for each in drawn)
    shows, found = next(((each, done) for each, done in tried if done.findings), (None, None))
    assert shows is not None
    assert found is not None
    assert (found.status, found.failure) == ("done", "")
    assert not [finding for finding in found.findings if finding == "stuck" or "disagree" in finding]
    without = ran(*shows)
    assert (without.status, without.failure, without.findings) == ("done", "", [])
