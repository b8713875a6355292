"""`soter campaign` and `soter compare`: what they show, write and refuse."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from soter.campaign.plan import load_campaign
from soter.campaign.report.document import BEGIN, END
from soter.campaign.session import run_campaign
from soter.campaign.store import Store
from soter.check.mission import refused
from soter.cli import app
from soter.config import load_mission
from soter.runner import run_mission
from tests.campaign.here import MISSION, QUICK, Here, write
from tests.project.markdown import blocks
from tests.project.source import ROOT

CAMPAIGNS = sorted((ROOT / "examples" / "campaigns").glob("*.toml"))


def soter(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "250"})


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are carried out in this process."""
    monkeypatch.setattr("soter.campaign.workers.LocalWorkers", Here)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    path = write(folder, {"seeds": {"count": 6}, "grid": {"targets": ["grid", "hostile"]}}, {"set": {"robots": 1}})
    read = load_campaign(path)
    with Store(folder / "kept.sqlite", write=True) as kept:
        kept.describe({"path": str(path), "title": "A & B", "text": read.text, "sources": read.sources})
        run_campaign(read, kept, Here())
        kept.mark_whole()
    return folder / "kept.sqlite"


@pytest.mark.usefixtures("here")
def test_a_campaign_says_what_came_out_and_whether_it_is_what_is_required(tmp_path: Path) -> None:
    path = write(tmp_path, {"seeds": [1, 2]}, {"require": ["mean ac_share > 2"]})
    done = soter("campaign", path, "--store", tmp_path / "kept.sqlite")
    assert done.exit_code == 1
    for words in ("3 of 3 runs", "p0: violations == 0: 2 of 2 runs: holds", "DOES NOT HOLD", "store:"):
        assert words in done.stdout
    assert soter("campaign", path, "--store", tmp_path / "kept.sqlite", "--only", "p0").exit_code == 0
    assert soter("campaign", path, "--store", tmp_path / "kept.sqlite", "--only", "p7").exit_code == 2


@pytest.mark.usefixtures("here")
def test_runs_that_fail_or_are_refused_have_an_exit_code_of_their_own(tmp_path: Path) -> None:
    ill_formed = {"set": {"rta.collision.delta_s": 2.0}}
    done = soter("campaign", write(tmp_path, ill_formed), "--store", tmp_path / "a.sqlite")
    assert (done.exit_code, "1 refused" in done.stdout) == (3, True)
    path = write(tmp_path, {**ill_formed, "may_refuse": True, "require": ["mean accepted == 0"]})
    assert soter("campaign", path, "--store", tmp_path / "b.sqlite").exit_code == 0


def test_every_run_has_a_command_that_repeats_it(tmp_path: Path) -> None:
    path = write(tmp_path, {"set": {"targets": "hostile"}, "seeds": [5]})
    (line,) = soter("campaign", path, "--list").stdout.splitlines()
    assert re.match(r"[0-9a-f]{12}  soter run ", line)
    assert "--targets hostile" in line


def test_a_run_is_made_again_and_is_the_same_bit_for_bit(store: Path, tmp_path: Path) -> None:
    with Store(store) as kept:
        row = next(kept.rows())
    done = soter("campaign", "run-again", row.id[:8], "--store", store, "--record", tmp_path / "again.mcap")
    assert (done.exit_code, "the same, bit for bit" in done.stdout) == (0, True)
    mission = load_mission(MISSION, {**QUICK, "targets": "grid", "seed": 1})
    assert run_mission(mission).result.trace_sha256 == row.trace_sha256, "and so it is by `soter run`"
    assert (tmp_path / "again.mcap").exists()
    assert soter("campaign", "run-again", "zzz", "--store", store).exit_code == 2


def test_what_was_changed_in_a_store_is_noticed(store: Path, tmp_path: Path) -> None:
    import sqlite3

    (tmp_path / "other.sqlite").write_bytes(store.read_bytes())
    with sqlite3.connect(tmp_path / "other.sqlite") as sql:
        sql.execute("UPDATE runs SET result = json_set(result, '$.ac_share', 2.0)")
        ((name,),) = sql.execute("SELECT id FROM runs LIMIT 1").fetchall()
    sql.close()
    assert soter("campaign", "run-again", name, "--store", tmp_path / "other.sqlite").exit_code == 1


def test_a_page_needs_no_network_and_links_the_worst_runs(store: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    done = soter("campaign", "report", store, "-o", page, "--worst", "1")
    assert done.exit_code == 0
    text = page.read_text()
    assert "A &amp; B" in text
    assert not re.search(r"(?:src|href)=\"https?:", text)
    assert text.count("<circle") >= 13
    (recording,) = (tmp_path / "page-runs").glob("*.mcap")
    assert f'href="page-runs/{recording.stem}.html"' in text
    assert soter("campaign", "report", store, "-o", page).exit_code == 2, "nothing is replaced unasked"


@pytest.mark.usefixtures("here")
def test_what_was_not_run_is_not_said_to_have_failed(tmp_path: Path) -> None:
    path = write(tmp_path, {"seeds": [1]}, {"require": ["mean ac_share > 0"]})
    assert soter("campaign", path, "--store", tmp_path / "kept.sqlite", "--only", "p0").exit_code == 0
    assert soter("campaign", "report", tmp_path / "kept.sqlite", "-o", tmp_path / "page.html").exit_code == 0
    text = (tmp_path / "page.html").read_text()
    assert "What was run holds; not all that is required was run" in text
    assert "<td>p1</td><td>mean ac_share &gt; 0</td><td>no runs</td><td>not run</td>" in text
    assert "does not hold" not in text


def test_a_document_gets_tables_with_the_commands_that_repeat_them(store: Path, tmp_path: Path) -> None:
    document = tmp_path / "page.md"
    document.write_text(f"before\n{BEGIN}\nwhat was there\n{END}\nafter\n")
    assert soter("campaign", "report", store, "--into", document).exit_code == 0
    text = document.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "what was there" not in text
    with Store(store) as kept:
        row = next(kept.rows())
    for words in (row.command, row.id, "targets grid", "## Exposure", "1 to 6", "**PASS**"):
        assert words in text
    document.write_text("no marks")
    assert soter("campaign", "report", store, "--into", document).exit_code == 2


@pytest.fixture
def read(store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the manual reads from a store with pandas."""
    pytest.importorskip("pandas")
    (tmp_path / "runs").mkdir()
    shutil.copy(store, tmp_path / "runs" / "thesis.sqlite")
    monkeypatch.chdir(tmp_path)
    return from_the_manual("pandas.read_sql", {})


def from_the_manual(words: str, known: dict[str, Any]) -> dict[str, Any]:
    (code,) = [each.code for each in blocks(ROOT / "docs" / "campaigns.md") if words in each.code]
    exec(compile(code, "campaigns.md", "exec"), known)  # noqa: S102 - a block of the manual
    return known


def test_pandas_reads_the_store_as_the_manual_says(read: dict[str, Any]) -> None:
    assert read["runs"].groupby("part")["violations"].sum().to_dict() == {"p0": 0, "p1": 0}
    assert read["results"]["min_margin.collision"].count() == 12, "a robot alone has no such margin"


def test_duckdb_reads_the_store_as_the_manual_says(read: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    duckdb = pytest.importorskip("duckdb")
    from_the_manual("COPY runs", read)
    assert f"{read['results']['min_margin.collision'].min()}" in capsys.readouterr().out
    assert duckdb.sql("SELECT count(*) FROM 'runs.parquet'").fetchall() == [(len(read["runs"]),)]


def test_settings_are_compared_by_seed(store: Path, tmp_path: Path) -> None:
    sides = ("--left", "targets=grid", "--right", "targets=hostile")
    done = soter("campaign", "compare", store, *sides, "-o", tmp_path / "page.html")
    assert done.exit_code == 0
    (line,) = [line for line in done.stdout.splitlines() if "ac_share" in line]
    assert line.split()[1] == "6"
    assert all(f" {name} " in done.stdout for name in ("violations", "longest_stall_s")), "no name is folded"
    assert "Paired by seed" in (tmp_path / "page.html").read_text()
    assert soter("campaign", "compare", store).exit_code == 2
    assert soter("campaign", "compare", store, "--left", "targets=none").exit_code == 2
    same = soter("campaign", "compare", store, store)
    assert "differs" not in same.stdout


def test_recordings_are_shown_side_by_side(tmp_path: Path) -> None:
    for seed in (1, 2):
        mission = load_mission(MISSION, {**QUICK, "seed": seed})
        run_mission(mission, record=tmp_path / f"{seed}.mcap")
    one, other, page = tmp_path / "1.mcap", tmp_path / "2.mcap", tmp_path / "page.html"
    assert soter("compare", one, other, "-o", page).exit_code == 0
    text = page.read_text()
    assert text.count("<iframe") == 2
    assert "least margin: collision" in text
    assert not re.search(r"(?:src|href)=\"https?:", text)
    assert soter("compare", one, "-o", page, "--force").exit_code == 2
    assert soter("compare", one, other, "-o", page).exit_code == 2
    assert soter("compare", one, tmp_path / "none.mcap", "-o", page, "--force").exit_code == 2


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(each, id=each.stem, marks=[pytest.mark.pybullet] * ("pybullet" in each.read_text()))
        for each in CAMPAIGNS
        if each.stem != "fleet-hall"
    ],
)
def test_the_examples_are_campaigns_and_their_parts_run(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Trials of users' modules have tests of their own.
    monkeypatch.setattr("soter.check.mission.BUDGET", 8)
    read = load_campaign(path, {"duration_s": 0.5} if path.stem != "random" else None)
    for part in read.parts.values():
        if part.search is None:
            jobs = list(read.jobs(part))
            job, last = jobs[0], jobs[-1]
            json.dumps(dict(job.settings))
            if part.mission != "random" and not part.may_refuse and not part.accept_unproved:
                most = last.load()
                assert refused(most, most.read_workspace()) == ()
            if part.mission != "random" and part.name != "fleet":
                assert run_mission(job.load(), accept_unproved=part.accept_unproved).result.status == "completed"


def test_where_no_store_can_be_made_it_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, {"seeds": [1]}, {})
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").touch()
    done = soter("campaign", path)
    assert done.exit_code == 2
    assert "--store: it is not given, and no folder 'runs' can be made here: File exists" in done.stderr
