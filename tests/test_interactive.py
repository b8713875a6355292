"""One run in one call: figures, recording, frames, picture and page, and what is refused."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import soter
from soter.errors import ConfigError, SoterError
from soter.interactive import FinishedRun
from soter.record.reader import BadRecording
from tests.project.source import ROOT

MISSION = ROOT / "examples" / "surveillance.toml"
BRIEF: dict[str, Any] = {"backend": "kinematic", "planner": "straight-line", "duration_s": 10.0}


@pytest.fixture(scope="module")
def run() -> FinishedRun:
    return soter.run(MISSION, {"rta.collision.delta_s": 0.1}, seed=3, **BRIEF)


def test_it_is_the_run_that_was_asked_for(run: FinishedRun) -> None:
    assert run.result.seed == 3
    assert run.result.duration_s == pytest.approx(10.0)
    assert run.recording.about.mission["rta"]["collision"]["delta_s"] == 0.1
    assert "0 violations" in repr(run)


def test_frames_have_every_tick_of_every_robot(run: FinishedRun) -> None:
    pytest.importorskip("pandas")
    assert len(run.frames["ticks"]) == 2 * 200
    assert len(run.frames["modules"]) == 4 * 2 * 200
    assert run.frames["modules"]["margin"].min() >= 0.0
    assert len(run.frames["violation"]) == 0


def test_a_recording_that_is_there_is_read_as_the_same_run(run: FinishedRun, tmp_path: Path) -> None:
    read = FinishedRun.read(run.recording.path)
    assert read.result == run.result
    pytest.importorskip("pandas")
    assert len(read.frames["ticks"]) == 2 * 200
    assert read.frames["modules"]["margin"].min() == run.frames["modules"]["margin"].min()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(run.recording.path.read_bytes()[:-2000])
    with pytest.raises(ConfigError, match=r"cut\.mcap: it has no result"):
        FinishedRun.read(cut)


def test_it_shows_itself_as_a_picture_and_as_the_page(run: FinishedRun, tmp_path: Path) -> None:
    shown: list[dict[str, str | None]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            shown.append({"tag": tag, **dict(attrs)})

    Reader().feed(run._repr_html_())
    assert [each["tag"] for each in shown] == ["iframe"]
    run.write_page(tmp_path / "run.html")
    assert shown[0]["srcdoc"] == (tmp_path / "run.html").read_text()
    pytest.importorskip("matplotlib")
    run.draw(tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_a_script_is_enough_and_a_recording_stays_where_it_was_asked_for(tmp_path: Path) -> None:
    script, path = tmp_path / "patrol.py", tmp_path / "run.mcap"
    script.write_text(
        "from soter import Mission\n\n\nclass Patrol(Mission):\n    async def run(self, robot):\n"
        "        await robot.go_to(2, 2)\n"
    )
    for _ in range(2):
        assert soter.run(script, record=path, duration_s=5.0).recording.path == path
    path.write_text("mine")
    with pytest.raises(BadRecording):
        soter.run(script, record=path, duration_s=5.0)
    assert path.read_text() == "mine"


def test_a_recording_that_nobody_asked_for_goes_with_the_run() -> None:
    run = soter.run(MISSION, **{**BRIEF, "duration_s": 1.0})
    path = run.recording.path
    assert path.is_file()
    del run
    gc.collect()
    assert not path.exists()


def test_bad_input_is_refused() -> None:
    with pytest.raises(ConfigError, match="given twice"):
        soter.run(MISSION, {"seed": 1}, seed=2)
    with pytest.raises(ConfigError, match="sead"):
        soter.run(MISSION, sead=3)


def test_without_its_libraries_it_says_what_to_install(run: FinishedRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "soter.report.picture", None)
    with pytest.raises(SoterError, match=r"need pandas; install it with: pip install .*\[notebook\]"):
        _ = FinishedRun(run.result, run.recording).frames
    with pytest.raises(SoterError, match=r"matplotlib; install it with: pip install .*\[report\]"):
        run._repr_png_()


EXECUTE = """
import sys, nbclient, nbformat
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=100, resources={"metadata": {"path": sys.argv[2]}}).execute()
nbformat.write(notebook, sys.argv[3])
"""


def test_the_notebook_of_the_examples_runs(tmp_path: Path) -> None:
    for library in ("nbclient", "ipykernel", "pandas", "matplotlib"):
        pytest.importorskip(library)
    notebook, written = ROOT / "examples" / "notebook.ipynb", tmp_path / "done.ipynb"
    paths = os.pathsep.join((str(ROOT), str(ROOT / "sim")))
    done = subprocess.run(
        [sys.executable, "-c", EXECUTE, notebook, notebook.parent, written],
        env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    cells = [cell for cell in json.loads(written.read_text())["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"])
    # What is kept in the repository has no outputs, so that a change of it is a change of code.
    kept = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in kept)
