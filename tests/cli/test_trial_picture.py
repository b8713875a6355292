"""What the picture of a counterexample says of its time."""

from __future__ import annotations

from soter.check.trial import Attempt, TrialRow
from soter.cli.trial_picture import tracks_of


def test_a_takeover_is_at_the_tick_that_decided_it_and_not_at_the_one_that_saw_it() -> None:
    drivers = ("AC", "AC", "AC", "zone", "zone")
    rows = [
        TrialRow(0.05 * (tick + 1), 1, 0.0, 0.0, 0.0, None, 1.0, driver) for tick, driver in enumerate(drivers)
    ]  # fmt: skip
    tracks, (switch,) = tracks_of(Attempt(True, rows=rows), ("AC", "zone"))
    # The third row is what came of the third tick; at its time the fourth one decides.
    assert (switch.time_s, switch.module) == (rows[2].time_s, "zone")
    assert list(tracks[1].time_s) == [row.time_s for row in rows]
