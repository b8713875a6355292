"""A campaign file: what it runs, in which order, and what is refused before anything is."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest

from soter.campaign.plan import load_campaign
from soter.campaign.tables import RangeTable, flat
from soter.errors import ConfigError
from tests.campaign.here import MISSION, campaign, write
from tests.project.markdown import blocks
from tests.project.source import ROOT

SPLIT: dict[str, Any] = {
    "set": {"fault": [{"kind": "loss", "samples": 0.1}]}, "seeds": {"count": 20}, "split": {"rule": "collision"},
}  # fmt: skip


def settings(folder: Path, **part: Any) -> list[dict[str, Any]]:
    read = campaign(folder, part)
    return [dict(job.settings) for job in read.jobs(read.parts["p0"])]


def test_a_grid_is_every_combination_with_one_seed_after_the_other(tmp_path: Path) -> None:
    found = settings(tmp_path, grid={"targets": ["grid", "hostile"], "robots": [1, 2]}, seeds=[3, 5])
    assert [(each["seed"], each["targets"], each["robots"]) for each in found] == [
        (seed, targets, robots) for seed in (3, 5) for targets in ("grid", "hostile") for robots in (1, 2)
    ]


def test_an_axis_may_set_several_keys(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"grid": {"kind": {
        "wide": {"rta.collision.phi_safer_m": 0.6, "rta": {"obstacle": {"phi_safer_m": 0.15}}}, "as-it-is": {},
    }}})  # fmt: skip
    jobs = [*read.jobs(read.parts["p0"])]
    assert [job.axes for job in jobs] == [{"kind": "wide"}, {"kind": "as-it-is"}]
    wide = jobs[0].load().rta
    assert (wide.collision.phi_safer_m, wide.obstacle.phi_safer_m) == (0.6, 0.15)


def test_nested_tables_are_dotted_keys_and_empty_ones_are_values() -> None:
    nested = {"battery": {"initial": {}}, "backends": {"a.b:C": {"x": 1}}, "rta.path.delta_s": 0.1}
    assert flat(nested) == {"battery.initial": {}, 'backends."a.b:C".x': 1, "rta.path.delta_s": 0.1}


def test_a_sample_is_drawn_from_its_seed_and_grows_without_change(tmp_path: Path) -> None:
    draw = {"battery.drive_s": {"low": 100.0, "high": 1000.0, "log": True}, "targets": ["grid", "uniform"]}
    few = settings(tmp_path, sample={"count": 3, "draw": draw})
    many = settings(tmp_path, sample={"count": 6, "draw": draw})
    assert many[:3] == few
    assert len({each["battery.drive_s"] for each in many}) == 6
    assert all(100.0 <= each["battery.drive_s"] <= 1000.0 for each in many)
    assert few != settings(tmp_path, sample={"count": 3, "seed": 1, "draw": draw})


def test_a_range_has_its_ends() -> None:
    assert [RangeTable(low=1.0, high=9.0, whole=True).at(part) for part in (0.0, 0.5, 1.0)] == [1, 5, 9]
    assert RangeTable(low=0.1, high=10.0, log=True).at(0.5) == 1.0


def test_parts_take_what_stands_beside_them_and_add_to_it(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"set": {"duration_s": 1.0}}, {"seeds": [9]}, seeds={"first": 4, "count": 2})
    first, second = ([*read.jobs(part)] for part in read.parts.values())
    assert [(job.seed, job.settings["duration_s"]) for job in first] == [(4, 1.0), (5, 1.0)]
    assert [(job.seed, job.settings["duration_s"]) for job in second] == [(9, 2.0)]
    assert first[0].settings["backend"] == "kinematic"


def test_a_command_says_all_of_a_run(tmp_path: Path) -> None:
    read = campaign(
        tmp_path, {"set": {"rta.modules": ["geofence"], "battery": {"initial": {}}}, "accept_unproved": True},
        set={"backend": "pybullet", "engine": "kinematic", "duration_s": 2.0},
    )  # fmt: skip
    (job,) = read.jobs(read.parts["p0"])
    words = shlex.split(job.command)
    assert words[:2] == ["soter", "run"]
    assert Path(words[2]).resolve() == Path(MISSION)
    for option, value in (("--backend", "pybullet"), ("--engine", "kinematic"), ("--seed", "1")):
        assert words[words.index(option) + 1] == value
    assert {'rta.modules=["geofence"]', "battery.initial={  }", "--accept-unproved", "--no-record"} <= set(words)
    assert job.load().backends["pybullet"]["engine"] == "kinematic"


def test_ids_tell_runs_apart(tmp_path: Path) -> None:
    read = campaign(tmp_path, {"seeds": [1, 2]}, {"seeds": [1, 2]})
    jobs = [job for part in read.parts.values() for job in read.jobs(part)]
    assert len({job.id for job in jobs}) == 4
    assert [job.id for job in jobs] == [job.id for part in read.parts.values() for job in read.jobs(part)]


@pytest.mark.parametrize(
    ("part", "key"),
    [
        ({"seed": 1}, "part.0.seed"),
        ({"set": {"duration": 1.0}}, "part.0.set"),
        ({"grid": {"targets": ["grid", "gird"]}}, "part.0.grid"),
        ({"grid": {"mission": {"targets": ["grid"]}}}, 'if the axis is of one key: grid."mission.targets" = [...]'),
        ({"set": {"backend": "ros2"}}, "part.0.set.backend"),
        ({"mission": "none.toml"}, None),
        ({"require": ["violations is 0"]}, "part.0.require.0"),
        ({"until": "violations < 0 per robot-hour at 95 %"}, "part.0.until"),
        ({"until": "violations < 0.1 per robot-hour"}, "part.0.until"),
        ({"repeats": "p7"}, "part.0.repeats"),
        ({"sample": {"count": 1, "draw": {"seed": {"low": 2, "high": 1}}}}, "part.0.sample.draw.seed"),
        ({"search": {"minimise": "min_margin", "runs": 1, "over": {}}}, "part.0.search.over"),
        ({"name": "Has Spaces"}, "part.0.name"),
        ({"split": {"rule": "collision"}}, "part.0.seeds"),
        ({"seeds": [*range(19), 0], "split": {"rule": "collision"}}, "part.0.seeds"),
        ({**SPLIT, "set": {}}, "part.0.split: its mission has no"),
        ({**SPLIT, "set": {**SPLIT["set"], "reseed": [{"at_s": 1.0, "seed": 1}]}}, "already"),
        ({**SPLIT, "split": {"rule": "colission"}}, "part.0.split.rule"),
        ({**SPLIT, "split": {"rule": "collision", "at_most": 0.0}}, "part.0.split.at_most"),
        ({**SPLIT, "grid": {"robots": [1, 2]}}, "part.0.split"),
        ({"set": {"reseed": [{"at_s": -1.0, "seed": 1}]}}, "reseed.0.at_s"),
    ],
)
def test_what_is_wrong_is_refused_by_its_key(tmp_path: Path, part: dict[str, Any], key: str | None) -> None:
    with pytest.raises(ConfigError) as refused:
        load_campaign(write(tmp_path, part))
    assert (key or "none.toml") in str(refused.value)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"seeds": 3}, "part.0.seeds: it is 3, allowed: a table of first, count, or a list"),
        ({"seeds": []}, "part.0.seeds: it is [], allowed: at least 1 of them"),
        ({"seeds": [1, "a"]}, "part.0.seeds.1: it is 'a', allowed: a whole number"),
        ({"seeds": {"count": 0}}, "part.0.seeds.count: it is 0, allowed: at least 1"),
        (
            {"sample": {"count": 1, "draw": {"seed": []}}},
            "part.0.sample.draw.seed: it is [], allowed: at least 1 of them",
        ),
        (
            {"sample": {"count": 1, "draw": {"seed": 3}}},
            "part.0.sample.draw.seed: it is 3, allowed: a table of low, high, log, whole, or a list",
        ),
        (
            {"sample": {"count": 1, "draw": {"seed": {"low": 3, "high": 2}}}},
            "part.0.sample.draw.seed.high: it is 2.0, allowed: above low, which is 3",
        ),
    ],
)
def test_what_may_be_a_table_or_a_list_is_refused_once(tmp_path: Path, part: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load_campaign(write(tmp_path, part))
    assert str(refused.value).endswith(said)
    assert "things are wrong" not in str(refused.value)


def test_the_campaign_of_the_manual_is_one(tmp_path: Path) -> None:
    (text, *_) = [block.code for block in blocks(ROOT / "docs" / "campaigns.md") if block.language == "toml"]
    path = tmp_path / "manual.toml"
    path.write_text(text.replace("../surveillance.toml", MISSION))
    read = load_campaign(path)
    assert [sum(1 for _ in read.jobs(part)) for part in read.parts.values()] == [40, 40]


def test_a_file_that_is_no_campaign_is_refused(tmp_path: Path) -> None:
    for text in (
        "part = 3",
        "[[part]]\nname = 'a'",
        "title = 'x'",
        "[[part]",
        "[[part]]\nname='a'\n[[part]]\nname='a'",
    ):
        path = tmp_path / "wrong.toml"
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"wrong\.toml"):
            load_campaign(path)
