"""`soter run --record`, `soter replay` and `soter info`: what they say, and how they exit."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.record.reader import Recording
from tests.record.conftest import Recorded
from tests.record.helpers import SURVEILLANCE, recorded, rewrite, standing

QUICK = ("--backend", "kinematic", "--planner", "straight-line", "--duration", "20")


def ran(*arguments: str | Path) -> Result:
    """A command in this process."""
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "200"})


# --- run ---------------------------------------------------------------------------------------------------


def test_a_run_is_recorded_into_a_new_file_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    files: list[Path] = []
    for number in (1, 2):
        done = ran("run", SURVEILLANCE, *QUICK)
        assert done.exit_code == 0
        files = sorted((tmp_path / "runs").iterdir())
        assert len(files) == number
        assert all(file.name.startswith("surveillance-kinematic-2") and file.suffix == ".mcap" for file in files)
        assert any(f"recording: runs/{file.name}" in done.stdout for file in files)
    assert Recording(files[0]).content().ticks == 400


def test_no_recording_where_none_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert ran("run", SURVEILLANCE, *QUICK, "--no-record").exit_code == 0
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_refused_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert ran("run", SURVEILLANCE, *QUICK, "--backend", "kinematics").exit_code == 2
    assert ran("run", SURVEILLANCE, *QUICK, "--set", "rta.collision.delta_s=3.0").exit_code == 2
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_refused_run_leaves_an_older_recording_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    assert ran("run", SURVEILLANCE, *QUICK, "--set", "rta.collision.delta_s=3.0", "--record", path).exit_code == 2
    assert path.read_bytes() == b"precious"


def test_without_a_place_for_it_a_run_goes_on_unrecorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").write_text("in the way")
    done = ran("run", SURVEILLANCE, *QUICK, "-q")
    assert done.exit_code == 0
    assert "the run is not recorded" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--record", "/absent/run.mcap"), "command line: --record: '/absent/run.mcap' cannot be written"),
        (("--record", "run.mcap", "--no-record"), "command line: --record: it contradicts --no-record"),
    ],
)
def test_a_place_that_cannot_be_is_refused(arguments: tuple[str, ...], words: str) -> None:
    done = ran("run", SURVEILLANCE, *QUICK, *arguments)
    assert done.exit_code == 2
    assert words in done.stderr


def test_what_was_asked_for_and_could_not_be_recorded_shows_in_the_exit_code() -> None:
    done = ran("run", SURVEILLANCE, *QUICK, "--record", os.devnull.replace("null", "full"))
    assert done.exit_code == 3
    assert "the recording is not complete: No space left on device" in done.stderr
    assert "completed" in done.stdout


# --- replay ------------------------------------------------------------------------------------------------


def test_replay_of_a_run_as_it_was(kinematic: Recorded) -> None:
    done = ran("replay", kinematic.path)
    assert done.exit_code == 0
    assert "6000 ticks, 300 s replayed" in done.stdout
    assert "Every decision is what was recorded, bit by bit." in done.stdout


def test_replay_names_what_differs(kinematic: Recorded, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    swapped = (b'"name":"geofence","mode":"AC"', b'"name":"geofence","mode":"SC"')

    def change(topic: str, data: bytes) -> bytes:
        if topic == "/robots/1/tick" and data.startswith(b'{"tick":1000,'):
            return data.replace(*swapped) if swapped[0] in data else data.replace(*swapped[::-1])
        return data

    rewrite(kinematic.path, path, change)
    done = ran("replay", path)
    assert done.exit_code == 1
    assert "changed after it was written: 50.000 s, robot 1" in done.stdout
    assert "differs: 50.000 s, robot 1, geofence.mode: recorded" in done.stdout
    assert "Every decision" not in done.stdout
    said = json.loads(ran("replay", path, "--json").stdout)
    assert said["same"] is False
    assert said["differences"][0]["field"] == "geofence.mode"
    assert said["flaws"][0]["robot_id"] == 1


def test_replay_answers_what_if(tmp_path: Path) -> None:
    # A mission's own robots make way for each other, and are seldom taken.
    path = tmp_path / "run.mcap"
    recorded(path, duration_s=100.0, ac="adversary:pincer", targets="hostile")
    done = ran("replay", path, "--set", "rta.collision.delta_s=0.4")
    assert done.exit_code == 0
    for words in ("A run would be refused: module 'collision' is ill-formed (P3)", " drives, ", "Open loop",
                  "disengagements by collision: "):  # fmt: skip
        assert words in done.stdout
    said = json.loads(ran("replay", path, "--set", "rta.collision.delta_s=0.4", "--json").stdout)
    assert said["settings"] == {"rta.collision.delta_s": 0.4}
    assert said["before"]["collision"] > 0
    assert said["after"]["collision"] > 0
    assert {spell["replayed"] for spell in said["spells"]} >= {"AC", "collision"}


def test_replay_of_a_recording_with_gaps_settles_nothing(kinematic: Recorded, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    rewrite(kinematic.path, path, lambda topic, data: None if data.startswith(b'{"tick":700,') else data)
    done = ran("replay", path)
    assert done.exit_code == 2
    assert "Ticks are missing before 35.05 s" in done.stdout


@pytest.mark.parametrize("command", ["replay", "info"])
def test_what_is_no_recording_exits_with_2(tmp_path: Path, command: str) -> None:
    path = tmp_path / "run.mcap"
    assert ran(command, path).exit_code == 2
    path.write_text("not a recording")
    done = ran(command, path)
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr


# --- info --------------------------------------------------------------------------------------------------


def test_info_says_what_is_there(kinematic: Recorded) -> None:
    done = ran("info", kinematic.path)
    assert done.exit_code == 0
    for words in ("whole", "on kinematic, virtual time, seed 4", "300 s, 6000 ticks", "completed", "robots",
                  "violations      0", "soter-rta", "loss of robot 2"):  # fmt: skip
        assert words in done.stdout
    said = json.loads(ran("info", kinematic.path, "--json").stdout)
    assert said["ticks"] == 6000
    assert said["truncated"] is False
    assert said["dropped_ticks"] == 0


def test_info_says_that_a_file_was_cut_off(kinematic: Recorded, tmp_path: Path) -> None:
    data, part = kinematic.path.read_bytes(), tmp_path / "part.mcap"
    part.write_bytes(data[: len(data) // 2])
    done = ran("info", part)
    assert done.exit_code == 0
    assert "cut off" in done.stdout
    assert "it did not get to say so" in done.stdout


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"violations": None, "min_margin": None}, "violations      unknown: there is no ground truth"),
        ({"truth_ended_s": 20.0}, "obstacle 0) as far as is known: ground truth ended at 20.00 s"),
    ],
    ids=["no truth", "truth that ended"],
)
def test_info_does_not_say_that_there_was_no_violation_where_that_is_not_known(
    changed: dict[str, object], words: str, short: Recorded, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"

    def change(name: str, data: bytes) -> bytes:
        return json.dumps(json.loads(data) | changed).encode() if name == "result.json" else data

    rewrite(short.path, path, lambda _, data: data, change)
    assert words in ran("info", path).stdout
    assert json.loads(ran("info", path, "--json").stdout)["unknown"] in words


def test_info_does_not_know_the_violations_of_a_run_that_was_cut_off(short: Recorded, tmp_path: Path) -> None:
    data, part = short.path.read_bytes(), tmp_path / "part.mcap"
    part.write_bytes(data[: len(data) // 2])
    assert "violations      unknown: the run did not get to sum up what ground truth saw" in ran("info", part).stdout


def test_info_names_the_robots_that_stood_for_good_and_those_that_never_moved(tmp_path: Path) -> None:
    result = standing(tmp_path / "run.mcap").result
    assert [*result.permanent_stalls] == [*result.never_moved] == [1, 2]
    said = ran("info", tmp_path / "run.mcap").stdout
    for robot, stall in result.permanent_stalls.items():
        assert f"robot {robot} without its AC from {stall.since_s:.2f} s to the end: {stall.module}" in said
    assert re.search(r"never moved +robot 1\n +robot 2\n", said)
    figures = json.loads(ran("info", tmp_path / "run.mcap", "--json").stdout)
    assert [(each["robot_id"], each["start_s"], each["end_s"]) for each in figures["stalls"]] == [
        (robot, stall.since_s, None) for robot, stall in result.permanent_stalls.items()
    ]
    assert figures["never_moved"] == [1, 2]


def test_info_of_robots_that_got_on_says_nothing_of_standing(kinematic: Recorded) -> None:
    said = ran("info", kinematic.path).stdout
    assert "without its AC" not in said
    assert "never moved" not in said


def test_info_writes_tables(kinematic: Recorded, tmp_path: Path) -> None:
    done = ran("info", kinematic.path, "--csv", tmp_path / "tables")
    assert done.exit_code == 0
    assert len(list((tmp_path / "tables").glob("*.csv"))) == 12
    (tmp_path / "file").touch()
    done = ran("info", kinematic.path, "--csv", tmp_path / "file")
    assert done.exit_code == 2
    assert "--csv" in done.stderr
