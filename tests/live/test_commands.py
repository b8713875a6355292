"""`soter run --live` and `--foxglove`: what they say, and how they exit."""

from __future__ import annotations

import importlib.util
import re
import socket
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.record.reader import Recording
from tests.record.helpers import SURVEILLANCE

QUICK = ("--backend", "kinematic", "--planner", "straight-line", "--duration", "20")


def ran(*arguments: str | Path) -> Result:
    """A command in this process."""
    return CliRunner().invoke(app, ["run", str(SURVEILLANCE), *QUICK, *map(str, arguments)], env={"COLUMNS": "200"})


def test_it_says_where_to_look(tmp_path: Path) -> None:
    done = ran("--live", "--record", tmp_path / "run.mcap")
    assert done.exit_code == 0
    assert re.match(r"the live page: http://127\.0\.0\.1:\d+/\nrunning ", done.stdout)
    assert Recording(tmp_path / "run.mcap").content().ticks == 400


def test_a_port_can_be_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    done = ran("--live", "--live-port", str(port), "-q", "--record", tmp_path / "run.mcap")
    assert done.exit_code == 0
    assert done.stdout == f"the live page: http://127.0.0.1:{port}/\n"


def test_without_a_recording_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = ran("--live", "--no-record")
    assert done.exit_code == 0
    assert "recording:" not in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--live", "--foxglove"])
def test_a_port_that_is_taken_is_refused_before_anything_moves(tmp_path: Path, option: str) -> None:
    path = tmp_path / "run.mcap"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = ran(option, f"{option}-port", port, "--record", path)
    assert done.exit_code == 2
    assert f"command line: {option}-port: " in done.stderr
    assert f"port {port} of 127.0.0.1 cannot be had: " in done.stderr
    assert "name another" in done.stderr
    assert not path.exists()


@pytest.mark.parametrize("option", ["--live", "--foxglove"])
def test_a_port_for_nothing_is_refused(option: str) -> None:
    done = ran(f"{option}-port", "8000", "--no-record")
    assert done.exit_code == 2
    assert f"command line: {option}-port: it says where, but not that: add {option}" in done.stderr


@pytest.mark.parametrize("port", ["0", "65536", "-1", "http"])
def test_what_is_no_port_is_refused(port: str) -> None:
    assert ran("--live", "--live-port", port, "--no-record").exit_code == 2


def test_without_its_library_the_app_is_refused_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def find_spec(name: str, package: str | None = None) -> ModuleSpec | None:
        return None if name == "foxglove" else found(name, package)

    monkeypatch.setattr("importlib.util.find_spec", find_spec)
    done = ran("--foxglove", "--no-record")
    assert done.exit_code == 2
    assert (
        'command line: --foxglove: it needs foxglove-sdk, which is not installed; install it with: pip install "'
        in done.stderr
    )
    assert "[foxglove]" in done.stderr


def test_a_run_that_is_refused_ends_its_views(tmp_path: Path) -> None:
    done = ran("--live", "--record", tmp_path / "run.mcap", "--set", "rta.collision.delta_s=3.0")
    assert done.exit_code == 2
    assert "ill-formed" in done.stderr
    assert not (tmp_path / "run.mcap").exists()
