"""Five dozen random configurations, short: both judges agree, nothing is violated. A campaign runs thousands."""

from __future__ import annotations

import pytest

from soter.campaign.job import Done, Job, carry_out

SHORT_S = 6.0


@pytest.mark.long
def test_what_is_accepted_keeps_every_rule_by_both_judges(monkeypatch: pytest.MonkeyPatch) -> None:
    # So many trials of users' modules as a run makes would take longer than all the rest.
    monkeypatch.setattr("soter.check.mission.BUDGET", 8)
    found: dict[int, Done] = {}
    for seed in range(1, 61):
        found[seed] = carry_out(Job("random", seed, "", {"seed": seed, "duration_s": SHORT_S}, {}), lambda: False)
    assert {seed: each.findings or each.failure for seed, each in found.items() if each.status != "refused"} == {
        seed: "" for seed, each in found.items() if each.status == "done"
    }
    assert sum(each.status == "done" for each in found.values()) >= 0.6 * len(found)
