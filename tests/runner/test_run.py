"""A mission from beginning to end, on the kinematic engine: what it counts, how it ends, that it repeats itself."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from soter.config import MissionFile, load_mission
from soter.config.tables import MODULES
from soter.errors import BackendError, ConfigError, IllFormedModule, RunFailed
from soter.missions.surveillance import Targets
from soter.record.reader import Recording
from soter.rta import BEGINS_S
from soter.runner import Follower, Progress, Run, run_mission
from soter.runner.watchdog import CutOff, Watchdog
from soter.stack.planners import PlanRequest
from soter_sim import World

ROOT = Path(__file__).parents[2]
SURVEILLANCE = ROOT / "examples" / "surveillance.toml"
WAREHOUSE = ROOT / "examples" / "warehouse.toml"
QUICK = {"backend": "kinematic", "planner": "straight-line"}
DRAINED: dict[str, Any] = {"duration_s": 600.0, "battery__drive_s": 300.0, "battery__idle_s": 550.0}
"""Longer than a battery lasts, driving or not."""


def mission(path: Path = SURVEILLANCE, **overrides: Any) -> MissionFile:
    """A mission on the kinematic engine; double underscores in names stand for dots."""
    given: Mapping[str, object] = {name.replace("__", "."): value for name, value in overrides.items()}
    return load_mission(path, {**QUICK, **given})


def violations(run: Run) -> dict[str, int]:
    assert run.result.violations is not None
    return run.result.violations


@pytest.mark.parametrize("targets", ["grid", "uniform", "hostile"])
def test_no_rule_is_broken(targets: str) -> None:
    run = run_mission(mission(targets=targets, duration_s=500.0, seed=11))
    assert run.result.status == "completed"
    assert violations(run) == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    assert run.result.min_margin is not None
    assert all(margin >= 0.0 for margin in run.result.min_margin.values())
    assert run.result.disengagements_total > 0
    assert all(figures.broken == figures.surprises == 0 for figures in run.result.monitors.values())
    assert run.result.longest_stall_s <= 60.0
    assert run.result.no_progress_s <= 180.0


def test_without_modules_every_rule_is_broken() -> None:
    run = run_mission(mission(targets="hostile", **DRAINED, seed=1, rta__enabled=False))
    assert all(count > 0 for count in violations(run).values()), violations(run)
    assert run.result.ac_share == 1.0
    assert run.result.disengagements_total == 0


@pytest.mark.parametrize("left_out", MODULES)
def test_without_one_module_its_own_rule_is_broken(left_out: str) -> None:
    modules = [name for name in MODULES if name != left_out]
    run = run_mission(mission(targets="hostile", **DRAINED, seed=2, rta__modules=modules), accept_unproved=True)
    assert violations(run)[left_out] > 0
    assert len(run.tracks.violations) == sum(violations(run).values())


def test_six_robots() -> None:
    run = run_mission(mission(WAREHOUSE, duration_s=300.0, targets="hostile", seed=5))
    assert run.result.robots == 6
    assert not run.result.violated


def test_the_protected_planner_keeps_its_paths_clear_of_boxes() -> None:
    bare = run_mission(mission(duration_s=450.0, targets="hostile", seed=3))
    guarded = run_mission(mission(duration_s=450.0, targets="hostile", seed=3, rta__path__enabled=True))
    assert bare.result.disengagements["obstacle"] > 0
    assert 5 * guarded.result.disengagements["obstacle"] < bare.result.disengagements["obstacle"]
    assert guarded.result.paths_replaced > 0
    assert not guarded.result.violated


def test_a_seed_gives_one_trace_whatever_the_machine_does() -> None:
    here = run_mission(mission(duration_s=120.0, seed=9)).result.trace_sha256
    code = (
        "from soter.config import load_mission\nfrom soter.runner import run_mission\n"
        f"m = load_mission({str(SURVEILLANCE)!r}, {{**{QUICK!r}, 'duration_s': 120.0, 'seed': 9}})\n"
        "print(run_mission(m).result.trace_sha256)\n"
    )
    load = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    finally:
        load.kill()
        load.wait()
    assert there == here
    assert run_mission(mission(duration_s=120.0, seed=10)).result.trace_sha256 != here


def test_figures_add_up() -> None:
    run = run_mission(mission(duration_s=600.0, targets="hostile", seed=4))
    result, tracks = run.result, run.tracks
    assert result.disengagements_total == sum(result.disengagements.values())
    assert result.targets_reached == result.targets.reached
    taken = [switch for switch in tracks.switches if switch.before is None and switch.after is not None]
    assert len(taken) == result.disengagements_total
    assert 0.0 < result.ac_share <= result.ac_share_without_charging <= 1.0
    assert 0 <= result.needless <= result.disengagements_total
    for track in tracks.tracks.values():
        assert len(track.time_s) == len(track.x_m) == len(track.driver) == 600 * 4
        share = sum(driver == 0 for driver in track.driver) / len(track.driver)
        assert abs(share - result.ac_share) < 0.2
    assert result.duration_s == 600.0
    assert result.missed_ticks == 0
    assert result.answered is None, "in virtual time nothing is left unanswered"


def test_a_stop_ends_the_run_with_what_there_is() -> None:
    asked = iter([False, False, True])
    run = run_mission(mission(duration_s=600.0), follower=Follower(stop=lambda: next(asked)))
    assert run.result.status == "interrupted"
    assert 0.0 < run.result.duration_s < 60.0
    assert run.result.deterministic is False


def test_progress_is_reported() -> None:
    seen: list[Progress] = []
    run_mission(mission(duration_s=120.0), follower=Follower(show=seen.append, every_s=0.0))
    assert seen
    assert [robot.robot_id for robot in seen[-1].robots] == [1, 2]
    assert set(seen[-1].robots[0].margins) == {"collision", "obstacle", "geofence", "battery"}
    assert not math.isnan(seen[-1].robots[0].margins["geofence"])
    assert {(robot.driver, robot.cause) for robot in seen[0].robots} == {("starting", "")}
    assert "starting" not in {robot.driver for each in seen if each.time_s > BEGINS_S for robot in each.robots}
    assert [p.time_s for p in seen] == sorted(p.time_s for p in seen)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"rta__collision__delta_s": 0.5, "rta__collision__phi_safer_m": 0.5}, ["collision", "P3", "Delta = 0.1 s"]),
        ({"rta__geofence__phi_safer_inset_m": 0.05}, ["geofence", "P3", "phi_safer"]),
        ({"rta__obstacle__delta_s": 0.5}, ["obstacle", "P3"]),
        ({"rta__battery__reserve_factor": 60.0}, ["battery", "P3"]),
    ],
)
def test_an_ill_formed_module_is_refused_before_anything_moves(overrides: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(IllFormedModule) as refused:
        run_mission(mission(**overrides))
    for word in words:
        assert word in str(refused.value)


def test_an_unknown_option_of_a_backend_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"backends\.kinematic\.speed"):
        run_mission(mission(backends__kinematic__speed=3))


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("backends.kinematik", "did you mean 'kinematic'"),
        ("planners.ompl-bitster", "ompl-bitstar"),
        ("adversaries.chaise", "did you mean 'chase'"),
        ("backends.mavlink.promse", "did you mean 'promise'"),
        ("backends.zenoh.session.unencryptd", "did you mean 'unencrypted'"),
    ],
)
def test_options_of_what_there_is_not_are_refused(key: str, hint: str) -> None:
    with pytest.raises(ConfigError, match=rf"{key}.*{hint}"):
        run_mission(load_mission(SURVEILLANCE, {**QUICK, f"{key}.speed": 3}))


def test_what_only_the_host_of_another_backend_has_is_not_asked_for() -> None:
    options = {"mode": "client", "connect": ["tls/robot.example:7447"], "tls": {"root_ca": "/nowhere/ca.pem"}}
    run = run_mission(mission(duration_s=0.1, backends__zenoh__session=options))
    assert run.result.status == "completed"


def test_options_of_a_backend_that_is_not_installed_are_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    run = run_mission(mission(duration_s=0.1, backends__unitree__speed=3))
    assert run.result.status == "completed"
    assert "backends.unitree is not used" in caplog.text


@pytest.mark.parametrize(
    ("planner", "reason"),
    [("Raises", "RuntimeError"), ("Garbage", "garbage"), ("Outside", None)],
)
def test_a_planner_that_fails_costs_the_plan_and_not_the_safety(
    planner: str, reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    run = run_mission(mission(planner=f"bad_planners:{planner}", duration_s=120.0))
    assert run.result.status == "completed"
    assert not run.result.violated
    if reason is not None:
        assert run.result.targets.blocked > 0
        assert run.result.targets_reached == 0


def sabotage(monkeypatch: pytest.MonkeyPatch, robot_id: int, deed: Callable[[], None], from_request: int = 3) -> None:
    """Have one robot's motion planner machine do something else than plan, from some request on."""

    def planned(request_id: int, robot: int, *rest: Any) -> PlanRequest:
        if robot == robot_id and request_id % 1_000_000 >= from_request:
            deed()
        return PlanRequest(request_id, robot, *rest)

    monkeypatch.setattr("soter.stack.motion_planner.PlanRequest", planned)


def fail() -> None:
    raise ZeroDivisionError("no way")


def block() -> None:
    threading.Event().wait(60.0)


def test_a_machine_that_raises_costs_its_robot_the_ac_and_the_others_carry_on(monkeypatch: pytest.MonkeyPatch) -> None:
    sabotage(monkeypatch, 1, fail)
    run = run_mission(mission(duration_s=300.0, targets="uniform"))
    assert run.result.status == "completed"
    assert not run.result.violated
    assert list(run.result.failed_robots) == [1]
    assert "no way" in run.result.failed_robots[1]
    assert "MotionPlanner" in run.result.failed_robots[1]
    charger = run.tracks.workspace.robots[0].charger
    first, second = run.tracks.tracks[1], run.tracks.tracks[2]
    assert charger.distance_m(first.x_m[-1], first.y_m[-1]) <= 0.0, "robot 1 went home and stays there"
    assert all(driver != 0 for driver in first.driver[-400:])
    assert any(driver == 0 for driver in second.driver[-400:])


def test_a_task_planner_that_raises_costs_all_robots_their_ac(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Targets, "next", lambda self, robot_id: fail())
    run = run_mission(mission(duration_s=60.0))
    assert set(run.result.failed_robots) == {1, 2}
    assert not run.result.violated


def test_a_world_that_breaks_ends_the_run_with_what_there_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    advance, broken = World.advance, False

    def breaks(self: World, until_s: float) -> None:
        nonlocal broken
        if broken:
            return
        if broken := until_s > 5.0:
            raise BackendError("its window is closed")
        advance(self, until_s)

    monkeypatch.setattr(World, "advance", breaks)
    run = run_mission(mission(duration_s=20.0), record=tmp_path / "run.mcap")
    assert (run.result.status, run.result.failure) == ("failed", "its window is closed")
    assert violations(run) == dict.fromkeys(MODULES, 0)
    series = Recording(tmp_path / "run.mcap").content(1).series[1]
    assert series.time_s[-1] == pytest.approx(5.0, abs=0.1)


def test_a_handler_that_never_returns_ends_the_run_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    sabotage(monkeypatch, 2, block)
    run = run_mission(mission(duration_s=600.0))
    assert run.result.status == "failed"
    assert "MotionPlanner.Planning.entry" in run.result.failure
    assert run.result.deterministic is False
    assert not run.result.violated


def test_the_watchdog_puts_back_what_was_there() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with Watchdog():
        assert signal.getsignal(signal.SIGALRM) is not before
    assert signal.getsignal(signal.SIGALRM) is before


def test_who_catches_every_interruption_ends_the_process_with_its_last_words(monkeypatch: pytest.MonkeyPatch) -> None:
    left: list[int | str] = []
    monkeypatch.setattr("soter.runner.watchdog.GIVE_UP_S", 0.5)
    monkeypatch.setattr("os._exit", left.append)
    with Watchdog() as watchdog:
        watchdog.last_words = lambda: left.append("said")
        caught = 0
        with watchdog.over("a rule", 0.1), suppress(CutOff):
            while not left:
                with suppress(CutOff):
                    time.sleep(10.0)
                caught += 1
        assert left[:2] == ["said", 3]
        assert caught >= 2
        with pytest.raises(RunFailed, match="a rule has blocked"):
            watchdog.check()
