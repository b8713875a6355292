"""Missions of users: scripts and machines, what they are told, what becomes of failures, and how they are named."""

from __future__ import annotations

import logging
import types
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from soter.config import MissionFile, load_mission
from soter.errors import ConfigError
from soter.missions import ROOM, Mission, make_mission, waypoints
from soter.missions.names import not_awaited
from soter.record.reader import Recording
from soter.runner import Run, run_mission
from tests.missions import scripts

EXAMPLES = Path(__file__).parents[2] / "examples"
ZMQ = "soter_zmq.adapter:ZmqBackend"
PATROL = """\
from soter import Mission, Robot

class Patrol(Mission):
    async def run(self, robot: Robot) -> None:      # one for each robot
        while True:
            for point in [(1, 1), (4, 1), (4, 4), (1, 4)]:
                arrived = await robot.go_to(*point, timeout_s=60)
                if not arrived:
                    self.log(f"robot {robot.id}: {arrived.why}")
"""
BOTH = pytest.mark.parametrize("backend", ["kinematic", pytest.param("pybullet", marks=pytest.mark.pybullet)])


@pytest.fixture(autouse=True)
def _nothing_seen() -> Iterator[None]:
    scripts.ARRIVALS.clear()
    scripts.SEEN.clear()
    yield
    scripts.UsesOther.handles.clear()


def told(name: str, options: dict[str, Any] | None = None, file: Path = ROOM, **overrides: Any) -> MissionFile:
    """Return a short mission of `tests.missions.scripts`, or of any other name with a colon or a dot in it."""
    use = name if ":" in name or "." in name else f"tests.missions.scripts:{name}"
    given = {"battery.initial": [1.0, 1.0], "duration_s": 10.0, **overrides}
    return load_mission(file, {**given, "mission": {"use": use, **(options or {})}})


def made(mission: MissionFile) -> Mission:
    return make_mission(mission, mission.read_workspace(), {1: 0.105, 2: 0.105})


def ran(name: str, options: dict[str, Any] | None = None, **overrides: Any) -> Run:
    return run_mission(told(name, options, **overrides))


# --- scripts ---------------------------------------------------------------------------------------------------


@BOTH
def test_a_patrol_in_a_file_of_its_own_runs_on_any_backend(backend: str, tmp_path: Path) -> None:
    (tmp_path / "patrol.py").write_text(PATROL)
    result = ran(str(tmp_path / "patrol.py"), backend=backend, duration_s=40.0).result
    assert (result.status, result.violated, result.failed_robots) == ("completed", False, {})
    assert result.targets_reached >= 4
    assert result.does == str(tmp_path / "patrol.py")


def test_a_file_is_relative_to_the_mission_file(tmp_path: Path) -> None:
    (tmp_path / "patrol.py").write_text(PATROL)
    file = tmp_path / "mission.toml"
    file.write_text(
        f'mission = "patrol.py:Patrol"\n{ROOM.read_text()}'.replace("room.xml", str(ROOM.parent / "room.xml"))
    )
    assert run_mission(load_mission(file, {"duration_s": 1.0})).result.status == "completed"


def test_the_same_seed_gives_the_same_run() -> None:
    one, same, other = (ran("Wanders", duration_s=30.0, seed=seed).result for seed in (1, 1, 2))
    assert one.deterministic
    assert one.trace_sha256 == same.trace_sha256 != other.trace_sha256


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"place": [2, 2]}, "reached"),
        ({"place": [4, 1], "timeout_s": 0.5}, "timed out"),
        ({"place": [0.5, 5.5]}, "taken over by geofence"),
        ({"place": [4, 4], "tries": 1}, "taken over by collision"),
    ],
)
def test_a_script_is_told_why_a_goal_has_ended(options: dict[str, Any], why: str) -> None:
    run = ran("Ends", options, duration_s=60.0)
    ((robot_id, arrived),) = scripts.ARRIVALS
    assert (robot_id, arrived.why, bool(arrived)) == (1, why, why == "reached")
    assert not run.result.violated
    assert run.result.duration_s < 60.0, "the run ends with the scripts"


@pytest.mark.parametrize(("timeout_s", "why", "stalled"), [(60.0, "reached", False), (2.0, "timed out", True)])
def test_a_robot_stalls_short_of_its_target_and_not_once_it_is_there(timeout_s: float, why: str, stalled: bool) -> None:
    result = ran("StandsAbout", {"place": [2, 2], "timeout_s": timeout_s}, duration_s=60.0).result
    assert [arrived.why for _, arrived in scripts.ARRIVALS] == [why]
    assert result.duration_s >= 40.0
    assert (result.longest_stall_s >= 30.0) is stalled
    assert stalled or result.longest_stall_s < 5.0


def test_a_place_that_no_path_leads_to_is_refused() -> None:
    ran("Ends", {"place": [2.0, 2.0]}, planner="tests.runner.bad_planners:Raises")
    ((_, arrived),) = scripts.ARRIVALS
    assert arrived.why.startswith("refused: ")
    assert (arrived.module, bool(arrived)) == ("", False)


def test_robots_wait_for_each_other_in_fleet_time() -> None:
    result = ran("Meets").result
    assert scripts.SEEN == [False, (1, 3.05), True, (2, 3.05)]
    assert result.duration_s == pytest.approx(3.1)


def test_scripts_see_themselves_the_others_and_the_room_and_are_heard(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        run_mission(told("Looks"), record=tmp_path / "run.mcap")
    assert sorted(scripts.SEEN) == [
        (1, pytest.approx(1.0, abs=0.01), 2, pytest.approx(4.0, abs=0.01), True, 5.0),
        (2, pytest.approx(4.0, abs=0.01), 1, pytest.approx(1.0, abs=0.01), True, 5.0),
    ]
    assert "mission: robot 1 has looked" in caplog.messages
    events = [each for tick in Recording(tmp_path / "run.mcap").ticks() for each in tick.events]
    said = [getattr(each, "detail", "") for each in events if getattr(each, "event", "") == "log"]
    assert sorted(said) == ["robot 1 has looked", "robot 2 has looked"]


# --- machines --------------------------------------------------------------------------------------------------


def test_a_mission_may_bring_a_task_planner_of_its_own() -> None:
    result = ran("Shuttle", duration_s=200.0).result
    assert (result.status, result.violated, result.failed_robots) == ("completed", False, {})
    assert result.targets_reached >= 5
    assert result.duration_s < 200.0, "it has said that it is done"


def test_a_mission_may_bring_planner_and_executor_of_its_own() -> None:
    result = ran("Straight", duration_s=40.0).result
    assert (result.status, result.violated, result.failed_robots) == ("completed", False, {})
    assert {robot_id for robot_id, status in scripts.SEEN if status == "reached"} == {1, 2}


# --- failures --------------------------------------------------------------------------------------------------


def test_a_script_that_raises_costs_its_robot_the_ac_and_no_other(caplog: pytest.LogCaptureFixture) -> None:
    result = ran("Raises", duration_s=20.0).result
    assert (result.status, result.violated) == ("completed", False)
    assert set(result.failed_robots) == {1}
    assert result.failed_robots[1].startswith("its script failed: RuntimeError: out of ideas (scripts.py, line ")
    assert f"robot 1: {result.failed_robots[1]}" in caplog.messages
    assert "machine" not in result.failed_robots[1]
    assert result.targets_reached >= 1


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("AwaitsAnything", "RuntimeError: no running event loop"),
        ("AwaitsAnything", "; a script awaits robot.go_to, robot.sleep and robot.until, one at a time"),
        ("AwaitsNoLoop", "it awaited something of another library, of type NoneType (scripts.py, line "),
        ("AwaitsNoLoop", "; a script awaits robot.go_to, robot.sleep and robot.until, one at a time"),
        ("GoesNowhere", "ValueError: "),
        ("GoesToNone", "TypeError: x_m is None, allowed: a finite number of metres, at most +-25000 (scripts.py, "),
        ("SleepsInWords", "TypeError: duration_s is '5', allowed: a finite number of seconds (scripts.py, line "),
        (
            "UsesOther",
            "MisuseError: the handle of robot 2 was awaited elsewhere; a script may await its own",
        ),
        ("Exits", "SystemExit: 7"),
        ("Cancels", "CancelledError: "),
        (
            "WaitsForCoroutine",
            "TypeError: the condition of until is a coroutine, allowed: a function that is not async",
        ),
        ("WaitsForTruth", "TypeError: the condition of until is False, allowed: a function, "),
        ("WaitsForTruth", "`lambda: `"),
        ("WaitsForNoNumber", "ValueError: timeout_s is nan, allowed: "),
        ("TriesInHalves", "ValueError: tries is 1.5, allowed: a whole number from 1 to "),
    ],
)
def test_what_a_script_may_not_do_is_named(name: str, words: str) -> None:
    result = ran(name, duration_s=3.0).result
    assert result.status == "completed"
    assert words in result.failed_robots[1]
    assert set(scripts.SEEN) <= {4}


def test_a_script_that_does_not_let_go_costs_no_result(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        run = run_mission(told("NeverLetsGo", duration_s=1.0), record=tmp_path / "run.mcap")
    assert (run.result.status, run.result.failed_robots) == ("completed", {})
    assert run.recording is not None
    assert not run.recording.failure
    assert any("NeverLetsGo" in line for line in caplog.messages)


def test_a_script_that_talks_without_end_is_recorded_all_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        run = run_mission(told("Chatters", duration_s=1.0), record=tmp_path / "run.mcap")
    assert run.recording is not None
    assert not run.recording.failure
    assert [line for line in caplog.messages if line.endswith(" more in this tick")]
    assert sum(map(len, caplog.messages)) < 1_000_000
    said = [
        each
        for tick in Recording(tmp_path / "run.mcap").ticks()
        for each in tick.events
        if getattr(each, "event", "") == "log"
    ]
    assert 0 < len(said) < 1000


def test_targets_that_no_file_can_hold_spoil_no_recording(tmp_path: Path) -> None:
    run = run_mission(told("TargetsNowhere", duration_s=1.0), record=tmp_path / "run.mcap")
    assert run.recording is not None
    assert (run.recording.failure, run.recording.refused) == ("", 2)
    assert len([*Recording(tmp_path / "run.mcap").ticks()]) == 20


@pytest.mark.parametrize(("name", "says"), [("AwaitsNothing", "AwaitsNothing 1"), ("TalksToItself", "has blocked")])
def test_a_mission_that_never_comes_to_rest_ends_the_run(name: str, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("soter.runner.watchdog.LIMIT_S", 0.3)
    result = ran(name).result
    assert result.status == "failed"
    assert says in result.failure


def test_a_mission_that_cannot_begin_leaves_its_robots_to_their_safe_controllers(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "idle.py"
    file.write_text(
        "from soter import Mission\n\n\nclass CannotBegin(Mission):\n    def begin(self, stage):\n"
        "        raise RuntimeError('no stage')\n"
    )
    for part in (ROOM, ROOM.with_suffix(".xml")):
        (tmp_path / part.name).write_text(part.read_text())
    monkeypatch.chdir(tmp_path)
    result = run_mission(told("idle.py:CannotBegin", file=Path(ROOM.name), duration_s=1.0)).result
    assert (result.status, set(result.failed_robots)) == ("failed", {1, 2})
    assert "RuntimeError('no stage') (idle.py, line 6)" in result.failure
    # What is the user's own is named with its line, in place of a traceback.
    assert not [record for record in caplog.records if record.exc_info]


def test_in_a_process_of_its_own_it_is_the_same(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        result = ran("Raises", backend=ZMQ, duration_s=3.0).result
    assert set(result.failed_robots) == {1}
    assert "RuntimeError: out of ideas (scripts.py, line " in result.failed_robots[1]


def test_a_script_interrupts_its_own_process_alone() -> None:
    """There no Ctrl-C arrives, so that it can only be the script's own."""
    result = ran("Interrupts", backend=ZMQ, duration_s=2.0).result
    assert result.status == "completed"
    assert {*result.failed_robots} == {1}
    assert result.failed_robots[1].startswith("its script failed: KeyboardInterrupt (scripts.py, line ")


def test_what_a_script_logs_reads_the_same_from_a_process_of_its_own(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        ran("Looks", backend=ZMQ, duration_s=5.0)
    assert {f"mission: robot {robot_id} has looked" for robot_id in (1, 2)} <= {*caplog.messages}


# --- names -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        ("robot.go_to(1, 2)", "`robot.go_to(...)` in line 11;"),
        ("robot.sleep(1.0)", "`robot.sleep(...)` in line 11;"),
        ("self.home(robot)", "`self.home(...)` in line 11;"),
        ("if robot.engaged: robot.until(bool)", "`robot.until(...)` in line 11;"),
        ("if not robot.go_to(1, 2): pass", "`robot.go_to(...)` in line 11;"),
        ("arrived = robot.go_to(1, 2); self.log('there' if arrived else 'not')", "`robot.go_to(...)` in line 11;"),
        ("arrived = robot.go_to(1, 2); self.log(arrived.why)", "`robot.go_to(...)` in line 11;"),
        ("self.log(robot.go_to(1, 2).why)", "`robot.go_to(...)` in line 11;"),
        ("while robot.go_to(1, 2): pass", "`robot.go_to(...)` in line 11;"),
        ("return await self.home(robot) if await robot.go_to(1, 2) else None", ""),
        ("self.log(robot.now())", ""),
        ("go = robot.go_to(1, 2); await go", ""),
        ("await self.home(robot)", ""),
        ("time.sleep(0)", ""),
    ],
)
def test_a_call_that_is_not_awaited_is_refused_with_its_line(statement: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(f"""\
import time

from soter import Mission, Robot


class Mine(Mission):
    async def home(self, robot: Robot) -> None:
        await robot.go_to(1, 1)

    async def run(self, robot: Robot) -> None:
        {statement}
""")
    if not words:
        assert made(told(str(tmp_path / "mine.py"))) is not None
        return
    with pytest.raises(ConfigError) as caught:
        made(told(str(tmp_path / "mine.py")))
    assert words in str(caught.value)
    assert caught.value.key == "mission"


def test_a_script_without_its_source_is_taken_as_it_is() -> None:
    assert not_awaited(type("MadeAtAPrompt", (scripts.Looks,), {})) == ""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nowhere.py", "no file"),
        ("broken.py", "NameError"),
        ("broken2.py", "SyntaxError"),
        ("empty.py", "no subclass of soter.Mission"),
        ("two.py", "One, Two"),
        ("two.py:Tow", "did you mean 'Two'"),
        ("tests.missions.script:Ends", "no module 'tests.missions.script'"),
        ("surveilance.", "surveillance"),
        ("NoMission", "which is a class, but no Mission of SOTER's; allowed: a subclass of Mission"),
        ("CannotBeMade", "RuntimeError: not today"),
        ("Plain", "async def run"),
        ("BeginsAsync", "whose begin is async; allowed: `def begin`"),
        ("ChecksAsync", "whose check_workspace is async; allowed: `def check_workspace`"),
        ("Nothing", "does nothing"),
        ("WrongOptions", "Mission.Options"),
    ],
)
def test_what_is_wrong_with_a_name_is_said_before_anything_moves(name: str, words: str, tmp_path: Path) -> None:
    two = "from soter import Mission\nclass One(Mission): ...\nclass Two(Mission): ...\n"
    for file, text in {"broken": "x", "broken2": "def", "empty": "import soter", "two": two}.items():
        (tmp_path / f"{file}.py").write_text(text)
    name = str(tmp_path / name) if ".py" in name else name
    with pytest.raises(ConfigError) as caught:
        made(told(name))
    assert words in str(caught.value)
    assert caught.value.key == "mission"


@pytest.mark.parametrize(
    ("options", "key"),
    [({"place": [1, 2], "speed": 3}, "mission.speed"), ({}, "mission.place"), ({"place": [1, "x"]}, "mission.place.1")],
)
def test_options_that_are_not_allowed_are_named(options: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        made(told("Ends", options))
    assert key in str(caught.value)


def test_targets_are_for_missions_that_have_them(tmp_path: Path) -> None:
    assert load_mission(ROOM, {"targets": "hostile"}).targets_from == "hostile"
    assert load_mission(ROOM, {"mission.targets": "uniform"}).targets_from == "uniform"
    with pytest.raises(ConfigError, match="targets"):
        load_mission(ROOM, {"mission.targets": "uniform", "targets": "grid"})
    other = load_mission(EXAMPLES / "surveillance.toml", {"mission": "tests.missions.scripts:Wanders"})
    assert (other.options, other.targets_from) == ({}, ""), "the file's were those of its mission"
    with pytest.raises(ConfigError, match=r"^command line: targets: .*--targets"):
        made(told("Wanders", targets="grid"))
    (tmp_path / "m.toml").write_text(
        f'workspace = "{ROOM.parent}/room.xml"\ntargets = "grid"\nmission = "tests.missions.scripts:Wanders"\n'
    )
    with pytest.raises(ConfigError, match=r"m\.toml:2: targets: [^-]*$"):
        made(load_mission(tmp_path / "m.toml"))


def test_files_that_name_the_app_are_understood(tmp_path: Path) -> None:
    file = tmp_path / "old.toml"
    file.write_text(f'app = "surveillance"\nworkspace = "{ROOM.parent / "room.xml"}"\n')
    assert load_mission(file).mission.use == "surveillance"
    file.write_text(f'mission = "surveillance"\n{file.read_text()}')
    with pytest.raises(ConfigError, match="app"):
        load_mission(file)


# --- examples --------------------------------------------------------------------------------------------------


@pytest.mark.ompl
@BOTH
@pytest.mark.parametrize(
    ("name", "overrides", "reached"),
    [("waypoints", {"mission.rounds": 1}, 8), ("delivery", {}, 12), ("coverage", {"mission.lane_m": 1.0}, 16)],
)
def test_the_examples_do_what_they_say(
    name: str, overrides: dict[str, Any], reached: int, backend: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = EXAMPLES / "missions" / f"{name}.toml"
    with caplog.at_level(logging.WARNING):
        result = run_mission(load_mission(file, {"backend": backend, **overrides})).result
    assert (result.status, result.violated, result.failed_robots) == ("completed", False, {})
    assert result.targets_reached >= reached
    assert result.duration_s < 300.0
    script = file.with_suffix(".py") if name != "waypoints" else Path(waypoints.__file__)
    assert len(script.read_text().splitlines()) < 80
    if name == "delivery":
        assert sum("delivered" in line for line in caplog.messages) == 6
        assert any("leaves its load" in line for line in caplog.messages)


@pytest.mark.ompl
@pytest.mark.parametrize("workspace", ["l-hall.toml", "turned-room.toml", "flat.yaml"])
def test_ground_of_any_shape_is_swept(workspace: str, caplog: pytest.LogCaptureFixture) -> None:
    changes: dict[str, Any] = {"workspace": str(EXAMPLES / "worlds" / workspace), "mission.lane_m": 2.0}
    if workspace == "flat.yaml":
        flat = load_mission(EXAMPLES / "worlds" / "flat-patrol.toml")
        changes["station"] = [each.model_dump() for each in flat.station]
    with caplog.at_level(logging.WARNING):
        mission = load_mission(
            EXAMPLES / "missions" / "coverage.toml", {"backend": "kinematic", "robots": 2, **changes}
        )
        result = run_mission(mission).result
    assert (result.violated, result.failed_robots) == (False, {})
    assert result.targets_reached >= 8


def test_a_large_site_is_looked_at_in_parts_that_block_no_mission() -> None:
    asked: list[float] = []

    class Room:
        bounds = (0.0, 0.0, 500.0, 200.0)

        def fence_m(self, x_m: float, y_m: float) -> float:
            asked.append(y_m)
            return 1.0

        def clearance_m(self, x_m: float, y_m: float, body_radius_m: float) -> float:
            return 1.0

    @types.coroutine
    def sleep(seconds: float) -> Iterator[None]:
        yield

    robot: Any = SimpleNamespace(workspace=Room(), body_radius_m=0.105, sleep=sleep)
    script = made(load_mission(EXAMPLES / "missions" / "coverage.toml"))
    running = script.run(robot)
    for row in range(1, 4):
        running.send(None)
        assert len(set(asked)) == row, "one row a tick"
    running.close()


def test_each_robot_visits_its_own_places_and_is_done(caplog: pytest.LogCaptureFixture) -> None:
    own = {"use": "waypoints", "robots": {"2": [[3.0, 4.0], [4.0, 4.0]]}, "points": [[2.0, 1.0]]}
    with caplog.at_level(logging.WARNING):
        result = run_mission(load_mission(ROOM, {"backend": "kinematic", "mission": own, "duration_s": 200.0})).result
    assert (result.status, result.violated, result.targets_reached) == ("completed", False, 3)
    assert [sum(f"robot {number} is done" in line for line in caplog.messages) for number in (1, 2)] == [1, 1]


@pytest.mark.parametrize("where", [[40_000.0, 1.0], [1.0, float("nan")], [-float("inf"), 1.0]])
def test_waypoints_that_no_robot_can_be_sent_to_are_refused(where: list[float]) -> None:
    with pytest.raises(ConfigError, match=r"mission\.robots\.1"):
        made(load_mission(ROOM, {"mission": {"use": "waypoints", "robots": {"1": [where]}}}))


def test_waypoints_without_any_place_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"nowhere to go; give points, or robots\.N"):
        made(load_mission(ROOM, {"mission": {"use": "waypoints", "robots": {"1": []}}}))


def test_places_for_a_robot_that_is_not_there_are_refused() -> None:
    told = {"use": "waypoints", "points": [[2.0, 1.0]], "robots": {"1": [[2.0, 2.0]], "7": [[3.0, 4.0]]}}
    with pytest.raises(ConfigError, match=r"mission\.robots: there is no robot '7'; allowed: 1, 2"):
        made(load_mission(ROOM, {"mission": told}))


def test_what_a_mission_refuses_when_it_begins_is_placed_in_its_file(tmp_path: Path) -> None:
    file = tmp_path / "mission.toml"
    told = '[mission]\nuse = "tests.missions.scripts:RefusesLate"\nspeed_m_s = 3.0\n'
    file.write_text(f'workspace = "{ROOM.parent / "room.xml"}"\nbackend = "kinematic"\n{told}')
    with pytest.raises(ConfigError, match=rf"^{file}:5: mission\.speed_m_s: it is 3, allowed: 1$"):
        run_mission(load_mission(file))
