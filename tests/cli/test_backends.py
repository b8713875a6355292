"""`soter backends`."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from soter import registry
from soter.cli import app
from soter.registry import BackendRow


def listed() -> str:
    """What it says on a wide terminal."""
    result = CliRunner().invoke(app, ["backends"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    return result.output


def test_the_built_in_ones_are_listed() -> None:
    text = listed()
    assert "pybullet" in text
    kinematic = next(line for line in text.splitlines() if line.strip().startswith("kinematic"))
    for expected in ("ready", "built in", "virtual time", "0.22 m/s"):
        assert expected in kinematic


def test_what_to_install_stands_on_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = f"backend 'other' is not available: {'it is not there; ' * 20}install it with: pip install \"x[y]\""
    monkeypatch.setattr(registry, "list_backends", lambda: [BackendRow("other", "x", "x:Y", False, problem, "")])
    lines = listed().splitlines()
    assert any("other" in line and "not available" in line for line in lines)
    assert problem in lines


def test_they_are_listed_as_json() -> None:
    result = CliRunner().invoke(app, ["backends", "--json"])
    assert result.exit_code == 0
    found = {row["name"]: row for row in json.loads(result.stdout)}
    assert found["kinematic"]["available"]
    assert "virtual time" in found["kinematic"]["capabilities"]


def test_there_are_no_control_characters_in_a_file() -> None:
    assert all(character == "\n" or character.isprintable() for character in listed())
