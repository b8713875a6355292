"""Copters with a real ArduCopter, in its own simulator: `make test-autopilot ARDUCOPTER=/path/to/arducopter`.

No copter is disarmed or rebooted here, as rovers are: it would fall.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.autopilot.ardupilot import Autopilots
from tests.autopilot.events import commanded, killed, sent_elsewhere, stopped, without_gps
from tests.autopilot.missions import CALIBRATED, READY_S, RULES, Example, lost, run

PROGRAM: Final = os.environ.get("ARDUCOPTER", "")
pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="needs ArduCopter; see `make test-autopilot`"),
    pytest.mark.timeout(3600.0),
]
# The usual battery of a simulated copter, in mAh, is empty after ten minutes; this one lasts for an hour.
SIMULATED: Final = {**CALIBRATED, "FRAME_CLASS": 1, "FRAME_TYPE": 0, "BATT_MONITOR": 4, "BATT_CAPACITY": 2e4}
COPTER: Final = Example("arducopter", "quad", SIMULATED)


@pytest.fixture
def copters(tmp_path: Path) -> Iterator[Autopilots]:
    with COPTER.start(PROGRAM, tmp_path / "vehicles") as started:
        yield started


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
@pytest.mark.parametrize("robots", [1, 2])
def test_copters_with_hostile_targets_break_no_rule(tmp_path: Path, robots: int, backend: str) -> None:
    duration_s = float(os.environ.get("AUTOPILOT_S", "180"))
    with COPTER.start(PROGRAM, tmp_path / "vehicles", robots) as copters:
        ended = run(COPTER, copters, tmp_path, duration_s, backend=backend, options=["--robots", str(robots)])
    result, v_max_m_s = ended.result, COPTER.promise["v_max_m_s"]
    assert (ended.code, result["violations"], result["uncontrolled"]) == (0, RULES, {})
    assert result["ac_share"] >= 0.8
    assert result["longest_stall_s"] <= 30.0
    assert ended.ready_s <= READY_S
    assert 0.9 * v_max_m_s <= ended.top_m_s <= v_max_m_s


def test_copters_keep_their_top_speed_while_soter_is_held_up(copters: Autopilots, tmp_path: Path) -> None:
    drawn = random.Random(3)

    def hold_up(process: subprocess.Popen[bytes]) -> None:
        # On a busy host no tick comes for a while, and then samples and targets that have waited.
        while process.poll() is None:
            process.send_signal(signal.SIGSTOP)
            time.sleep(drawn.uniform(0.3, 2.0))
            process.send_signal(signal.SIGCONT)
            time.sleep(drawn.uniform(2.0, 6.0))

    def begin(process: subprocess.Popen[bytes]) -> None:
        threading.Thread(target=hold_up, args=(process,), daemon=True).start()

    ended = run(COPTER, copters, tmp_path, 180.0, begin)
    assert ended.result["violations"] == RULES
    assert ended.top_m_s <= COPTER.promise["v_max_m_s"]


@pytest.mark.parametrize(
    ("mode", "name"), [(17.0, "BRAKE"), (9.0, "LAND"), (5.0, "LOITER")], ids=["brake", "land", "loiter"]
)
def test_a_copter_that_another_ground_station_takes_is_nobodys(
    copters: Autopilots, tmp_path: Path, mode: float, name: str
) -> None:
    ended = run(COPTER, copters, tmp_path, 40.0, commanded(copters, mav.MAV_CMD_DO_SET_MODE, 1.0, mode))
    found = lost(ended)
    assert f"it is in the mode {name}, not GUIDED" in found["cause"]
    assert found["lasted_s"] > 15.0
    assert f"it is in the mode {name}, not GUIDED" in ended.result["assumptions"]["2"]["A7"]["cause"]


def test_a_copter_without_gps_is_stopped_before_its_own_fail_safe_acts(copters: Autopilots, tmp_path: Path) -> None:
    ended = run(COPTER, copters, tmp_path, 40.0, without_gps(copters))
    assert "its GPS has" in lost(ended, noise_m=COPTER.promise["position_noise_m"])["cause"]


def test_a_copter_that_another_ground_station_sends_elsewhere_is_nobodys_as_long_as_that_lasts(
    copters: Autopilots, tmp_path: Path
) -> None:
    # Back to where it began, by a way that is free.
    ended = run(COPTER, copters, tmp_path, 40.0, sent_elsewhere(copters, 16.0, 16.0, 5.0))
    found = lost(ended)
    assert "another ground station" in found["cause"]
    # Two seconds of that, one without, what it swings back, and one at rest.
    assert found["lasted_s"] < 10.0
    # It comes to rest before it is sent places again.
    assert ended.seen.top_m_s <= COPTER.promise["v_max_m_s"]


def test_a_copter_that_stands_still_for_three_seconds_is_made_ready_again(copters: Autopilots, tmp_path: Path) -> None:
    # Its simulator stands still as well.
    assert lost(run(COPTER, copters, tmp_path, 60.0, stopped(copters, 3.0)), silent=True)["lasted_s"] < 10.0


def test_a_copter_that_is_killed_is_missed(copters: Autopilots, tmp_path: Path) -> None:
    assert "not been heard of" in lost(run(COPTER, copters, tmp_path, 40.0, killed(copters)), silent=True)["cause"]


def test_copters_stop_by_themselves_when_soter_is_killed(copters: Autopilots, tmp_path: Path) -> None:
    def kill(process: subprocess.Popen[bytes]) -> None:
        process.kill()

    ended = run(COPTER, copters, tmp_path, 60.0, kill)
    assert ended.way_m <= 0.8 * COPTER.unheard_m
