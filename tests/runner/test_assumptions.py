"""A run says which assumptions did not hold, and missions choose their reach models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from soter.config import load_mission
from soter.errors import IllFormedModule, Uncontrolled
from soter.runner import RunResult, run_mission
from soter.stack.actuator import RobotActuator

SURVEILLANCE = Path(__file__).parents[2] / "examples" / "surveillance.toml"
SAFE = {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
START_S = 20.0


def run(*faults: dict[str, Any], **overrides: Any) -> RunResult:
    given = {"backend": "kinematic", "planner": "straight-line", "duration_s": 40.0, "fault": [*faults], **overrides}
    return run_mission(load_mission(SURVEILLANCE, given)).result


def undeclared(kind: str, **options: Any) -> dict[str, Any]:
    return {"kind": kind, "declared": False, "start_s": START_S, **options}


FAULTS: list[tuple[dict[str, Any], str, str | None]] = [
    (undeclared("weak_brakes", factor=0.2), "A2", None),
    (undeclared("freeze", duration_s=2.0, robot=1), "A4", "A7"),
    (undeclared("bias", x_m=0.2, robot=1), "A6", "A7"),
    (undeclared("battery", offset=-0.2, robot=1), "A8", None),
    ({"kind": "kill", "start_s": START_S, "duration_s": 3.0, "robot": 1}, "A4", "A7"),
]


@pytest.mark.parametrize(("fault", "own", "peers"), FAULTS, ids=[fault["kind"] for fault, _, _ in FAULTS])
def test_what_breaks_an_assumption_is_in_the_result_by_number_and_robot(
    fault: dict[str, Any], own: str, peers: str | None
) -> None:
    result = run(fault, duration_s=60.0)
    first = result.assumptions[1][own]
    assert first.times >= 1
    assert START_S <= first.first_s <= 60.0
    assert first.cause
    assert "A9" not in result.assumptions[1], "a wrong sample says nothing about the workspace"
    if peers is not None:
        assert result.assumptions[2][peers].cause.startswith("robot 1: ")


def test_a_hand_over_that_comes_too_late_is_seen_and_costs_the_lease() -> None:
    result = run(undeclared("delay", commands_s=0.5, robot=1), targets="hostile", duration_s=60.0)
    assert "the robot reports AC in charge, not SC" in result.assumptions[1]["A12"].cause


def test_a_robot_that_somebody_took_for_a_time_is_in_the_result_and_its_peer_has_heard_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    renew = RobotActuator.renew

    def taken(actuator: RobotActuator) -> None:
        if actuator.robot.id == 1 and START_S <= actuator.robot.clock.now() < START_S + 3.0:
            raise Uncontrolled("its pilot has it")
        renew(actuator)

    monkeypatch.setattr(RobotActuator, "renew", taken)
    result = run()
    found = result.uncontrolled[1]
    assert (found.cause, found.first_s) == ("not under control: its pilot has it", START_S)
    assert 3.0 <= found.lasted_s <= 3.5
    assert "its pilot has it" in result.assumptions[2]["A7"].cause
    assert "robot 1 was not under control for" in result.troubles[0]


def test_in_a_mission_without_faults_every_assumption_holds() -> None:
    assert run(duration_s=120.0, targets="hostile").assumptions == {}


@pytest.mark.parametrize("model", ["speed-acceleration", "unicycle"])
def test_a_mission_with_another_reach_model_keeps_every_rule(model: str) -> None:
    chosen = {f"rta.{name}.model": model for name in ("collision", "obstacle", "geofence")}
    result = run(duration_s=300.0, targets="hostile", **chosen)
    assert result.status == "completed"
    assert result.violations == SAFE
    assert result.assumptions == {}


def test_a_declared_error_of_the_heading_is_no_alarm_of_a_model_that_looks_at_it() -> None:
    chosen = {f"rta.{name}.model": "unicycle" for name in ("collision", "obstacle", "geofence")}
    result = run({"kind": "bias", "heading_rad": 0.5}, duration_s=120.0, targets="hostile", **chosen)
    assert (result.violations, result.assumptions) == (SAFE, {})
    assert result.ac_share > 0.4


def test_the_default_reach_model_is_that_of_a_top_speed() -> None:
    chosen = {f"rta.{name}.model": "speed" for name in ("collision", "obstacle", "geofence")}
    assert run(**chosen).trace_sha256 == run().trace_sha256


def test_a_robot_whose_samples_may_be_wrong_by_anything_is_refused_a_model_that_looks_at_them() -> None:
    fault = {"kind": "freeze", "restamped": True, "duration_s": 0.05, "robot": 1}
    with pytest.raises(IllFormedModule, match=r"module 'geofence' is ill-formed.*'unicycle' needs"):
        run(fault, **{"rta.geofence.model": "unicycle"})
    assert run(fault, duration_s=1.0).status == "completed"
