"""Two rovers with a real ArduRover, in its own simulator: `make test-autopilot ARDUROVER=/path/to/ardurover`.

They run the mission of docs/mavlink.md, in real time, and SIM_STATE says what really happened. Each test takes a minute
or two, most of which the autopilots need to get ready.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.config import load_mission
from soter.geometry.workspace_xml import read_workspace
from soter.sdk import RobotSpec, RuleLimits
from tests.autopilot.ardupilot import Autopilots

PROGRAM: Final = os.environ.get("ARDUROVER", "")
pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="needs ArduRover; see `make test-autopilot`"),
    pytest.mark.timeout(3600.0),
]

EXAMPLE: Final = Path(__file__).resolve().parents[2] / "examples" / "ardurover"
MISSION: Final = EXAMPLE / "mission.toml"
RULES: Final = {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}

# What a simulated rover with two driven wheels needs, beside what the example sets.
SIMULATED: Final = {
    **{f"INS_ACC{number}OFFS_{axis}": 0.001 for number in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{number}SCAL_{axis}": 1.001 for number in ("", "2") for axis in "XYZ"},
    "INS_ACCOFFS_X": 0.001, "INS_ACCOFFS_Y": 0.001, "INS_ACCOFFS_Z": 0.001,
    "INS_ACCSCAL_X": 1.001, "INS_ACCSCAL_Y": 1.001, "INS_ACCSCAL_Z": 1.001,
    "RC1_MIN": 1000, "RC1_MAX": 2000, "RC3_MIN": 1000, "RC3_MAX": 2000,
    "SERVO1_MIN": 1000, "SERVO1_MAX": 2000, "SERVO3_MIN": 1000, "SERVO3_MAX": 2000,
    "SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74, "BATT_MONITOR": 4,
    "CRUISE_SPEED": 3, "CRUISE_THROTTLE": 75, "ATC_STR_RAT_FF": 0.2,
}  # fmt: skip


def example_parameters() -> dict[str, float]:
    lines = [line.split() for line in (EXAMPLE / "ardurover.parm").read_text().splitlines()]
    return {line[0]: float(line[1]) for line in lines if line and line[0] != "#"}


@pytest.fixture
def rovers(tmp_path: Path) -> Iterator[Autopilots]:
    mission, workspace = load_mission(MISSION), read_workspace(EXAMPLE / "field.xml")
    specs = [RobotSpec(place.id, place.x_m, place.y_m, 0.3 * place.id) for place in workspace.robots]
    limits = RuleLimits(mission.rta.collision.phi_safe_m, mission.rta.obstacle.phi_safe_m)
    with Autopilots(
        Path(PROGRAM), tmp_path / "vehicles", workspace, specs, model="rover-skid",
        parameters=SIMULATED | example_parameters(), limits=limits,
    ) as started:  # fmt: skip
        yield started


class Ended:
    """How a run ended.

    Attributes:
        code: its exit code.
        result: what `--json` wrote; empty where it wrote nothing.
        top_m_s: the top speed of any rover, by the truth.
        way_m: how far robot 1 went on after `happens` was called.
    """

    def __init__(self, code: int, result: dict[str, Any], top_m_s: float, way_m: float) -> None:
        self.code, self.result, self.top_m_s, self.way_m = code, result, top_m_s, way_m


def run(
    rovers: Autopilots,
    folder: Path,
    duration_s: float,
    happens: Callable[[subprocess.Popen[bytes]], object] | None = None,
    backend: str = "mavlink",
) -> Ended:
    """Run the mission on the rovers; let something happen once robot 1 has been fast for a while."""
    file = folder / "result.json"
    options = {"truth": rovers.truth, "connection": f"udpin:127.0.0.1:{rovers.port}"}
    settings = [word for key, value in options.items() for word in ("--set", f"backends.mavlink.{key}={value}")]
    text = MISSION.read_text().replace("field.xml", str(EXAMPLE / "field.xml"))
    mission = folder / "mission.toml"
    mission.write_text(text.replace("mavlink", backend))
    settings = [word.replace("mavlink", backend) for word in settings]
    process = subprocess.Popen(
        [sys.executable, "-m", "soter.cli", "run", mission, "--targets", "hostile", "--duration", str(duration_s),
         "--no-record", "--quiet", "--json", file, *settings],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    top_m_s, fast_s, at = 0.0, math.inf, (math.nan, math.nan)
    while process.poll() is None:
        time.sleep(0.02)
        now_s, (x_m, y_m, _, v_m_s) = time.perf_counter(), rovers.seen.get(1, (0.0, 0.0, 0.0, 0.0))
        top_m_s = max([top_m_s, *(abs(each[3]) for each in rovers.seen.values())])
        fast_s = min(fast_s, now_s) if abs(v_m_s) > 0.6 else fast_s
        if happens is not None and now_s - fast_s > 10.0 and abs(v_m_s) > 0.6:
            at = (x_m, y_m)
            happens(process)
            happens = None
    time.sleep(4.0)
    way_m = math.dist(at, rovers.seen[1][:2])
    return Ended(process.returncode, json.loads(file.read_text()) if file.exists() else {}, top_m_s, way_m)


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_two_rovers_with_hostile_targets_break_no_rule(rovers: Autopilots, tmp_path: Path, backend: str) -> None:
    duration_s = float(os.environ.get("AUTOPILOT_S", "180"))
    ended = run(rovers, tmp_path, duration_s, backend=backend)
    result = ended.result
    assert (ended.code, result["violations"], result["uncontrolled"]) == (0, RULES, {})
    assert result["ac_share"] >= 0.8
    assert result["longest_stall_s"] <= 30.0
    assert 0.9 <= ended.top_m_s <= 1.0


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ((mav.MAV_CMD_DO_SET_MODE, 1.0, 4.0), "it is in the mode HOLD, not GUIDED"),
        ((mav.MAV_CMD_DO_SET_MODE, 1.0, 0.0), "it is in the mode MANUAL, not GUIDED"),
        ((mav.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0), "it is disarmed"),
    ],
    ids=["hold", "manual", "disarm"],
)
def test_what_another_ground_station_takes_is_nobodys(
    rovers: Autopilots, tmp_path: Path, what: tuple[float, ...], says: str
) -> None:
    ended = run(rovers, tmp_path, 40.0, lambda _: rovers.command(1, int(what[0]), *what[1:]))
    assert (ended.code, ended.result["violations"]) == (3, RULES)
    assert says in ended.result["uncontrolled"]["1"]["cause"]
    assert ended.result["uncontrolled"]["1"]["lasted_s"] > 15.0
    assert says in ended.result["assumptions"]["2"]["A7"]["cause"]


def test_a_rover_without_gps_is_stopped_before_its_own_fail_safe_acts(rovers: Autopilots, tmp_path: Path) -> None:
    ended = run(rovers, tmp_path, 40.0, lambda _: rovers.set(1, "SIM_GPS_DISABLE", 1.0))
    assert (ended.code, ended.result["violations"]) == (3, RULES)
    assert "its GPS has" in ended.result["uncontrolled"]["1"]["cause"]
    # A second and a little until it is seen, and the way to stop.
    assert ended.way_m < 3.0


def test_a_rover_that_stands_still_for_three_seconds_is_made_ready_again(rovers: Autopilots, tmp_path: Path) -> None:
    def pause(_process: object) -> None:
        rovers.processes[1].send_signal(signal.SIGSTOP)
        time.sleep(3.0)
        rovers.processes[1].send_signal(signal.SIGCONT)

    ended = run(rovers, tmp_path, 60.0, pause)
    assert (ended.code, ended.result["violations"]) == (3, RULES)
    assert ended.result["uncontrolled"]["1"]["lasted_s"] < 10.0


def test_a_rover_that_is_killed_is_missed(rovers: Autopilots, tmp_path: Path) -> None:
    ended = run(rovers, tmp_path, 40.0, lambda _: rovers.kill(1))
    assert (ended.code, ended.result["violations"]) == (3, RULES)
    assert "not been heard of" in ended.result["uncontrolled"]["1"]["cause"]


def test_rovers_stop_by_themselves_when_soter_is_killed(rovers: Autopilots, tmp_path: Path) -> None:
    def kill(process: subprocess.Popen[bytes]) -> None:
        process.kill()

    ended = run(rovers, tmp_path, 60.0, kill)
    promised = load_mission(MISSION).backends["mavlink"]["promise"]
    v_m_s, brake_m_s2 = promised["v_max_m_s"], promised["brake_m_s2"]
    unheard_s = promised["lease_s"] + promised["latency_s"] + promised["setpoint_period_s"] + promised["jitter_s"]
    allowed_m = v_m_s * unheard_s + v_m_s**2 / (2.0 * brake_m_s2) + promised["overshoot_m"]
    assert ended.way_m <= 0.8 * allowed_m
    assert abs(rovers.seen[1][3]) < 0.02


def test_ctrl_c_while_connecting_ends_it_with_nothing_armed(rovers: Autopilots, tmp_path: Path) -> None:
    options = ["--set", f"backends.mavlink.connection=udpin:127.0.0.1:{rovers.port}"]
    process = subprocess.Popen(
        [sys.executable, "-m", "soter.cli", "run", MISSION, "--no-record", *options],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    time.sleep(15.0)
    process.send_signal(signal.SIGINT)
    began_s = time.perf_counter()
    assert process.wait(20.0) == 130
    assert time.perf_counter() - began_s < 2.5
    assert not any(rovers.armed(robot_id) for robot_id in rovers.processes)
