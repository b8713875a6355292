"""Two rovers with a real ArduRover, in its own simulator: `make test-autopilot ARDUROVER=/path/to/ardurover`.

They run the mission of docs/mavlink.md, in real time, and SIM_STATE says what really happened. Each test takes a minute
or two, most of which the autopilots need to get ready.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.geometry.site import GeoOrigin
from tests.autopilot.ardupilot import ORIGIN, Autopilots
from tests.autopilot.events import commanded, killed, restarted, sent_elsewhere, setting, stopped, without_gps
from tests.autopilot.missions import CALIBRATED, READY_S, RULES, Example, drawn_on_a_map, lost, run

PROGRAM: Final = os.environ.get("ARDUROVER", "")
pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="needs ArduRover; see `make test-autopilot`"),
    pytest.mark.timeout(3600.0),
]

# What a simulated rover with two driven wheels needs, beside what the example sets.
SIMULATED: Final = {
    **CALIBRATED,
    "RC1_MIN": 1000, "RC1_MAX": 2000, "RC3_MIN": 1000, "RC3_MAX": 2000,
    "SERVO1_MIN": 1000, "SERVO1_MAX": 2000, "SERVO3_MIN": 1000, "SERVO3_MAX": 2000,
    "SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74, "BATT_MONITOR": 4,
    "CRUISE_SPEED": 3, "CRUISE_THROTTLE": 75, "ATC_STR_RAT_FF": 0.2, "ATC_SPEED_P": 0.5,
}  # fmt: skip


ROVER: Final = Example("ardurover", "rover-skid", SIMULATED)


@pytest.fixture
def rovers(tmp_path: Path) -> Iterator[Autopilots]:
    with ROVER.start(PROGRAM, tmp_path / "vehicles") as started:
        yield started


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_two_rovers_with_hostile_targets_break_no_rule(rovers: Autopilots, tmp_path: Path, backend: str) -> None:
    duration_s = float(os.environ.get("AUTOPILOT_S", "180"))
    ended = run(ROVER, rovers, tmp_path, duration_s, backend=backend)
    result = ended.result
    assert (ended.code, result["violations"], result["uncontrolled"]) == (0, RULES, {})
    assert result["ac_share"] >= 0.8
    assert result["longest_stall_s"] <= 30.0
    assert ended.ready_s <= READY_S
    assert 0.9 <= ended.top_m_s <= 1.0


def test_two_rovers_in_a_field_that_is_drawn_on_a_map_break_no_rule(tmp_path: Path) -> None:
    """Its origin is 13 km from where they are."""
    drawn = drawn_on_a_map(ROVER, tmp_path, GeoOrigin(47.30, 8.65))
    with drawn.start(PROGRAM, tmp_path / "vehicles") as rovers:
        ended = run(drawn, rovers, tmp_path, float(os.environ.get("AUTOPILOT_S", "120")))
    assert (ended.code, ended.result["violations"], ended.result["uncontrolled"]) == (0, RULES, {})
    assert ended.result["ac_share"] >= 0.5
    assert ended.ready_s <= READY_S


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
    ended = run(ROVER, rovers, tmp_path, 40.0, commanded(rovers, int(what[0]), *what[1:]))
    found = lost(ended)
    assert says in found["cause"]
    assert found["lasted_s"] > 15.0
    assert says in ended.result["assumptions"]["2"]["A7"]["cause"]


def test_a_rover_without_gps_is_stopped_before_its_own_fail_safe_acts(rovers: Autopilots, tmp_path: Path) -> None:
    ended = run(ROVER, rovers, tmp_path, 40.0, without_gps(rovers))
    assert "its GPS has" in lost(ended, noise_m=ROVER.promise["position_noise_m"])["cause"]
    # A second and a little until it is seen, and the way to stop.
    assert ended.way_m < 3.0


def test_a_rover_whose_gps_gets_less_accurate_is_stopped(rovers: Autopilots, tmp_path: Path) -> None:
    ended = run(ROVER, rovers, tmp_path, 40.0, setting(rovers, "SIM_GPS1_ACC", 5.0))
    assert "its GPS says that it is off by up to 5.00 m" in lost(ended)["cause"]
    assert ended.way_m < 3.0


def test_a_rover_that_changes_to_another_ekf_is_made_ready_again(rovers: Autopilots, tmp_path: Path) -> None:
    # That of its simulator, whose origin is a centimetre away.
    found = lost(run(ROVER, rovers, tmp_path, 40.0, setting(rovers, "AHRS_EKF_TYPE", 10.0)))
    assert "the origin of its EKF has moved by 0.01 m" in found["cause"]
    assert found["lasted_s"] < 10.0


def test_a_rover_whose_home_another_ground_station_moves_goes_on(rovers: Autopilots, tmp_path: Path) -> None:
    moves = commanded(rovers, mav.MAV_CMD_DO_SET_HOME, 0.0, 0.0, 0.0, 0.0, ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.alt_m)
    ended = run(ROVER, rovers, tmp_path, 40.0, moves)
    assert (ended.code, ended.result["violations"], ended.result["uncontrolled"]) == (0, RULES, {})


def test_a_rover_that_another_ground_station_sends_elsewhere_is_nobodys_as_long_as_that_lasts(
    rovers: Autopilots, tmp_path: Path
) -> None:
    # It begins with the first of the places that are sent.
    found = lost(run(ROVER, rovers, tmp_path, 40.0, sent_elsewhere(rovers, 36.0, 36.0)))
    assert "another ground station" in found["cause"]
    assert found["lasted_s"] < 6.0


@pytest.mark.parametrize(
    ("name", "value", "before", "says"),
    [
        ("WP_PIVOT_ANGLE", 0.0, 20.0, "its WP_PIVOT_ANGLE is 0: it does not turn in place"),
        ("ATC_DECEL_MAX", 0.3, 3.0, "its ATC_DECEL_MAX is 0.3"),
    ],
    ids=["pivot", "brake"],
)
def test_a_rover_whose_parameters_another_ground_station_sets_is_nobodys_as_long_as_they_break_its_promise(
    rovers: Autopilots, tmp_path: Path, name: str, value: float, before: float, says: str
) -> None:
    def change(_process: object) -> None:
        rovers.set(1, name, value)
        time.sleep(5.0)
        rovers.set(1, name, before)

    found = lost(run(ROVER, rovers, tmp_path, 40.0, change))
    assert says in found["cause"]
    assert 4.0 < found["lasted_s"] < 8.0


def test_a_rover_that_is_started_anew_is_made_ready_again(rovers: Autopilots, tmp_path: Path) -> None:
    found = lost(run(ROVER, rovers, tmp_path, 90.0, restarted(rovers)), silent=True)
    assert 30.0 < found["lasted_s"] < 70.0


def test_a_rover_that_another_ground_station_reboots_is_nobodys_until_it_is_made_ready_again(
    rovers: Autopilots, tmp_path: Path
) -> None:
    # It begins with the command, though the rover falls silent a little later.
    reboot = commanded(rovers, mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0, 0.0, 0.0, 0.0, 20190226.0)
    assert lost(run(ROVER, rovers, tmp_path, 90.0, reboot), silent=True)["lasted_s"] < 70.0


def test_a_rover_that_stands_still_for_three_seconds_is_made_ready_again(rovers: Autopilots, tmp_path: Path) -> None:
    assert lost(run(ROVER, rovers, tmp_path, 60.0, stopped(rovers, 3.0)), silent=True)["lasted_s"] < 10.0


def test_a_rover_that_is_killed_is_missed(rovers: Autopilots, tmp_path: Path) -> None:
    assert "not been heard of" in lost(run(ROVER, rovers, tmp_path, 40.0, killed(rovers)), silent=True)["cause"]


def test_rovers_stop_by_themselves_when_soter_is_killed(rovers: Autopilots, tmp_path: Path) -> None:
    def kill(process: subprocess.Popen[bytes]) -> None:
        process.kill()

    ended = run(ROVER, rovers, tmp_path, 60.0, kill)
    assert ended.way_m <= 0.8 * ROVER.unheard_m
    assert abs(rovers.seen[1][3]) < 0.02


def test_ctrl_c_while_connecting_ends_it_with_nothing_armed(rovers: Autopilots, tmp_path: Path) -> None:
    options = ["--set", f"backends.mavlink.connection=udpin:127.0.0.1:{rovers.port}"]
    process = subprocess.Popen(
        [sys.executable, "-m", "soter.cli", "run", ROVER.path, "--no-record", *options],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    time.sleep(15.0)
    process.send_signal(signal.SIGINT)
    began_s = time.perf_counter()
    assert process.wait(20.0) == 130
    assert time.perf_counter() - began_s < 2.0
    assert not any(rovers.armed(robot_id) for robot_id in rovers.processes)
