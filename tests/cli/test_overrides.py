"""Options and `--set` as overrides."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.cli.overrides import from_here, load_with_engine, merge, module_list, parse_setting
from soter.errors import ConfigError
from tests.cli.conftest import MISSION


@pytest.mark.parametrize(
    ("setting", "key", "value"),
    [
        ("seed=3", "seed", 3),
        ("rta.geofence.delta_s = 0.25", "rta.geofence.delta_s", 0.25),
        ("rta.enabled=false", "rta.enabled", False),
        ('rta.modules=["battery"]', "rta.modules", ["battery"]),
        ("targets=uniform", "targets", "uniform"),
        ('targets="uniform"', "targets", "uniform"),
        ("planner=my.module:Planner", "planner", "my.module:Planner"),
        ("workspace=a=b.xml", "workspace", "a=b.xml"),
        ("seed=1\nduration_s=5", "seed", "1\nduration_s=5"),
    ],
)
def test_a_setting_is_read_as_toml_or_as_a_text(setting: str, key: str, value: object) -> None:
    assert parse_setting(setting) == (key, value)


@pytest.mark.parametrize("setting", ["seed", "=3", "seed=", " = "])
def test_a_malformed_setting_is_refused(setting: str) -> None:
    with pytest.raises(ConfigError, match="not of the form key=value"):
        parse_setting(setting)


@pytest.mark.parametrize(
    ("name", "file", "rest"),
    [
        ("mine.py:Mine", "mine.py", ":Mine"),
        ("./mine.py", "mine.py", ""),
        ("a//b/./mine.py:Mine", "a/b/mine.py", ":Mine"),
        ("../mine.py", "../mine.py", ""),
        ("/a/mine.py:Mine", "/a/mine.py", ":Mine"),
    ],
)
def test_a_file_is_one_of_the_present_folder_however_it_is_written(name: str, file: str, rest: str) -> None:
    assert from_here(name) == f"{Path.cwd() / file}{rest}"


def test_a_module_is_of_no_folder() -> None:
    assert (from_here("package.module:Mine"), from_here("surveillance"), from_here(None)) == (
        "package.module:Mine", "surveillance", None,
    )  # fmt: skip


def test_options_that_are_not_given_override_nothing() -> None:
    assert merge({"seed": None, "robots": 1, "rta.enabled": False}, ["a.b=1"]) == {
        "robots": 1, "rta.enabled": False, "a.b": 1,
    }  # fmt: skip


@pytest.mark.parametrize(("options", "settings"), [({"seed": 1}, ["seed=2"]), ({}, ["seed=1", "seed=2"])])
def test_a_key_is_given_once(options: dict[str, object], settings: list[str]) -> None:
    with pytest.raises(ConfigError, match="command line: seed: it is given twice"):
        merge(options, settings)


def test_modules_are_split_at_commas() -> None:
    assert module_list("battery, geofence,") == ["battery", "geofence"]


@pytest.mark.parametrize("text", ["", " ", ",,"])
def test_no_module_is_no_list(text: str) -> None:
    with pytest.raises(ConfigError, match="--no-rta"):
        module_list(text)


@pytest.mark.parametrize("backend", ["pybullet", "my.adapter:Backend"])
def test_the_engine_becomes_an_option_of_the_missions_backend(backend: str) -> None:
    mission = load_with_engine(MISSION, {"backend": backend}, "kinematic")
    assert mission.backends[backend]["engine"] == "kinematic"


def test_the_backend_of_the_file_counts_if_no_other_is_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "mission.toml"
    file.write_text('workspace = "w.xml"\nbackend = "elsewhere"\n')
    assert load_with_engine(file, {}, "fast").backends == {"elsewhere": {"engine": "fast"}}
    assert load_with_engine(file, {}, None).backends == {}
