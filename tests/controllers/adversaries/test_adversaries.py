"""Adversaries: by name, with options, and that each of them really attacks; whatever they do, no rule is broken."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from soter.config import MissionFile, load_mission
from soter.controllers import ADVERSARIES, PREFIX, controller_class
from soter.controllers.adversaries import Adversary
from soter.controllers.adversaries.base import RobotFacts
from soter.errors import ConfigError
from soter.runner import RunResult, run_mission
from soter.sdk import RULES

ROOT = Path(__file__).parents[3]
SURVEILLANCE = ROOT / "examples" / "surveillance.toml"

# What the robots promise: R(H) of each module with the default tables, in metres.
FACTS = RobotFacts()
REACH_M = {
    "collision": FACTS.reach_m(0.1, robots=2),
    "obstacle": FACTS.reach_m(0.05),
    "geofence": FACTS.reach_m(0.5),
}


def mission(ac: str, **overrides: Any) -> MissionFile:
    """A mission with an adversary; double underscores in names stand for dots."""
    given: Mapping[str, object] = {name.replace("__", "."): value for name, value in overrides.items()}
    charged = {"backend": "kinematic", "battery.initial": [0.9, 0.9], "duration_s": 60.0}
    return load_mission(SURVEILLANCE, {**charged, "ac": ac, **given})


@cache
def attacked(name: str, duration_s: float) -> RunResult:
    """The result of a run with a built-in adversary."""
    return run_mission(mission(PREFIX + name, duration_s=duration_s)).result


# --- what they do ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(set(ADVERSARIES) - {"flood"}))
def test_no_rule_is_broken(name: str) -> None:
    result = attacked(name, 120.0)
    assert result.status == "completed"
    assert result.ac == PREFIX + name
    assert result.violations == dict.fromkeys(RULES, 0)
    assert result.min_margin is not None
    assert min(result.min_margin.values()) >= 0.0
    assert result.deterministic


@pytest.mark.parametrize(
    ("name", "rules"),
    [
        ("chase", {"collision"}),
        ("fastest-to-boundary", {"collision", "obstacle", "geofence"}),
        ("search", {"collision", "obstacle", "geofence"}),
        ("pincer", {"collision", "obstacle"}),
        ("boundary-hugging", {"obstacle", "geofence"}),
        ("random", {"obstacle"}),
        ("nan", {"obstacle"}),
    ],
)
def test_it_comes_near_the_edges(name: str, rules: set[str]) -> None:
    margins = attacked(name, 120.0).min_margin
    assert margins is not None
    assert {rule for rule in rules if margins[rule] > 0.7 * REACH_M[rule]} == set()


@pytest.mark.parametrize("name", ["chase", "fastest-to-boundary", "search", "pincer"])
def test_it_never_stops_attacking(name: str) -> None:
    result = attacked(name, 120.0)
    assert result.disengagements_total / (result.robots * result.duration_s) > 1.0 / 30.0


@pytest.mark.parametrize(
    ("name", "workspace"),
    [(name, "l-hall.toml") for name in sorted(set(ADVERSARIES) - {"flood", "raises"})]
    + [(name, "arena.toml") for name in ("boundary-hugging", "pincer", "search")],
)
def test_ground_of_any_shape_is_attacked(name: str, workspace: str) -> None:
    chosen: dict[str, Any] = {"workspace": workspace, "ac": PREFIX + name, "robots": 2, "duration_s": 30.0}
    result = run_mission(load_mission(ROOT / "examples" / "worlds" / "patrol.toml", chosen)).result
    assert (result.status, result.violations, result.failed_robots) == ("completed", dict.fromkeys(RULES, 0), {})


@pytest.mark.parametrize("name", ["boundary-hugging", "pincer", "fastest-to-boundary"])
def test_in_any_shape_it_comes_near_the_edges(name: str) -> None:
    chosen: dict[str, Any] = {"workspace": "l-hall.toml", "ac": PREFIX + name, "robots": 2, "duration_s": 120.0}
    margins = run_mission(load_mission(ROOT / "examples" / "worlds" / "patrol.toml", chosen)).result.min_margin
    assert margins is not None
    assert min(margins["geofence"], margins["obstacle"]) < 0.15


def test_a_frozen_one_moves_nothing_and_keeps_control() -> None:
    result = attacked("frozen", 120.0)
    assert result.disengagements_total == 0
    assert result.ac_share > 0.99


def test_one_that_fails_leaves_its_robots_to_the_safe_controllers() -> None:
    result = attacked("raises", 120.0)
    assert result.ac_share == 0.0
    assert set(result.failed_robots) == {1, 2}
    assert "this adversary always fails" in result.failed_robots[1]


def test_a_flood_changes_nothing_and_says_that_it_does_not_repeat() -> None:
    result = run_mission(mission("adversary:flood", duration_s=5.0)).result
    assert result.violations == dict.fromkeys(RULES, 0)
    assert not result.deterministic
    assert "2 threads" in result.nondeterminism


def test_a_flood_from_one_thread_repeats() -> None:
    options = {"adversaries": {"flood": {"threads": 0, "commands": 50}}, "duration_s": 20.0}
    traces = {run_mission(mission("adversary:flood", **options)).result.trace_sha256 for _ in range(2)}
    assert len(traces) == 1


@pytest.mark.parametrize("name", ["random", "fastest-to-boundary", "chase", "pincer", "search", "nan"])
def test_the_seed_decides_all(name: str) -> None:
    def trace(seed: int) -> str:
        return run_mission(mission(PREFIX + name, seed=seed, duration_s=30.0)).result.trace_sha256

    assert trace(3) == trace(3)
    if name != "fastest-to-boundary":
        assert trace(3) != trace(4)


def test_without_modules_they_break_the_rules() -> None:
    result = run_mission(mission("adversary:fastest-to-boundary", rta__enabled=False)).result
    assert result.violations is not None
    assert sum(result.violations.values()) > 0


def test_robots_that_are_alone_have_nobody_to_chase() -> None:
    for name in ("chase", "pincer", "fastest-to-boundary", "search"):
        assert run_mission(mission(PREFIX + name, robots=1, duration_s=20.0)).result.status == "completed"


# --- names and options -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(ADVERSARIES))
def test_built_in_names_lead_to_adversaries(name: str) -> None:
    assert issubclass(controller_class(mission(PREFIX + name)), Adversary)


class Mine(Adversary):
    """A user's own, which hangs on to nothing."""

    acted = 0

    def act(self, now_s: float, tick: int) -> None:
        type(self).acted += 1


class FailsToBegin(Mine):
    def begin(self, arena: object) -> None:
        raise RuntimeError("not a word")


class FailsToHear(Mine):
    def hear(self, report: object) -> None:
        raise RuntimeError("not a word")


def test_one_of_the_user_is_named_by_its_class() -> None:
    assert run_mission(mission(f"{__name__}:Mine", duration_s=1.0)).result.status == "completed"
    assert Mine.acted == 20


@pytest.mark.parametrize("name", ["FailsToBegin", "FailsToHear"])
def test_one_that_fails_elsewhere_loses_its_robots_too(name: str) -> None:
    result = run_mission(mission(f"{__name__}:{name}", duration_s=5.0)).result
    assert result.status == "completed"
    assert "not a word" in result.failed_robots[1]
    assert "not a word" in result.failed_robots[2]


@pytest.mark.parametrize(
    ("ac", "message"),
    [
        ("adversary:chess", r"ac: unknown AC 'adversary:chess', did you mean 'adversary:chase'"),
        ("adversary:", "unknown AC 'adversary:'.*; known are mission, adversary:random"),
        ("misson", "did you mean 'mission'"),
        ("chase", "unknown AC 'chase'"),
    ],
)
def test_a_name_of_no_adversary_is_refused(ac: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run_mission(mission(ac))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("chase", {"darts": 1.0}, "adversaries.chase.darts: unknown key.*did you mean 'dart'"),
        ("chase", {"dart": 2.0}, "adversaries.chase.dart: it is 2.0"),
        ("search", {"candidates": 0}, "adversaries.search.candidates: it is 0"),
        ("search", {"facts": {"v_max_m_s": "fast"}}, "adversaries.search.facts.v_max_m_s"),
        ("frozen", {"hard": True}, "adversaries.frozen.hard: unknown key"),
    ],
)
def test_bad_options_are_refused(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run_mission(mission(PREFIX + name, adversaries={name: options}))
