"""Searches find what is rare, follow from their seed, and are carried on; the runs are a formula here."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from typing import Any

import pytest

from soter.campaign.job import Done, Job
from soter.campaign.plan import Campaign
from soter.campaign.session import Totals, run_campaign
from soter.campaign.store import Store
from soter.errors import ConfigError
from tests.campaign.here import Here, campaign
from tests.campaign.stores import same

OVER = {"battery.drive_s": {"low": 100.0, "high": 1100.0}, "battery.idle_s": {"low": 2000.0, "high": 3000.0}}


def bowl(job: Job) -> Done:
    """A margin that is below 0 in about one of a hundred places, and falls towards them."""
    x, y = (job.settings["battery.drive_s"] - 100.0) / 1000.0, (job.settings["battery.idle_s"] - 2000.0) / 1000.0
    margin = ((x - 0.85) ** 2 + (y - 0.2) ** 2) ** 0.5 - 0.056
    return Done("done", result={"duration_s": 1.0, "robots": 1, "min_margin": {"collision": margin}})


def searched(folder: Path, name: str = "kept", workers: Here | None = None, **options: Any) -> tuple[Campaign, Totals]:
    stop = options.pop("stop", lambda: False)
    search = {"minimise": "min_margin.collision", "runs": 400, "below": 0.0, "over": OVER, **options}
    read = campaign(folder, {"search": search})
    with Store(folder / f"{name}.sqlite", write=True) as store:
        store.describe({"sources": read.sources})
        return read, run_campaign(read, store, workers or Here(carry=bowl), stop=stop)


def test_what_is_rare_is_found_with_fewer_runs_than_at_random(tmp_path: Path) -> None:
    runs = {
        by: [searched(tmp_path, f"{by}{seed}", by=by, seed=seed)[1].runs for seed in range(5)]
        for by in ("cma", "random")
    }
    assert max(runs["cma"]) < 400, "it is found every time"
    assert median(runs["cma"]) < 0.7 * median(runs["random"])


def test_where_there_is_nothing_it_ends_with_its_runs(tmp_path: Path) -> None:
    _, totals = searched(tmp_path, below=-1.0, runs=60)
    assert (totals.runs, totals.planned) == (60, 60)


def test_a_search_is_the_same_with_more_workers_and_when_it_is_carried_on(tmp_path: Path) -> None:
    searched(tmp_path, "one")
    searched(tmp_path, "many", Here(5, bowl))
    looks = 0

    def stop() -> bool:
        nonlocal looks
        looks += 1
        return looks > 4

    searched(tmp_path, "stopped", stop=stop)
    again = Here(carry=bowl)
    searched(tmp_path, "stopped", again)
    stores = [same(tmp_path / f"{name}.sqlite") for name in ("one", "many", "stopped")]
    assert stores[0] == stores[1] == stores[2]
    assert len(again.carried) == len(stores[0]) - 4


def test_runs_that_fail_are_kept_away_from(tmp_path: Path) -> None:
    def half(job: Job) -> Done:
        return Done("refused", "too fast") if job.settings["battery.drive_s"] < 400.0 else bowl(job)

    _, totals = searched(tmp_path, workers=Here(carry=half))
    assert totals.runs < 400


def test_settings_of_faults_are_put_into_the_list(tmp_path: Path) -> None:
    over = {"fault": {"0": {"factor": {"low": 0.5, "high": 0.9}}}}
    part: dict[str, Any] = {
        "set": {"fault": [{"kind": "weak_brakes"}]},
        "search": {"minimise": "min_margin", "runs": 3, "over": over},
    }
    with Store(tmp_path / "kept.sqlite", write=True) as store:
        run_campaign(campaign(tmp_path, part), store, Here())
        factors = [row.settings["fault"][0]["factor"] for row in store.rows()]
        assert all(row.status == "done" for row in store.rows())
    assert factors[0] != factors[1]
    assert all(0.5 <= factor <= 0.9 for factor in factors)
    beyond = {"minimise": "min_margin", "runs": 3, "over": {"fault.1.factor": {"low": 0.5, "high": 0.9}}}
    with pytest.raises(ConfigError, match=r"fault\.1\.factor"):
        campaign(tmp_path, {**part, "search": beyond})
