"""A recording of a run in a world of polygons holds that world, and is decided once more as it was."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from soter.cli import app
from soter.geometry.reading import read_workspace
from soter.geometry.site import Site
from soter.record.reader import Recording

WORLD = Path(__file__).parents[2] / "examples" / "worlds" / "l-hall.toml"


def test_a_recording_holds_its_site(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    mission = str(WORLD.with_name("patrol.toml"))
    done = CliRunner().invoke(app, ["run", mission, "--duration", "5", "--record", str(path)])
    assert done.exit_code == 0, done.output
    workspace = Recording(path).workspace()
    assert isinstance(workspace, Site)
    assert workspace == read_workspace(WORLD)
    replayed = CliRunner().invoke(app, ["replay", str(path)])
    assert replayed.exit_code == 0, replayed.output
    page = CliRunner().invoke(app, ["report", str(path), "--output", str(tmp_path / "run.html")])
    assert page.exit_code == 0, page.output
