"""Two boats with a real ArduRover in a current: `make test-autopilot ARDUROVER=/path/to/ardurover`.

They run the mission of `examples/ardurover-boat`, in real time, with the physics of `tests.autopilot.boat`.
"""

from __future__ import annotations

import math
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from soter.adapters.mavlink.backend import MavlinkBackend
from soter.adapters.mavlink.options import MavlinkConfig
from soter.cli.given import read_given
from soter.conformance.driver import drive_until
from soter.sdk import Controller, Waypoint
from tests.autopilot.ardupilot import Autopilots
from tests.autopilot.events import sent_elsewhere, setting
from tests.autopilot.missions import RULES, Example, lost, run
from tests.autopilot.test_ardurover import PROGRAM, SIMULATED

pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="needs ArduRover; see `make test-autopilot`"),
    pytest.mark.timeout(3600.0),
]

# What the physics need: motors that are off until it is armed, no transmitter, steps in which Python keeps up, tuning.
_TUNED: Final = {
    "MOT_SAFE_DISARM": 1, "FS_THR_ENABLE": 0, "SIM_RATE_HZ": 200, "CRUISE_SPEED": 1, "CRUISE_THROTTLE": 24,
    "ATC_STR_RAT_FF": 0.4, "ATC_STR_RAT_P": 0.2, "ATC_STR_RAT_I": 0.2, "ATC_SPEED_P": 1.2, "ATC_SPEED_I": 0.1,
}  # fmt: skip
BOAT: Final = Example("ardurover-boat", "", SIMULATED | _TUNED, current_m_s=(0.16, -0.1))
DRIFTS_M: Final = 0.3 + 0.2 + 5.0 * 0.25
"""LOIT_RADIUS, WP_RADIUS, and 5 s at what is promised to show at rest."""


@pytest.fixture
def boats(tmp_path: Path) -> Iterator[Autopilots]:
    with BOAT.start(PROGRAM, tmp_path / "vehicles") as started:
        yield started


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_two_boats_in_a_current_with_hostile_targets_break_no_rule(
    boats: Autopilots, tmp_path: Path, backend: str
) -> None:
    ended = run(BOAT, boats, tmp_path, float(os.environ.get("AUTOPILOT_S", "180")), backend=backend)
    result = ended.result
    assert (ended.code, result["violations"], result["uncontrolled"]) == (0, RULES, {})
    # Legs of safe controllers are long for boats.
    assert result["ac_share"] >= 0.7
    assert ended.top_m_s <= 1.0
    # They are left in LOITER, and keep their places.
    places = {robot_id: boats.seen[robot_id][:2] for robot_id in boats.processes}
    time.sleep(30.0)
    for robot_id, place in places.items():
        assert math.dist(place, boats.seen[robot_id][:2]) <= DRIFTS_M


def test_a_boat_that_is_told_to_stand_is_held_as_long_as_that_lasts(boats: Autopilots) -> None:
    settings = [f"backends.mavlink.connection=udpin:127.0.0.1:{boats.port}"]
    given = read_given(BOAT.path, None, settings, 1, 28.0)
    assert isinstance(given.config, MavlinkConfig)
    with MavlinkBackend().open(given.config, [given.spec]) as fleet:
        (robot,) = fleet.robots
        robot.init(90.0)
        goal = robot.goto(Waypoint(given.spec.x_m + 6.0, given.spec.y_m + 6.0), Controller.SC)
        drive_until(fleet, lambda: boats.seen[1][3] > 0.8, 30.0)
        goal.cancel()
        drive_until(fleet, lambda: boats.seen[1][3] < 0.25, 5.0)
        stopped, farthest_m = boats.seen[1][:2], 0.0

        def gets_far() -> bool:
            nonlocal farthest_m
            farthest_m = max(farthest_m, math.dist(stopped, boats.seen[1][:2]))
            robot.renew_lease()  # raises where it is nobody's
            return farthest_m > DRIFTS_M

        assert not drive_until(fleet, gets_far, 180.0)
        print(f"\nfarthest from where it had stopped: {farthest_m:.2f} m")
        assert farthest_m > 0.2


def test_boats_stop_and_are_held_when_soter_is_killed(boats: Autopilots, tmp_path: Path) -> None:
    def kill(process: subprocess.Popen[bytes]) -> None:
        process.kill()

    ended = run(BOAT, boats, tmp_path, 60.0, kill)
    time.sleep(60.0)
    assert ended.way_m <= BOAT.unheard_m + DRIFTS_M
    killed_s = boats.paths[1][-1][0] - 55.0
    held = [(x_m, y_m) for at_s, x_m, y_m, _ in boats.paths[1] if at_s > killed_s]
    assert max(math.dist(held[0], each) for each in held) <= 2.0 * DRIFTS_M


def test_a_boat_whose_radius_another_ground_station_sets_is_nobodys(boats: Autopilots, tmp_path: Path) -> None:
    assert "its LOIT_RADIUS is 5" in lost(run(BOAT, boats, tmp_path, 40.0, setting(boats, "LOIT_RADIUS", 5.0)))["cause"]


def test_a_boat_that_another_ground_station_sends_elsewhere_is_nobodys(boats: Autopilots, tmp_path: Path) -> None:
    found = lost(run(BOAT, boats, tmp_path, 60.0, sent_elsewhere(boats, 70.0, 70.0)))
    assert "another ground station" in found["cause"]
    assert found["lasted_s"] < 8.0


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [("SERVO1_FUNCTION", 26.0, "its SERVO1_FUNCTION is 26"), ("LOIT_RADIUS", 2.0, "its LOIT_RADIUS is 2")],
    ids=["rudder", "radius"],
)
def test_a_boat_that_is_not_held_as_is_promised_is_refused_before_any_is_armed(
    boats: Autopilots, tmp_path: Path, name: str, value: float, says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    time.sleep(10.0)
    boats.set(1, name, value)
    ended = run(BOAT, boats, tmp_path, 5.0)
    assert (ended.code, ended.result) == (2, {})
    assert math.isnan(ended.ready_s)
    assert not any(boats.armed(robot_id) for robot_id in boats.processes)
    assert says in capfd.readouterr().err
