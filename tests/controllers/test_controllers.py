"""Controllers of a user's own, from files: found, told, seeded, recorded; and what becomes of bad ones."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from soter.cli.app import app
from soter.config import MissionFile, load_mission
from soter.controllers import controller_class
from soter.errors import ConfigError
from soter.loading import file_of
from soter.record.reader import Recording
from soter.replay.replay import replay
from soter.runner import Run, run_mission
from soter.runner.boxes import box_of
from soter.runner.controller_host import ControllerHost
from tests.project.source import ROOT

OWN = """
import math
import os
import threading
from pydantic import BaseModel, Field
from soter import Controller, Velocity, VelocityController, Waypoint
from helper import AT


class Wanders(Controller):
    class Options(BaseModel, extra="forbid"):
        far_m: float = Field(default=2.0, gt=0.0)

    def step(self, own, now_s):
        x_m, y_m = (self.random.uniform(-self.options.far_m, self.options.far_m) for _ in range(2))
        return Waypoint(own.x_m + x_m, own.y_m + y_m) if self.random.random() < 0.05 else None


class Fleet(Wanders):
    fleet = True


class Circles(VelocityController):
    def velocity(self, own, now_s):
        return Velocity(0.15, 0.5)


class Backwards(VelocityController):
    def velocity(self, own, now_s):
        return Velocity(-0.1)


class Fails(Controller):
    def answer(self, own):
        return Waypoint(*AT)

    def step(self, own, now_s):
        return self.answer(own) if own.robot_id == 2 and now_s > 1.0 else Waypoint(*AT)


class Raises(Fails):
    def answer(self, own):
        raise ZeroDivisionError("of two")


class NoSuper(Wanders):
    def begin(self, arena):
        self.began = True


class NoSuperYet(NoSuper):
    def begin(self, arena):
        self.arena.random("me")
        super().begin(arena)


class Unspeakable(BaseException):
    def __repr__(self):
        raise self

    __str__ = __repr__


class RaisesAnything(Fails):
    def answer(self, own):
        raise Unspeakable


class Number(float):
    def __float__(self):
        raise Unspeakable


class GivesNumbersOfItsOwn(Fails):
    def answer(self, own):
        return Waypoint(Number(2.0), Number(2.0))


class TellsNumbers(Circles):
    incidents = (1, 2)


class GivesNan(Fails):
    def answer(self, own):
        return Waypoint(math.nan, 1.0)


class GivesWords(Fails):
    def answer(self, own):
        return Waypoint("2", 1.0)


class GivesNone(Fails):
    def answer(self, own):
        return Waypoint(None, 1.0)


class GivesPairs(Fails):
    def answer(self, own):
        return (1.0, 2.0)


class Spins(VelocityController):
    def velocity(self, own, now_s):
        return Velocity(math.inf) if own.robot_id == 2 else Velocity(0.1)


class Writes(VelocityController):
    def velocity(self, own, now_s):
        return Velocity("0.1") if own.robot_id == 2 else Velocity(0.1)


class Turns(VelocityController):
    def velocity(self, own, now_s):
        return 0.1 if own.robot_id == 2 else Velocity(0.1)


class StepsAsync(Controller):
    async def step(self, own, now_s):
        return Waypoint(*AT)


class CirclesAsync(VelocityController):
    async def velocity(self, own, now_s):
        return Velocity(0.1)


class LeavesWhenMade(Fails):
    def __init__(self, options):
        raise SystemExit(0)


class CannotBeMade(Fails):
    def __init__(self, options):
        raise OSError("no weights")


class DoesNothing(Controller):
    pass


class Abstract(VelocityController):
    pass


class Lax(Fails):
    class Options(BaseModel):
        pass


class CannotBeClosed(Fails):
    def close(self):
        raise Unspeakable


class NeverCloses(Fails):
    def close(self):
        threading.Event().wait(60.0)


class Hangs(Fails):
    def answer(self, own):
        while True:
            try:
                threading.Event().wait(60.0)
            except Exception:
                pass


class HangsHearing(Fails):
    def hear(self, report):
        threading.Event().wait(60.0)


class PeerSession(Circles):
    fleet = True


class LeadsAstray(Controller):
    fleet = True

    def __init__(self, options):
        super().__init__(options)
        os.chdir("/")

    def act(self, now_s, tick):
        far = [math.nan, 1e308, Number(1.0)][tick % 3]
        for port in self.arena.ports.values():
            port.goto(Waypoint(*AT), (Waypoint(-1e308, 1.0), Waypoint(far, far)))


class NoController:
    pass
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a mission, a controller, and what the controller imports."""
    shutil.copy(ROOT / "examples" / "surveillance.xml", tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "helper.py").write_text("AT = 2.5, 4.5\n")
    (tmp_path / "broken.py").write_text("x = 1\nraise OSError('no gpu')\n")
    (tmp_path / "mission.toml").write_text('workspace = "surveillance.xml"\nbackend = "kinematic"\n')
    return tmp_path


def mission(folder: Path, controller: str, **overrides: Any) -> MissionFile:
    """A short mission; double underscores in names stand for dots."""
    given: Mapping[str, object] = {name.replace("__", "."): value for name, value in overrides.items()}
    charged = {"battery.initial": [0.9, 0.9], "duration_s": 10.0, "seed": 1}
    return load_mission(folder / "mission.toml", {**charged, "ac": f"own.py:{controller}", **given})


def moved_m(run: Run, robot_id: int) -> float:
    """How far from its start a robot was at most."""
    track = run.tracks.tracks[robot_id]
    return max(math.dist((track.x_m[0], track.y_m[0]), at) for at in zip(track.x_m, track.y_m, strict=True))


# --- names and options -------------------------------------------------------------------------------------


def test_there_is_one_for_each_robot_or_for_all_as_the_class_says(folder: Path) -> None:
    for name, parts in (("Wanders", [(1,), (2,)]), ("Fleet", [(1, 2)])):
        asked = mission(folder, name)
        host = ControllerHost(asked, asked.read_workspace())
        assert [driver.robot_ids for driver in host._drivers] == parts
        assert run_mission(asked).result.violations == dict.fromkeys(
            ("battery", "geofence", "collision", "obstacle"), 0
        )


def test_files_are_relative_to_the_mission_file_and_on_the_command_line_to_where_one_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = folder / "mission.toml"
    file.write_text(f'ac = "own.py:Circles"\n{file.read_text()}')
    loaded = load_mission(file)
    assert controller_class(loaded).__name__ == "Circles"
    assert file_of(loaded.ac) == folder / "own.py"
    box = box_of(loaded)
    assert box is not None
    assert str(folder) in box.read
    (folder / "below").mkdir()
    shutil.move(folder / "own.py", folder / "below" / "other.py")
    words = ["run", "../mission.toml", "--duration", "1", "--no-record", "-q", "--ac"]
    monkeypatch.chdir(folder / "below")
    assert CliRunner().invoke(app, [*words, "other.py:Wanders"]).exit_code == 0
    assert CliRunner().invoke(app, [*words, "own.py:Wanders"]).exit_code == 2
    assert CliRunner().invoke(app, ["tune", "../mission.toml", "-o", "tuned.toml"]).exit_code == 0
    assert 'ac = "../own.py:Circles"' in (folder / "below" / "tuned.toml").read_text()


def test_options_come_from_the_table_of_the_class(folder: Path) -> None:
    asked = mission(folder, "Wanders", controllers={"Wanders": {"far_m": 0.5}, "Circles": {"of": "another"}})
    host = ControllerHost(asked, asked.read_workspace())
    assert {driver.controller.options.far_m for driver in host._drivers} == {0.5}


@pytest.mark.parametrize(
    ("overrides", "key", "words"),
    [
        ({"ac": "nowhere.py:Wanders"}, "ac", "there is no file '.*nowhere.py'"),
        ({"ac": "won.py:Wanders"}, "ac", "there is no file '.*won.py', did you mean 'own.py'"),
        ({"ac": "own.py:Wander"}, "ac", "no 'Wander' in it, did you mean 'Wanders'"),
        ({"ac": "own.py"}, "ac", "say which"),
        ({"ac": "own.py:NoController"}, "ac", "own.py:NoController', which is a class, but no Controller of SOTER's; "),
        ({"ac": "own.py:math"}, "ac", "own.py:math', which is a module; allowed: a subclass of Controller"),
        ({"ac": "own.py:StepsAsync"}, "ac", "own.py:StepsAsync', whose step is async; allowed: `def step`"),
        ({"ac": "own.py:CirclesAsync"}, "ac", "whose velocity is async; allowed: `def velocity`"),
        ({"ac": "own.py:DoesNothing"}, "ac", "neither step nor act"),
        ({"ac": "own.py:Abstract"}, "ac", "does not define velocity"),
        ({"ac": "own.py:Lax"}, "ac", "Options"),
        ({"ac": "own.py:CannotBeMade"}, "ac", "no weights"),
        ({"ac": "own.py:LeavesWhenMade"}, "ac", "SystemExit"),
        ({"ac": "broken.py:Wanders"}, "ac", r"no gpu.*broken.py, line 2"),
        ({"ac": "no.such.module:Wanders"}, "ac", "there is no module 'no'"),
        ({"ac": "soter.clock:VirtualClock"}, "ac", "a subclass of Controller"),
        ({"ac": "wanders"}, "ac", "'file.py:Class'"),
        ({"mission": "patrol.py"}, "ac", "commands the robots itself"),
        ({"controllers": {"Wanders": {"far": 1.0}}}, "controllers.Wanders.far", "did you mean 'far_m'"),
        ({"controllers": {"Wanders": {"far_m": -1.0}}}, "controllers.Wanders.far_m", "-1"),
        ({"controllers": {"Wander": {"far_m": 1.0}}}, "controllers", "did you mean 'Wander'"),
        ({"adversaries": {"Wanders": {"far_m": 1.0}}}, "adversaries.Wanders", "controllers.CLASS"),
    ],
)
def test_what_is_wrong_is_refused_before_anything_moves(
    folder: Path, overrides: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words) as refused:
        run_mission(mission(folder, "Wanders", **overrides))
    assert refused.value.key == key


# --- what becomes of them ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Raises", "of two"),
        ("RaisesAnything", "cannot say what it is"),
        ("GivesNan", "x_m is nan"),
        ("GivesWords", "str"),
        ("GivesNone", "Waypoint.x_m is of type NoneType"),
        ("GivesPairs", "tuple"),
        ("Spins", "inf"),
        ("Turns", "float"),
        ("Writes", "allowed: numbers"),
    ],
)
def test_one_that_fails_costs_its_own_robot_the_ac_and_no_other(folder: Path, name: str, words: str) -> None:
    run = run_mission(mission(folder, name, duration_s=6.0))
    assert run.result.status == "completed"
    assert set(run.result.failed_robots) == {2}
    assert words in run.result.failed_robots[2]
    assert name in run.result.failed_robots[2]
    assert run.tracks.tracks[1].driver[-1] == 0, "the other one is its AC's"
    assert run.tracks.tracks[2].driver[-1] != 0
    assert not run.result.violated


def test_one_that_raises_is_told_with_its_line_and_one_that_returns_nonsense_with_none(folder: Path) -> None:
    (line,) = (number for number, text in enumerate(OWN.splitlines(), 1) if "ZeroDivisionError" in text)
    cause = run_mission(mission(folder, "Raises", duration_s=2.0)).result.failed_robots[2]
    assert cause == f"Raises failed: ZeroDivisionError('of two') (own.py, line {line})"
    assert "line" not in run_mission(mission(folder, "GivesPairs", duration_s=2.0)).result.failed_robots[2]


@pytest.mark.parametrize("name", ["NoSuper", "NoSuperYet"])
def test_one_whose_begin_does_not_call_its_bases_is_told_to(folder: Path, name: str) -> None:
    found = OWN.splitlines().index(f"class {name}({'Wanders' if name == 'NoSuper' else 'NoSuper'}):")
    failed = run_mission(mission(folder, name, duration_s=1.0)).result.failed_robots
    assert set(failed) == {1, 2}
    assert all("super().begin(arena)" in cause for cause in failed.values())
    assert all(f"`begin` (own.py, line {found + 2})" in cause for cause in failed.values())


@pytest.mark.parametrize(("name", "handler"), [("Hangs", "step"), ("HangsHearing", "hear")])
def test_a_call_that_does_not_return_ends_the_run_by_name(
    folder: Path, name: str, handler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.runner.watchdog.LIMIT_S", 0.1)
    monkeypatch.setattr("soter.runner.loop._DECIDING", ("a safety module", 0.1))
    result = run_mission(mission(folder, name)).result
    assert result.status == "failed"
    assert f"{name}.{handler}" in result.failure
    assert not result.violated


@pytest.mark.parametrize("name", ["CannotBeClosed", "NeverCloses"])
def test_one_that_cannot_be_closed_spoils_no_run(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("soter.runner.run.SLOW_S", 0.1)
    assert run_mission(mission(folder, name, duration_s=1.0)).result.status == "completed"
    assert all(name in line for line in caplog.messages)
    assert [record.exc_info for record in caplog.records] == [None, None]


def test_numbers_that_cannot_be_read_are_no_place_and_the_robot_goes_on(folder: Path) -> None:
    result = run_mission(mission(folder, "GivesNumbersOfItsOwn", duration_s=3.0)).result
    assert (result.status, result.assumptions, result.violated) == ("completed", {}, False)


def test_what_it_tells_that_is_no_text_ends_it_and_not_the_run(folder: Path) -> None:
    assert set(run_mission(mission(folder, "TellsNumbers", duration_s=1.0)).result.failed_robots) == {1, 2}


def test_the_seed_decides_all_and_a_replay_takes_every_decision_again(folder: Path) -> None:
    recorded = folder / "run.mcap"

    def trace(seed: int, record: Path | None = None) -> str:
        return run_mission(mission(folder, "Wanders", seed=seed, duration_s=20.0), record=record).result.trace_sha256

    first = trace(1, recorded)
    assert first == trace(1)
    assert first != trace(2)
    shutil.move(folder / "own.py", folder / "gone.py")
    assert replay(Recording(recorded)).same


def test_neither_what_it_means_to_do_nor_where_it_goes_spoils_a_recording(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    run_mission(mission(folder, "LeadsAstray", duration_s=3.0), record=Path("run.mcap"))
    recording = Recording(folder / "run.mcap")
    assert len(recording.content().series) > 0
    assert replay(recording).same


def test_velocities_drive_robots(folder: Path) -> None:
    run = run_mission(mission(folder, "Circles", robots=1, duration_s=12.0))
    assert run.result.ac_share > 0.9
    # A circle of 0.3 m, of which the robot has been on the far side.
    assert moved_m(run, 1) == pytest.approx(0.6, abs=0.05)
    both = run_mission(mission(folder, "PeerSession", duration_s=8.0))
    assert min(moved_m(both, robot_id) for robot_id in (1, 2)) > 0.4
    track = run_mission(mission(folder, "Backwards", robots=1, duration_s=5.0)).tracks.tracks[1]
    assert math.hypot(track.x_m[-1] - track.x_m[0], track.y_m[-1] - track.y_m[0]) > 0.3


def test_the_example_follows_its_loop_and_no_rule_is_broken() -> None:
    run = run_mission(load_mission(ROOT / "examples" / "controllers" / "pursuit.toml", {"duration_s": 60.0}))
    assert run.result.status == "completed"
    assert not run.result.violated
    assert run.result.disengagements_total > 0, "the loop leads through a box"
    assert min(moved_m(run, robot_id) for robot_id in (1, 2)) > 1.0


def test_a_controller_and_a_module_of_ones_own_from_files_keep_all_rules(folder: Path) -> None:
    shutil.copy(ROOT / "examples" / "modules" / "zone_speed.py", folder)
    own = {"declare": "zone_speed.py:declare", "options": {"zone": [3.2, 1.2, 4.2, 3.2], "limit_m_s": 0.1}}
    wanders = mission(folder, "Wanders", duration_s=120.0, rta__module={"zone-speed": own})
    result = run_mission(wanders, accept_unproved=True).result  # trials would take longer than all the rest
    assert result.violations == dict.fromkeys(("battery", "geofence", "collision", "obstacle", "zone-speed"), 0)
    assert result.disengagements_total >= 5
