"""Campaigns that run: kept, carried on, stopped, killed, and with workers that die."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from soter.campaign.job import Done, Job, carry_out
from soter.campaign.plan import Campaign
from soter.campaign.session import Totals, run_campaign
from soter.campaign.store import RunRow, Store
from soter.campaign.workers import LocalWorkers, Workers
from soter.errors import ConfigError, RunFailed
from tests.campaign.here import Here, campaign, write
from tests.campaign.stores import same
from tests.project.source import ROOT
from tests.waiting import wait_until


def ran(read: Campaign, store: Path, workers: Workers | None = None, **options: Any) -> Totals:
    with Store(store, write=True) as kept:
        kept.describe({"sources": read.sources, "path": str(read.path), "text": read.text})
        return run_campaign(read, kept, workers or Here(), **options)


def rows(store: Path) -> list[RunRow]:
    with Store(store) as kept:
        return [*kept.rows()]


def test_a_campaign_keeps_what_came_out(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"seeds": [1, 2]}, {"set": {"ac": "adversary:chase"}})
    store = tmp_path / "kept.sqlite"
    seen: list[str] = []
    totals = ran(read, store, on_change=lambda totals, row: seen.append(row.id if row else ""))
    found = rows(store)
    assert (totals.runs, totals.planned, totals.status["done"]) == (3, 3, 3)
    assert totals.robot_hours == pytest.approx(3 * 2 * 2.0 / 3600.0)
    assert seen == ["", *(row.id for row in found), ""]
    assert [(row.part, row.seed, row.status) for row in found] == [
        ("p0", 1, "done"),
        ("p0", 2, "done"),
        ("p1", 1, "done"),
    ]
    assert all(len(row.trace_sha256) == 64 and row.result["deterministic"] for row in found)
    with sqlite3.connect(store) as sql:
        ((hours, violations),) = sql.execute("SELECT SUM(robot_hours), SUM(violations) FROM runs").fetchall()
    sql.close()
    assert (hours, violations) == (pytest.approx(totals.robot_hours), 0)


def test_rules_without_a_module_are_counted_on_their_own(tmp_path: Path) -> None:
    unguarded = {"ac": "adversary:random", "duration_s": 60.0, "rta.modules": ["collision", "geofence"]}
    totals = ran(
        campaign(tmp_path, {"seeds": [1, 2, 3], "set": unguarded, "accept_unproved": True}), tmp_path / "kept.sqlite"
    )
    assert totals.violations.total() == 0
    assert totals.unguarded["obstacle"] > 0


def test_what_is_finished_is_never_repeated_and_more_seeds_add_to_it(tmp_path: Path) -> None:
    store = tmp_path / "kept.sqlite"
    ran(campaign(tmp_path, {"seeds": [1, 2]}), store)
    workers = Here()
    totals = ran(campaign(tmp_path, {"seeds": [2, 3]}), store, workers)
    assert [job.seed for job in workers.carried] == [3]
    assert totals.runs == 2
    assert [(row.seed, row.number) for row in rows(store)] == [(2, 0), (3, 1)], (
        "what is asked for no more, counts no more"
    )


def test_what_is_finished_is_counted_before_anything_is_said(tmp_path: Path) -> None:
    parts = {"seeds": [1, 2]}, {"set": {"ac": "adversary:chase"}, "seeds": [1, 2, 3]}
    ran(campaign(tmp_path, {"seeds": [1]}, parts[1]), tmp_path / "kept.sqlite")
    said: list[str] = []
    totals = ran(
        campaign(tmp_path, *parts), tmp_path / "kept.sqlite",
        on_change=lambda totals, _: said.append(f"{totals.runs} of {totals.planned}"),
    )  # fmt: skip
    assert said == ["4 of 5", "5 of 5", "5 of 5"]
    assert totals.status["done"] == 5


def test_stopped_and_carried_on_it_is_what_it_would_have_been(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"seeds": [1, 2, 3], "grid": {"targets": ["grid", "hostile"]}})
    done: list[RunRow] = []
    ran(
        read,
        tmp_path / "a.sqlite",
        on_change=lambda _, row: done.append(row) if row else None,
        stop=lambda: len(done) >= 2,
    )
    assert 2 <= len(rows(tmp_path / "a.sqlite")) < 6
    ran(read, tmp_path / "a.sqlite", Here(3))
    ran(read, tmp_path / "b.sqlite")
    assert same(tmp_path / "a.sqlite") == same(tmp_path / "b.sqlite")
    assert len(same(tmp_path / "a.sqlite")) == 6


def test_a_failed_run_and_a_refused_one_stop_no_other(tmp_path: Path) -> None:
    def carry(job: Job) -> Done:
        return carry_out(job, lambda: False)

    read = campaign(
        tmp_path, {"set": {"planner": "tests.campaign.dies:no_such"}}, {"set": {"rta.collision.delta_s": 2.0}}, {}
    )
    ran(read, tmp_path / "kept.sqlite", Here(carry=carry))
    first, refused, last = rows(tmp_path / "kept.sqlite")
    assert first.status in ("failed", "refused")
    assert refused.status == "refused"
    assert "collision" in refused.failure
    assert last.status == "done"


def test_what_nobody_expected_is_kept_with_its_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("in the middle of it")

    monkeypatch.setattr("soter.campaign.job.run_mission", broken)
    ran(campaign(tmp_path), tmp_path / "kept.sqlite")
    (row,) = rows(tmp_path / "kept.sqlite")
    assert (row.status, row.failure) == ("failed", "ZeroDivisionError: in the middle of it")
    assert "in broken" in row.traceback


def test_a_run_has_a_limit_of_the_hosts_time(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"set": {"duration_s": 1e6}, "limit_s": 1.0})
    ran(read, tmp_path / "kept.sqlite")
    (row,) = rows(tmp_path / "kept.sqlite")
    assert (row.status, row.failure) == ("failed", "no end after 1 s of the host's time")


def test_workers_that_die_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOTER_TEST_DIED", str(tmp_path / "died"))
    read = campaign(
        tmp_path, {"set": {"ac": "tests.campaign.dies:DiesOnce"}}, {"set": {"ac": "tests.campaign.dies:Dies"}},
        {"seeds": [1, 2]},
    )  # fmt: skip
    ran(read, tmp_path / "kept.sqlite", LocalWorkers(2))
    once, always, *others = rows(tmp_path / "kept.sqlite")
    assert (tmp_path / "died").exists()
    assert once.status == "done"
    assert (always.status, "died" in always.failure) == ("failed", True)
    assert [row.status for row in others] == ["done", "done"]


@pytest.mark.long
def test_killed_again_and_again_it_is_what_it_would_have_been(tmp_path: Path) -> None:
    path = write(tmp_path, {"seeds": {"count": 10}})
    store = tmp_path / "killed.sqlite"
    command = [sys.executable, "-m", "soter.cli", "campaign", str(path), "--store", str(store), "--jobs", "1"]

    def finished() -> int:
        try:
            with Store(store) as kept:
                return len(kept.ids())
        except ConfigError:
            return 0

    for least in (2, 5):
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        wait_until(lambda: finished() >= least)  # noqa: B023 - it is asked at once
        process.kill()
        process.wait()
    assert finished() < 10
    assert subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode == 0
    ran(campaign(tmp_path, {"seeds": {"count": 10}}), tmp_path / "whole.sqlite")
    assert same(store) == same(tmp_path / "whole.sqlite")


def test_a_stopping_rule_ends_it_at_the_same_run_whatever_comes_first(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"seeds": {"count": 60}, "until": "violations < 0.3 of runs at 95 %"})
    stores = [tmp_path / "one.sqlite", tmp_path / "many.sqlite"]
    first = ran(read, stores[0])
    totals: list[Totals] = []
    ran(read, stores[1], Here(7), on_change=lambda now, _: totals.append(replace(now)))
    assert all(each.runs <= each.planned and (each.left_s or 0.0) >= 0.0 for each in totals)
    assert 9 < first.runs == first.planned < 15, "ln(0.05 / 0.5) / ln(0.7) = 10.3 is what no violation needs, or less"
    assert same(stores[0]) == same(stores[1])
    workers = Here()
    ran(read, stores[1], workers)
    assert not workers.carried


def test_a_store_that_cannot_be_written_any_more_says_so_and_keeps_what_it_has(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"seeds": [1, 2]})
    with Store(tmp_path / "kept.sqlite", write=True) as kept:
        run_campaign(campaign(tmp_path), kept, Here())
        pages = kept._sql.execute("PRAGMA page_count").fetchone()[0]
        kept._sql.execute(f"PRAGMA max_page_count = {pages}")
        job = next(read.jobs(read.parts["p0"]))
        with pytest.raises(RunFailed, match="full"):
            kept.add(replace(job, settings={**job.settings, "seed": 2}), Done("failed", "x" * 100_000))
        assert len(kept.ids()) == 1


def test_a_store_takes_one_campaign_of_one_state_of_the_sources(tmp_path: Path) -> None:
    store = tmp_path / "kept.sqlite"
    with Store(store, write=True) as kept:
        kept.describe({"sources": "one"})
        with pytest.raises(ConfigError, match="another campaign"):
            Store(store, write=True)
        with pytest.raises(ConfigError, match="other sources"):
            kept.describe({"sources": "two"})
    (tmp_path / "text").write_text("not a database, and longer than what one begins with" * 10)
    with closing(sqlite3.connect(tmp_path / "other.sqlite")) as sql:
        sql.executescript("CREATE TABLE a (b);")
    for path in (tmp_path / "none.sqlite", tmp_path / "text", tmp_path / "other.sqlite"):
        with pytest.raises(ConfigError, match=path.name):
            Store(path)
