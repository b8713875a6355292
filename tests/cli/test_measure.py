"""`soter measure`: what it measures and writes, what it refuses before anything moves."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app

FIELD = """<configuration>
  <dimension x="20" y="20" z="1"/>
  <robots><robot id="4"><start x="6" y="8" z="0"/></robot></robots>
  <obstacles><box><low x="15" y="15" z="0"/><high x="16" y="16" z="1"/></box></obstacles>
  <charging_stations><box><low x="5.5" y="7.5" z="0"/><high x="6.5" y="8.5" z="0"/></box></charging_stations>
</configuration>"""


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    (tmp_path / "field.xml").write_text(FIELD)
    written = tmp_path / "mission.toml"
    written.write_text('app = "surveillance"\nworkspace = "field.xml"\nbackend = "kinematic"\n')
    return written


def command(name: str, *words: object) -> Result:
    return CliRunner().invoke(app, [name, *map(str, words)])


def test_the_table_that_it_writes_is_one_that_a_mission_takes(mission: Path, tmp_path: Path) -> None:
    table, record = tmp_path / "promise.toml", tmp_path / "record.json"
    done = command("measure", mission, "--room", 3, "--margin", 0.1, "-o", table, "--json", record)
    assert done.exit_code == 0, done.output
    assert "robot 4 drives within 1.5 m of its start, (6, 8)" in done.output
    promised = tomllib.loads(table.read_text())["backends"]["kinematic"]["promise"]
    assert promised["brake_m_s2"] == pytest.approx(0.9, rel=0.01)
    assert promised["v_max_m_s"] == pytest.approx(0.22)
    mission.write_text(mission.read_text() + table.read_text())
    assert command("check", mission, "--allow-gaps").exit_code in {0, 1}
    said = json.loads(record.read_text())
    assert said["complete"]
    assert {each["name"]: each["judge"] for each in said["promises"]}["tube_m"] == "truth"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "--room: say how large"),
        (("--room", 1.0), "--room: a circle of 1 m"),
        (("--room", 12.0), "allowed: 2 to 11.8"),
        (("--room", 3.0, "--robot", 7), "--robot: the mission has no robot 7; allowed: 4"),
    ],
)
@pytest.mark.parametrize("name", ["measure", "conform"])
def test_a_room_or_a_robot_that_is_not_there_is_refused(
    mission: Path, name: str, words: tuple[object, ...], says: str
) -> None:
    done = command(name, mission, *words)
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())


def test_a_room_is_for_a_robot_that_is_there() -> None:
    done = command("conform", "kinematic", "--room", 3.0)
    assert done.exit_code == 2
    assert "'kinematic' is no mission file" in done.output


def test_a_robot_of_a_mission_is_judged_and_what_nothing_says_is_named(mission: Path) -> None:
    done = command("conform", mission, "--room", 3.0, "--only", "deadman.silence", "--only", "several.ids", "--only",
                   "bounds.rest", "--jobs", 1)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "it needs 2 robots" in done.output
