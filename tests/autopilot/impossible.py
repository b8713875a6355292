"""Which clauses of the conformance kit cannot be tried on a real ArduPilot, why, and what that costs.

docs/mavlink.md has the same table.
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Row(NamedTuple):
    """Clauses that cannot be tried for one reason.

    Attributes:
        clauses: their ids.
        why: the reason.
        costs: what is not known of a vehicle for that.
    """

    clauses: tuple[str, ...]
    why: str
    costs: str


ROWS: Final = (
    Row(
        ("state.start", "truth.state.start"),
        "the kit did not start it: where it stands is its own word",
        "With an `origin` that is wrong, fence and boxes are elsewhere by as much: measure to a corner with a tape",
    ),
    Row(
        ("truth.state.charge", "truth.state.discharge", "several.charge"),
        "SIM_STATE tells no charge, and it does not stand on a charger",
        "How right its gauge is: the examples do without the module `battery`",
    ),
    Row(
        ("state.nearly_flat", "state.emptying", "state.full"),
        "no command sets the charge of its battery",
        "What it does by itself when it is nearly flat: leave its battery fail-safe off, or let it hold or land",
    ),
    Row(
        ("goto.no_heading", "goal.replaced", "deadman.turning", "bounds.pivot", "truth.bounds.pivot"),
        "it ends a turn after its lease, so that `pivots_first` is not promised",
        "Proofs let it set out to any side at once, which makes horizons longer",
    ),
    Row(
        ("authority.confirmed",),
        "it does not report who is in charge",
        "That a switch has come through shows by its motion alone, which `authority.effective` judges",
    ),
    Row(
        ("authority.one_program", "authority.next_program"),
        "it obeys every ground station",
        "A second program drives it as well, which is seen, and then the first one stops; signed links keep it out",
    ),
    Row(
        ("authority.intruded",),
        "the adapter says that it is not under control, not who intrudes",
        "Nothing: the missions of `make test-autopilot` let another ground station send it elsewhere",
    ),
    Row(
        ("deadman.clock_back", "deadman.clock_steps", "deadman.clock_stands", "deadman.wraps"),
        "nothing sets its clock, which counts from its start",
        "What happens after 49.7 days, when that clock begins anew: start vehicles more often",
    ),
    Row(
        ("deadman.restart", "link.returns"),
        "it needs 40 s to know where it is after a restart, and the kit waits for 10",
        "Nothing: missions restart and reboot it, and it is nobody's until it is ready again",
    ),
    Row(
        ("deadman.stalled",),
        "its simulator stands still with its program",
        "That it stops while its own processor stands still is its makers' promise",
    ),
    Row(
        ("process.lost", "deadman.off_and_on", "capabilities.deterministic"),
        "they are about robots that the backend starts, or that live in its process",
        "Nothing",
    ),
    Row(
        ("host.beside",),
        "there are no second vehicles of the same ids",
        "Nothing of the vehicle: that fleets in one process are kept apart shows with the simulated ones",
    ),
    Row(
        ("several.last",),
        "two are there, and it needs three",
        "What holds of two vehicles is not known of the third",
    ),
    Row(
        ("truth.bounds.leg",),
        "its room has no free way of 8 m to one side",
        "That it keeps to its tube on long legs shows in missions alone, whose legs have up to 34 m",
    ),
    Row(
        ("truth.bounds.body",),
        "real robots are not driven into each other",
        "`body_radius_m` is for a tape measure",
    ),
    Row(
        ("bounds.acceleration", "truth.bounds.acceleration"),
        "`accel_m_s2` is not promised",
        "Proofs let it be at its top speed at once",
    ),
    Row(
        ("truth.capabilities.asked",),
        "what it can do is set by its parameters, not by what it is asked for",
        "A promise of less needs other parameters: measure it anew",
    ),
    Row(
        ("endurance.pace",),
        "its promised `speed_noise_m_s` hides changes of speed of a few percent",
        "That it gets slower or faster within minutes shows in missions alone, by their top speed",
    ),
)
"""The same for rovers and copters."""

IMPOSSIBLE: Final = frozenset(clause for row in ROWS for clause in row.clauses)
