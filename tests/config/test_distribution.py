"""The tables that say which process of a mission does what."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from soter.config import load_mission
from soter.errors import ConfigError

EXAMPLES = Path(__file__).parents[2] / "examples"
GOOD: dict[str, Any] = {
    "alpha": {"robots": [1]},
    "beta": {"robots": [2], "bus": {"connect": ["tcp/127.0.0.1:7448"]}},
    "ground": {"planner": True},
}


def load(processes: dict[str, Any], **overrides: Any) -> None:
    load_mission(
        EXAMPLES / "surveillance.toml", {"distribution.processes": processes, **overrides}
    ).read_workspace()  # fmt: skip


def test_every_robot_in_one_process_and_one_task_planner() -> None:
    load(GOOD)
    load({"all": {"robots": [1, 2], "planner": True}})
    mission = load_mission(EXAMPLES / "surveillance.toml", {"distribution.processes": GOOD})
    assert mission.distribution.processes["alpha"].robots == (1,)
    assert mission.distribution.via == "zenoh"


def test_a_mission_without_the_table_is_in_one_process() -> None:
    assert not load_mission(EXAMPLES / "surveillance.toml").distribution.processes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"beta": {"robots": [1, 2]}}, r"beta.robots: it is \[1, 2\], allowed: each robot once; robot 1 is in 'alpha'"),
        ({"beta": {"robots": [2, 2]}}, r"robot 2 is in 'beta' already"),
        ({"beta": {"robots": [3]}}, r"beta.robots: there is no robot 3; allowed: 1, 2"),
        ({"beta": {"robots": ["2"]}}, r"beta.robots.0: it is '2', allowed: a whole number"),
        ({"alpha": {"robots": [1], "planner": True}}, r"one task planner; there is one in 'alpha' already"),
        ({"ground": {"robots": []}}, r"ground: .* allowed: robots = \[...\], planner = true, or both"),
        ({"alpha": {"robots": [1], "planer": True}}, r"alpha.planer: unknown key, did you mean 'planner'\?"),
        ({"Ground": {"planner": True}}, r"Ground: .* allowed: a name of small letters"),
    ],
)
def test_what_is_wrong_with_processes_is_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load({**GOOD, **change})


def test_a_mission_without_a_task_planner_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"planner = true in exactly one process; it is in none"):
        load({"alpha": {"robots": [1, 2]}})


def test_a_robot_of_no_process_is_named() -> None:
    with pytest.raises(ConfigError, match=r"no process has the robots 1; allowed: every robot in exactly one"):
        load({name: GOOD[name] for name in ("beta", "ground")})


def test_fewer_robots_than_processes_know_of_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"beta.robots: there is no robot 2; allowed: 1"):
        load(GOOD, robots=1)


@pytest.mark.parametrize(
    ("key", "value"),
    [("prefix", "/soter"), ("prefix", "so ter"), ("prefix", "soter/*"), ("wait_s", 0), ("wait_s", "long"), ("via", "")],
)
def test_other_values_have_bounds(key: str, value: object) -> None:
    with pytest.raises(ConfigError, match=rf"distribution\.{key}: it is .* allowed"):
        load(GOOD, **{f"distribution.{key}": value})
