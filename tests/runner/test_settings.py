"""What a mission may set leaves every AC its robot: a setting that does not is refused by its key."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.adapters.pybullet.backend import KinematicBackend
from soter.config import MissionFile, load_mission
from soter.errors import BackendError, ConfigError
from soter.registry import load_backend
from soter.runner import run_mission
from soter.sdk import Capabilities
from soter.specs import promises, read_options
from tests.project.source import ROOT

SURVEILLANCE = ROOT / "examples" / "surveillance.toml"
PERIOD_S = 0.05
MODULES = ("collision", "obstacle", "geofence", "battery")
LOW = {"battery.initial": [0.1, 0.1], "battery.charge_s": 5.0}


def ticked(tick_s: float, **changes: Any) -> dict[str, Any]:
    """Settings with another tick, of which every Delta is a multiple."""
    deltas = {"collision": 0.1, "obstacle": 0.05, "geofence": 0.5, "battery": 1.0, "path": 0.05}
    found = {f"rta.{name}.delta_s": round(max(1, round(each / tick_s)) * tick_s, 9) for name, each in deltas.items()}
    return {"base_tick_s": tick_s, **found, **changes}


def mission(settings: dict[str, Any]) -> MissionFile:
    usual = {
        "backend": "kinematic", "planner": "straight-line", "duration_s": 120.0, "battery.initial": [1.0, 1.0],
        "rta.geofence.delta_s": 0.5, "rta.geofence.phi_safer_inset_m": 0.5,
    }  # fmt: skip
    return load_mission(SURVEILLANCE, {**usual, **settings})


def promised(asked: MissionFile) -> None:
    workspace, backend = asked.read_workspace(), load_backend(asked.backend, to_open=False)
    promises(backend, read_options(backend, asked, workspace), asked, workspace)


class Shrunk(KinematicBackend):
    """Its robots have bodies that meet nothing."""

    @classmethod
    def promises(cls, config: Any) -> Capabilities:
        return replace(super().promises(config), body_radius_m=-1.0)


def test_a_backend_whose_robots_promise_what_cannot_be_is_refused_by_the_figure() -> None:
    named = r"Shrunk: its robots cannot promise that: Capabilities\.body_radius_m is -1\.0, allowed: a number from 0 to"
    with pytest.raises(BackendError, match=named):
        promised(mission({"backend": f"{__name__}:Shrunk"}))


ADMITTED = [
    ticked(0.1),
    ticked(0.02, **{"backends.kinematic.promise.sample_age_s": 0.05}),
    {f"rta.{name}.dwell_s": 24.0 if name == "collision" else 60.0 for name in MODULES},
    {"rta.battery.phi_safer": 1.0, "rta.battery.dwell_s": 3.0, **LOW},
    {"rta.battery.delta_s": 60.0},
    {"rta.geofence.phi_safer_inset_m": 2.4},
    {"rta.collision.phi_safe_m": 1.0, "rta.collision.phi_safer_m": 1.2},
    {"rta.obstacle.phi_safe_m": 0.3, "rta.obstacle.phi_safer_m": 0.4},
]


@pytest.mark.parametrize("settings", ADMITTED, ids=lambda each: ",".join(each)[:60])
def test_what_is_admitted_gives_every_ac_its_robot(settings: dict[str, Any]) -> None:
    result = run_mission(mission(settings), accept_unproved="rta.geofence.phi_safer_inset_m" in settings).result
    assert result.ac_share > 0.1
    assert not any(result.assumptions.values())


@given(st.floats(0.004, 0.3).map(lambda each: round(each, 3)))
def test_a_tick_between_two_samples_is_refused_and_the_nearest_that_is_not_is_named(tick_s: float) -> None:
    asked = mission(ticked(tick_s, **{"backends.kinematic.promise.lease_s": 0.3}))
    nearest_s = max(1, round(tick_s / PERIOD_S)) * PERIOD_S
    if abs(nearest_s - tick_s) < 1e-9:
        promised(asked)
        return
    with pytest.raises(ConfigError, match=rf"base_tick_s: it is {tick_s:g}, .* nearest is {nearest_s:g}$"):
        promised(asked)


def test_a_tick_between_two_samples_is_allowed_to_robots_that_promise_no_younger_ones() -> None:
    promised(mission(ticked(0.02, **{"backends.kinematic.promise.sample_age_s": PERIOD_S})))


@pytest.mark.parametrize("tick_s", [0.05, 0.1, 0.15, 0.2, 0.3])
@pytest.mark.parametrize("lease_s", [0.05, 0.1, 0.2, 0.3])
def test_robots_do_not_stop_between_two_ticks_or_are_refused(tick_s: float, lease_s: float) -> None:
    room = {"rta.collision.phi_safe_m": 0.6, "rta.collision.phi_safer_m": 1.2, "rta.obstacle.phi_safer_m": 0.4}
    lease = {"backends.kinematic.promise.lease_s": lease_s, "robots": 1, "duration_s": 60.0}
    asked = mission(ticked(tick_s, **room, **lease, **{"rta.obstacle.delta_s": tick_s, "battery.initial": [1.0]}))
    if tick_s > lease_s:
        with pytest.raises(ConfigError, match=rf"base_tick_s: it is {tick_s:g}, .* {lease_s:g} s, .* longer lease_s$"):
            promised(asked)
        return
    track = run_mission(asked).tracks.tracks[1]
    ways_m = [math.dist(*ends) for ends in pairwise(zip(track.x_m, track.y_m, strict=True))]
    assert max(ways_m) / (track.time_s[1] - track.time_s[0]) > 0.95 * 0.22


@given(st.lists(st.floats(-0.4, -0.01), min_size=1, max_size=2), st.floats(0.5, 1.0), st.floats(0.5, 3.0))
def test_a_charge_that_a_robot_never_reports_is_not_asked_of_it(
    offsets: list[float], phi_safer: float, pause_s: float
) -> None:
    fault = {"kind": "battery", "robot": 2, "duration_s": 10.0, "every_s": 10.0 + pause_s}
    asked = mission({"fault": [{**fault, "offset": each} for each in offsets], "rta.battery.phi_safer": phi_safer})
    most = 1.0 + sum(offsets)
    if phi_safer <= most or pause_s >= 1.3 + 1e-6:
        promised(asked)
    elif pause_s < 1.3 - 1e-6:
        with pytest.raises(ConfigError, match=rf"rta\.battery\.phi_safer: .* robot 2 .* at most {most:g}$"):
            promised(asked)
