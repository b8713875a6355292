"""What robots are asked to promise: the backend's own, then its table, then the robot's, checked in one place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from soter.config import MissionFile, load_mission
from soter.errors import ConfigError
from soter.registry import load_backend
from soter.runner import run_mission
from soter.sdk import Capabilities
from soter.specs import asked, promises, read_options
from tests.project.source import ROOT

QUICK = {"planner": "straight-line", "targets": "hostile"}


def mission(backend: str = "kinematic", **tables: Any) -> MissionFile:
    return load_mission(ROOT / "examples" / "surveillance.toml", {"backend": backend, **QUICK, **tables})


def of(loaded: MissionFile) -> dict[int, Capabilities]:
    backend, workspace = load_backend(loaded.backend, to_open=False), loaded.read_workspace()
    return asked(backend, read_options(backend, loaded, workspace), loaded, workspace)


def admissible(loaded: MissionFile) -> None:
    backend, workspace = load_backend(loaded.backend), loaded.read_workspace()
    promises(backend, read_options(backend, loaded, workspace), loaded, workspace)


def test_what_a_backend_of_ones_own_cannot_be_asked_is_named_with_its_line(tmp_path: Path) -> None:
    name = "soter.adapters.pybullet:KinematicBackend"
    (tmp_path / "m.toml").write_text(
        f'workspace = "{ROOT / "examples" / "surveillance.xml"}"\nbackend = "{name}"\n'
        f'[backends."{name}".promise]\nsetpoint_period_s = 0.001\n'
    )
    with pytest.raises(ConfigError) as refused:
        of(load_mission(tmp_path / "m.toml"))
    said = f'm.toml:4: backends."{name}".promise.setpoint_period_s: it is 0.001, allowed: at least 0.05'
    assert str(refused.value).endswith(said)


@pytest.mark.parametrize("backend", ["kinematic", "pybullet", "mavlink", "mavsdk", "ros2", "zenoh"])
def test_one_robot_comes_before_all_and_all_before_what_the_backend_declares(backend: str) -> None:
    plain = of(mission(backend))
    tables = {
        f"backends.{backend}.promise": {"v_max_m_s": 0.5, "body_radius_m": 0.2},
        "robots": {"2": {"v_max_m_s": 0.4, "lease_s": 0.3}},
    }
    found = of(mission(backend, **tables))
    assert plain[1] == plain[2]
    assert {robot_id: (each.v_max_m_s, each.body_radius_m) for robot_id, each in found.items()} == {
        1: (0.5, 0.2), 2: (0.4, 0.2)
    }  # fmt: skip
    assert (found[1].lease_s, found[2].lease_s) == (plain[1].lease_s, 0.3)
    # Who is faster strays farther from its way where nothing else is said.
    assert found[1].tube_m >= found[2].tube_m >= plain[1].tube_m


@pytest.mark.parametrize(
    ("tables", "key", "allowed"),
    [
        ({"robots": {"2": {"latency_s": 0.01}}}, "robots.2.latency_s", "at least 0.05"),
        ({"robots": {"1": {"v_max_m_s": 1.0, "tube_m": 0.02}}}, "robots.1.tube_m", "at least 0.0"),
        ({"robots": {"2": {"reverses": False}}}, "robots.2.reverses", "True"),
        ({"robots": {"7": {"v_max_m_s": 1.0}}}, "robots.7", "1, 2"),
        ({"backends.kinematic.promise": {"brake_m_s2": 9.0}}, "backends.kinematic.promise.brake_m_s2", "at most 4"),
        ({"robots": {"2": {"body_radius_m": 0.3}}}, "rta.collision.phi_safe_m", "at least 0.405"),
    ],
)
def test_what_robots_cannot_be_is_refused_with_its_key(tables: dict[str, Any], key: str, allowed: str) -> None:
    loaded = mission(**tables)
    with pytest.raises(ConfigError) as caught:
        admissible(loaded)
    assert caught.value.key == key
    assert f"allowed: {allowed}" in str(caught.value)


def test_a_fleet_of_unlike_robots_keeps_every_rule() -> None:
    loaded = load_mission(ROOT / "examples" / "unlike-fleet.toml", {**QUICK, "duration_s": 90.0})
    result = run_mission(loaded).result
    assert result.violations == dict.fromkeys(("battery", "geofence", "collision", "obstacle"), 0)
    assert result.disengagements_total > 5
    assert not result.assumptions
    assert not result.never_moved


def test_brakes_that_are_declared_a_fifth_too_good_are_seen_and_reported() -> None:
    weak = {"kind": "weak_brakes", "factor": 1.0 / 1.2, "declared": False}
    result = run_mission(mission(fault=[weak], duration_s=60.0)).result
    assert {robot_id: [*seen] for robot_id, seen in result.assumptions.items()} == {1: ["A2"], 2: ["A2"]}
    worst = [each for seen in result.assumptions.values() for each in seen["A2"].worst]
    assert {each.unit for each in worst} == {"m/s"}
    # A fifth of what the brakes take of the speed in one period.
    assert max(each.excess for each in worst) == pytest.approx(0.05 * (1.0 - 1.0 / 1.2), abs=1e-3)
