"""`soter run`: what it refuses, how it exits, what it writes."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from soter import runner
from soter.cli import app
from soter.hints import install_command
from soter.runner import Run, RunResult
from soter.runner.result import UncontrolledFigures
from tests.cli.conftest import MISSION
from tests.project.source import ROOT
from tests.record.helpers import running

QUICK = ("--backend", "kinematic", "--planner", "straight-line", "--duration", "20")


def ran(*arguments: str | Path) -> Result:
    """`soter run` on the surveillance mission in this process, without a recording."""
    options = [str(MISSION), "--no-record", *map(str, arguments)]
    return CliRunner().invoke(app, ["run", *options], env={"COLUMNS": "100"})


# --- exit codes --------------------------------------------------------------------------------------------


def test_a_run_without_violation_exits_with_0_and_sums_up() -> None:
    done = ran(*QUICK)
    assert done.exit_code == 0
    assert done.stderr == ""
    for expected in ("completed", "violations", "AC in control", "disengagements", "real time", "trace "):
        assert expected in done.stdout
    assert all(character == "\n" or character.isprintable() for character in done.stdout)


def test_a_mission_in_one_file_or_a_controller_needs_no_mission_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    script = "from soter import Mission\n\nclass Stays(Mission):\n    async def run(self, robot):\n        pass\n"
    Path("stays.py").write_text(script)
    done = CliRunner().invoke(app, ["run", "--mission", "stays.py", "--no-record"], env={"COLUMNS": "100"})
    assert done.exit_code == 0, done.stderr
    assert "mission stays.py" in done.stdout
    driven = ["run", "--ac", "adversary:chase", "--backend", "kinematic", "--duration", "2", "--no-record"]
    done = CliRunner().invoke(app, driven, env={"COLUMNS": "100"})
    assert (done.exit_code, "AC adversary:chase" in done.stdout) == (0, True), done.stderr
    done = CliRunner().invoke(app, ["run", "--no-record"])
    assert (done.exit_code, "--mission" in done.stderr) == (2, True)


def test_the_thesiss_figures_stand_beside_a_runs_on_request() -> None:
    assert "80.2 %" not in ran(*QUICK).stdout
    done = ran(*QUICK, "--compare", "thesis")
    assert done.exit_code == 0
    assert "80.2 %" in done.stdout


@pytest.mark.parametrize(
    ("another", "said"), [(("--ac", "adversary:ram"), "adversary:ram"), (("--mission", "waypoints"), "waypoints")]
)
def test_the_thesiss_figures_stand_beside_no_other_mission(another: tuple[str, str], said: str) -> None:
    refused = ran(*QUICK, *another, "--compare", "thesis")
    assert refused.exit_code == 2
    assert "--compare" in refused.stderr
    assert said in refused.stderr


def test_an_adversary_takes_the_missions_place() -> None:
    done = ran(*QUICK, "--ac", "adversary:fastest-to-boundary")
    assert done.exit_code == 0
    assert "AC adversary:fastest-to-boundary" in done.stdout


def test_a_violation_exits_with_1() -> None:
    done = ran(*QUICK[:-1], "120", "--targets", "hostile", "--no-rta")
    assert done.exit_code == 1
    assert "completed, with violations" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--targets", "gird"), "did you mean 'grid'?"),
        (("--duration", "-1"), "command line: duration_s: it is -1.0, allowed: at least 0.001"),
        (("--duration", "nan"), "command line: duration_s: it is nan"),
        (("--seed", "-1"), "command line: seed: it is -1, allowed: at least 0"),
        (("--robots", "0"), "command line: robots: it is 0, allowed: at least 1"),
        (("--robots", "9"), "it is 9, but"),
        (("--backend", "pibullet"), "did you mean 'pybullet'?"),
        (("--backend", "kinematic", "--ac", "adversary:chess"), "did you mean 'adversary:chase'?"),
        (("--backend", "kinematic", "--engine", "steam"), "engine"),
        (("--backend", "kinematic", "--gui"), "command line: --gui: the backend 'kinematic' has no window"),
        pytest.param(("--engine", "kinematic", "--gui"), "only with the engine pybullet", marks=pytest.mark.pybullet),
        (("--backend", "kinematic", "--planner", "ompl-bitstarr"), "did you mean 'ompl-bitstar'?"),
        (("--modules", "geofense"), "did you mean 'geofence'?"),
        (("--modules", ""), "--no-rta"),
        (("--modules", "battery", "--no-rta"), "command line: --modules: it contradicts --no-rta"),
        (("--set", "sed=2"), "unknown key, did you mean 'seed'?"),
        (("--set", "seed"), "not of the form key=value"),
        (("--seed", "1", "--set", "seed=2"), "command line: seed: it is given twice"),
        (("--json", "/absent/result.json"), "command line: --json: '/absent/result.json' cannot be written"),
        (("--picture", "/absent/run.png"), "command line: --picture: '/absent/run.png' cannot be written"),
        (("--picture", "run.gif"), "does not end in .png"),
        (("--backend", "kinematic", "--set", "rta.collision.delta_s=3.0"), "module 'collision' is ill-formed (P3)"),
    ],
)
def test_bad_input_exits_with_2_and_one_message(arguments: tuple[str, ...], message: str) -> None:
    done = ran(*arguments)
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert "completed" not in done.stdout


def test_a_missing_mission_exits_with_2_and_names_the_nearest() -> None:
    done = CliRunner().invoke(app, ["run", str(MISSION.with_name("surveilance.toml"))])
    assert done.exit_code == 2
    assert "did you mean 'surveillance.toml'?" in done.stderr


def test_a_missing_library_exits_with_2_and_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    done = ran("--backend", "pybullet", "--duration", "1")
    assert done.exit_code == 2
    assert install_command("pybullet") in done.stderr


@pytest.mark.pybullet
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_a_window_needs_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    done = ran("--gui", "--duration", "1")
    assert done.exit_code == 2
    assert "DISPLAY is not set; --live needs none" in done.stderr


def test_files_are_refused_before_the_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(runner, "run_mission", lambda *_, **__: pytest.fail("it ran"))
    assert ran(*QUICK, "--json", tmp_path).exit_code == 2
    assert ran(*QUICK, "--picture", tmp_path / "absent" / "run.png").exit_code == 2


def ending(monkeypatch: pytest.MonkeyPatch, run: Run, **changes: object) -> None:
    """Let every run end like this one, with some figures changed."""
    result = run.result.model_copy(update=changes)
    monkeypatch.setattr(runner, "run_mission", lambda *_, **__: Run(result, run.tracks))


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"status": "failed", "failure": "a handler hangs"}, 3),
        ({"status": "failed", "violations": {"collision": 1}}, 1),
        ({"status": "interrupted"}, 130),
        ({"status": "interrupted", "violations": {"collision": 1}}, 130),
        ({"violations": None}, 0),
        ({"uncontrolled": {1: UncontrolledFigures(first_s=3.0, lasted_s=1.5, cause="its pilot has it")}}, 3),
    ],
)
def test_how_a_run_ended_decides_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, kinematic_run: Run, tmp_path: Path, changes: dict[str, object], code: int
) -> None:
    ending(monkeypatch, kinematic_run, **changes)
    file = tmp_path / "result.json"
    done = ran("--json", file)
    assert done.exit_code == code
    assert json.loads(file.read_text())["status"] == changes.get("status", "completed")


@pytest.mark.parametrize(
    ("changes", "code"),
    [({}, 1), ({"status": "failed"}, 3), ({"status": "interrupted"}, 130), ({"never_moved": ()}, 0)],
)
def test_strict_exits_with_1_where_nothing_else_is_wrong_and_names_what_is(
    monkeypatch: pytest.MonkeyPatch, kinematic_run: Run, changes: dict[str, object], code: int
) -> None:
    ending(monkeypatch, kinematic_run, **{"never_moved": (2,), **changes})
    done = ran("--strict")
    assert done.exit_code == code
    assert done.stderr == ("error: --strict: robot 2 never moved\n" if changes.get("never_moved") != () else "")
    assert ran().exit_code in (0, 3, 130)


def test_a_robot_without_its_ac_fails_a_strict_run(monkeypatch: pytest.MonkeyPatch, kinematic_run: Run) -> None:
    ending(monkeypatch, kinematic_run, failed_robots={2: "ValueError: no place"})
    assert ran().exit_code == 0
    done = ran("--strict")
    assert (done.exit_code, done.stderr) == (1, "error: --strict: robot 2 lost its AC: ValueError: no place\n")


@pytest.mark.parametrize(("more", "said"), [((), "no robot has its AC any more"), (("--strict",), "--strict")])
def test_a_run_whose_scripts_all_failed_has_failed(tmp_path: Path, more: tuple[str, ...], said: str) -> None:
    script = tmp_path / "patrol.py"
    script.write_text(
        "from soter import Mission\n\n\nclass Patrol(Mission):\n"
        "    async def run(self, robot):\n        raise RuntimeError('oops')\n"
    )
    done = ran(*QUICK, "--mission", script, "--quiet", *more)
    assert (done.exit_code, done.stdout) == (3, "")
    assert done.stderr.startswith(f"error: {said}: robot 1 lost its AC: its script failed: RuntimeError: oops (")
    assert "robot 2 lost its AC: its script failed" in done.stderr


def test_a_failed_assumption_is_in_the_summary_and_fails_a_strict_run() -> None:
    fault = "fault=[{kind='bias', x_m=0.2, start_s=5.0, declared=false, robot=1}]"
    done = ran(*QUICK, "--set", fault, "--strict")
    assert done.exit_code == 1
    assert "A6, robot 1" in done.stdout
    assert done.stderr.startswith("error: --strict: assumption A6 failed for robot 1 (once, first after 5 s)")
    assert ran(*QUICK, "--set", fault).exit_code == 0


def test_a_fault_of_ours_is_no_violation(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> Run:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(runner, "run_mission", broken)
    done = ran(*QUICK)
    assert done.exit_code == 3
    assert "ZeroDivisionError: oops" in done.stderr
    assert "please report it" in done.stderr


def test_ctrl_c_before_the_run_exits_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> Run:
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "run_mission", interrupted)
    done = ran(*QUICK)
    assert done.exit_code == 130
    assert done.stderr == "error: interrupted\n"


def test_a_result_that_cannot_be_written_in_the_end_exits_with_3(
    monkeypatch: pytest.MonkeyPatch, kinematic_run: Run, tmp_path: Path
) -> None:
    ending(monkeypatch, kinematic_run)
    file = tmp_path / "result.json"

    def full(self: Path, data: bytes) -> int:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "write_bytes", full)
    done = ran("--json", file)
    assert done.exit_code == 3
    assert "the result could not be written: disk full" in done.stderr
    assert "completed" in done.stdout


# --- what it writes ----------------------------------------------------------------------------------------


def test_the_json_file_is_the_result(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    assert ran(*QUICK, "--seed", "3", "--json", file).exit_code == 0
    result = RunResult.model_validate_json(file.read_text())
    assert (result.seed, result.duration_s, result.backend, result.status) == (3, 20.0, "kinematic", "completed")
    assert result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    assert file.read_text().startswith('{\n  "')
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_json_on_standard_output_is_alone_there() -> None:
    done = ran(*QUICK, "--json", "-")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["status"] == "completed"
    assert "AC in control" in done.stderr


def test_quiet_says_nothing() -> None:
    done = ran(*QUICK, "--quiet")
    assert (done.exit_code, done.output) == (0, "")


def test_options_reach_the_run() -> None:
    done = ran(*QUICK, "--quiet", "--json", "-", "--robots", "1", "--targets", "uniform", "--modules",
               "battery,geofence", "--set", "rta.geofence.delta_s=0.1")  # fmt: skip
    result = RunResult.model_validate_json(done.stdout)
    assert (result.robots, result.targets_from, result.modules) == (1, "uniform", ("geofence", "battery"))
    bare = RunResult.model_validate_json(ran(*QUICK, "-q", "--json", "-", "--no-rta").stdout)
    assert (bare.modules, bare.disengagements_total, bare.ac_share) == ((), 0, 1.0)


def test_the_same_seed_gives_the_same_trace() -> None:
    first, second, other = (
        json.loads(ran(*QUICK, "-q", "--json", "-", "--seed", seed).stdout)["trace_sha256"] for seed in ("1", "1", "2")
    )
    assert first == second != other


@pytest.mark.pybullet
def test_the_engine_is_chosen_for_the_backend() -> None:
    done = ran("--engine", "kinematic", *QUICK[2:], "--quiet", "--json", "-")
    assert done.exit_code == 0
    result = RunResult.model_validate_json(done.stdout)
    assert (result.backend, result.engine) == ("pybullet", "kinematic")


def test_a_picture_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    file = tmp_path / "run.png"
    assert ran(*QUICK, "--quiet", "--picture", file).exit_code == 0
    assert file.read_bytes().startswith(b"\x89PNG\r\n")


# --- in a process of its own -------------------------------------------------------------------------------


@contextmanager
def started(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """`soter run` as a process, in the moment in which it begins to run."""
    with running(MISSION, "--no-record", *arguments) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("running ")
        yield process


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_stops_the_run_and_keeps_its_result(tmp_path: Path, number: signal.Signals, code: int) -> None:
    file = tmp_path / "result.json"
    with started(*QUICK[:-1], "1e6", "--json", file) as process:
        # To the whole group, as a terminal does it: the planners' processes get it as well.
        os.killpg(process.pid, number)
        stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == code
    assert "interrupted after" in stdout
    assert "AC in control" in stdout
    assert stderr == ""
    result = RunResult.model_validate_json(file.read_text())
    assert result.status == "interrupted"
    assert result.duration_s < 1e6


@pytest.mark.parametrize(
    ("what", "sent"),
    [
        (("run", "--no-record"), signal.SIGTERM), (("run", "--no-record"), signal.SIGINT),
        (("download", "--timeout", "60"), signal.SIGTERM),
    ],
)  # fmt: skip
def test_a_signal_ends_the_wait_for_robots_that_are_not_there(what: tuple[str, ...], sent: signal.Signals) -> None:
    pytest.importorskip("pymavlink")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        nobody.settimeout(60.0)
        connection = f"backends.mavlink.connection=udpout:127.0.0.1:{nobody.getsockname()[1]}"
        command = [sys.executable, "-m", "soter.cli", *what, str(MISSION), "--set", connection]
        with subprocess.Popen(
            [*command, "--backend", "mavlink"], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as process:
            # It has begun to look for its robots.
            nobody.recvfrom(1024)
            process.send_signal(sent)
            _, stderr = process.communicate(timeout=20)
    assert process.returncode == 128 + sent
    assert stderr == "error: interrupted\n"


def test_a_run_outlives_the_reader_of_its_progress(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    with started(*QUICK, "--json", file) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(timeout=60) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    assert RunResult.model_validate_json(file.read_text()).status == "completed"
