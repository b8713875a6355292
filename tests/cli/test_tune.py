"""`soter tune`: its exit codes, its file, its refusals."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

from typer.testing import CliRunner, Result

from soter.cli import app
from tests.project.source import ROOT

THESIS = str(ROOT / "examples" / "thesis.toml")


def command(*words: str) -> Result:
    return CliRunner().invoke(app, [*words])


def test_tables_are_printed_all_at_once() -> None:
    done = command("tune", THESIS)
    assert done.exit_code == 0, done.output
    tables = tomllib.loads(done.output[done.output.index("[rta.collision]") :])["rta"]
    assert list(tables) == ["collision", "geofence", "battery"]
    assert (tables["collision"]["delta_s"], tables["collision"]["phi_safer_m"]) == (0.05, 0.625)
    assert "today collision is ill-formed, P3: " in done.output


def test_a_whole_file_is_written_that_a_run_takes_and_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    assert command("tune", THESIS, "-o", str(path), "--set", "seed=3").exit_code == 0
    ran = command("run", str(path), "--duration", "1", "--no-record", "--json", "-", "-q")
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["seed"] == 3
    was = path.read_bytes()
    again = command("tune", THESIS, "-o", str(path))
    assert (again.exit_code, path.read_bytes()) == (2, was)
    assert "--force" in again.output
    assert command("tune", THESIS, "-o", str(path), "--force").exit_code == 0
    assert path.read_bytes() != was
    itself = command("tune", str(path), "-o", str(path), "--force")
    assert itself.exit_code == 2
    assert "the command reads it" in itself.output


def test_what_nothing_can_be_found_for_is_exit_code_1_and_writes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    late = ("--set", 'fault=[{kind = "delay", commands_s = 0.5}]')
    done = command("tune", THESIS, *late, "-o", str(path), "--json", "-")
    assert done.exit_code == 1, done.output
    assert not path.exists()
    content = json.loads(done.stdout)
    assert content["tables"] is None
    assert content["refused"][0]["module"] == "collision"


def test_without_modules_there_is_nothing_to_tune() -> None:
    done = command("tune", THESIS, "--set", "rta.enabled=false")
    assert done.exit_code == 2
    assert "nothing to tune" in done.output
