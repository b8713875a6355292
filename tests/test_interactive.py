"""One run in one call: figures, recording, frames, picture and page, and what is refused."""

from __future__ import annotations

import gc
import json
import os
import re
import shutil
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
    for force in (False, True):
        assert soter.run(script, record=path, force=force, duration_s=5.0).recording.path == path
    before = path.read_bytes()
    with pytest.raises(ConfigError, match=r"^keyword argument: record: .*force=True"):
        soter.run(script, record=path, duration_s=5.0)
    assert path.read_bytes() == before
    path.write_text("mine")
    for force in (False, True):
        with pytest.raises(BadRecording if force else ConfigError):
            soter.run(script, record=path, force=force, duration_s=5.0)
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
    with pytest.raises(ConfigError, match="given twice"):
        soter.run(MISSION, {"rta": {"collision": {"delta_s": 0.1}}, "rta.collision.delta_s": 0.2})


@pytest.mark.parametrize(
    ("settings", "keys", "origin"),
    [
        ({}, {"duration": 5.0}, "keyword argument: duration: unknown key, did you mean 'duration_s'"),
        ({"duration": 5.0}, {}, "settings: duration: unknown key"),
        ({"rta.colision.delta_s": 0.1}, {}, "settings: rta.colision: unknown key"),
        ({}, {"rta": {"collision": {"delta": 0.1}}}, "keyword argument: rta.collision.delta: unknown key"),
        ({"backends": {"kinematic": {"rate": 1}}}, {}, "settings: backends.kinematic.rate: unknown key"),
        ({"workspace.fence": 1}, {}, "settings: workspace.fence: there is no such key"),
    ],
)
def test_a_refusal_says_where_in_the_call_the_value_is(
    settings: dict[str, Any], keys: dict[str, Any], origin: str
) -> None:
    with pytest.raises(ConfigError, match=f"^{re.escape(origin)}") as refusal:
        soter.run(MISSION, settings, **{**BRIEF, "duration_s": 1.0, **keys})
    assert "command line" not in str(refusal.value)


VISITS = """\
from soter import Mission


class Visits(Mission):
    class Options(Mission.Options):
        visits: int = 3
        where: tuple[float, float] = (1.0, 1.0)

    async def run(self, robot):
        await robot.sleep(0.1)
        if self.options.visits != 1:
            raise ValueError(f"{self.options.visits} visits")
"""


def test_a_table_of_settings_leaves_the_other_keys_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "visits.py").write_text(VISITS)
    file = tmp_path / "m.toml"
    file.write_text(f'workspace = "{ROOT}/examples/surveillance.xml"\n[mission]\nuse = "visits.py"\nwhere = [2, 2]\n')
    run = soter.run(file, {"mission": {"visits": 1}}, **BRIEF)
    options = run.recording.about.mission["mission"]
    assert (options["visits"], options["where"], Path(options["use"]).name) == (1, [2, 2], "visits.py")
    assert run.ok


def test_a_run_is_not_ok_if_a_robot_has_lost_its_ac(run: FinishedRun, tmp_path: Path) -> None:
    assert run.ok
    (tmp_path / "visits.py").write_text(VISITS)
    failed = soter.run(tmp_path / "visits.py", **BRIEF)
    assert (failed.result.status, failed.result.failure, failed.result.violated) == ("completed", "", False)
    assert sorted(failed.result.failed_robots) == [1, 2]
    assert not failed.ok


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
    # It draws a picture into its folder.
    folder = shutil.copytree(notebook.parent, tmp_path / "examples")
    paths = os.pathsep.join((str(ROOT), str(ROOT / "sim")))
    done = subprocess.run(
        [sys.executable, "-c", EXECUTE, notebook, folder, written],
        env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    cells = [cell for cell in json.loads(written.read_text())["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    shown = {cell["source"][-1]: cell["outputs"][0]["data"] for cell in cells if cell["outputs"]}
    assert "text/html" in shown["run"]
    assert "image/png" in shown['Image("run.png")']
    # What is kept in the repository has no outputs, so that a change of it is a change of code.
    kept = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in kept)
