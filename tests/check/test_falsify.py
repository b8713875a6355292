"""Bugs that are planted in modules are found, within few trials, and a module that is right is not rejected."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import pytest

from soter.check.bench import TRIED_ROBOTS, ModuleBench, floor_bench, mission_bench
from soter.check.conditions import Certainty, Finding
from soter.check.falsify import Falsified, falsify
from soter.check.mission import MissionReport, check_module
from soter.check.testing import OBLIGATIONS, ModuleSuite
from soter.check.trial import Counterexample, read_counterexample, trace_hash
from soter.config import load_mission
from soter.errors import ConfigError, IllFormedModule
from soter.registry import load_backend
from soter.sdk import RobotSpec
from soter.stack.assembly import assemble
from tests.project.source import ROOT

BUDGET = 20

# What is planted, the obligation that it breaks, and how many trials may be needed to find it.
PLANTED = [
    ("sc_speeds", "P2a", 5),
    ("sc_speeds_rarely", "P2a", 120),
    ("sc_leaves", "P2b", 5),
    ("sc_holds", "P2b", 5),
    ("sc_stops_short", "P2b", 5),
    ("sc_fails_in_a_corner", "P2b", 40),
    ("sc_raises", "P2b", 5),
    ("looks_one_delta", "P3", 60),
    ("never_looks", "P3", 20),
    ("says_nothing_of_fast_robots", "P3", 60),
    ("sc_holds_where_the_mission_begins", "P2b", 1),
]


def bench(name: str, patience_s: float = 15.0) -> ModuleBench:
    return floor_bench(f"tests.check.planted:{name}", patience_s=patience_s)


def verdicts(findings: list[Finding]) -> dict[str, Certainty]:
    return {each.condition: each.verdict for each in findings}


def found(name: str) -> tuple[MissionReport, Falsified]:
    report = check_module(bench(name), BUDGET, 1)
    return report, report.counterexamples["module"][0]


@pytest.mark.parametrize(("name", "condition", "within"), PLANTED)
def test_a_planted_bug_is_found(name: str, condition: str, within: int) -> None:
    subject = bench(name)
    findings, broken = falsify(subject, max(BUDGET, within), 1)
    assert verdicts(findings)[condition] is Certainty.REJECTED
    falsified = next(each for each in broken if each.breach.obligation.value == condition)
    assert falsified.evaluations <= within
    # It is a trace that can be run again: the same breach, bit for bit.
    again = subject.run(falsified.vector)
    assert again.breaches == falsified.trial.breaches
    assert trace_hash(again) == trace_hash(falsified.trial)


@pytest.mark.parametrize(
    ("name", "condition"),
    [("sc_is_slow", "P1a"), ("sc_publishes_elsewhere", "P1b"), ("safer_too_near", "P3")],
)
def test_a_declaration_that_cannot_hold_is_rejected_without_a_trial(name: str, condition: str) -> None:
    with pytest.raises(IllFormedModule) as caught:
        bench(name)
    assert caught.value.condition == condition


@pytest.mark.parametrize("name", ["right", "predicates"])
def test_a_right_module_is_not_rejected(name: str) -> None:
    report = check_module(bench(name), 60, 3)
    assert not report.rejected
    assert report.complete is (name == "right"), "of predicates P3 is its author's word"
    assert verdicts([*report.findings])["P2a"] is verdicts([*report.findings])["P2b"] is Certainty.TESTED
    assert not report.counterexamples


def test_what_the_author_only_claims_is_called_an_assumption() -> None:
    report = check_module(bench("without_a_region"), 20, 1)
    assert verdicts([*report.findings])["P2a"] is Certainty.ASSUMED
    assert verdicts([*report.findings])["P3"] is Certainty.ASSUMED
    assert verdicts([*check_module(bench("predicates"), 20, 1).findings])["P3"] is Certainty.ASSUMED


def test_a_breach_says_where_and_why() -> None:
    assert "into its safe controller" in found("sc_speeds")[1].breach.text
    assert re.search(
        r"while the AC was trusted, with a margin of 0\.0\d\d m a tick before$", found("never_looks")[1].breach.text
    )
    assert "KeyError('no such table')" in found("sc_raises")[1].breach.text
    assert "is not given back" in found("sc_holds")[1].breach.text


def test_the_same_seed_finds_the_same_and_counts_trials() -> None:
    done: list[int] = []
    first, _ = falsify(bench("right"), 30, 5, done.append)
    second, _ = falsify(bench("right"), 30, 5)
    assert first == second
    assert done == list(range(1, 31)), "every trial is counted, and the budget is kept"


def test_a_model_that_does_not_fit_is_named() -> None:
    findings, _ = falsify(bench("lying_model"), 20, 1)
    model = next(each for each in findings if each.condition == "model")
    assert model.verdict is Certainty.REJECTED
    assert "A1: " in model.text, "the number of the assumption"


def test_a_counterexample_survives_its_file(tmp_path: Path) -> None:
    _, falsified = found("sc_leaves")
    example = Counterexample(
        {"target": "t"}, falsified.breach.obligation, falsified.breach.time_s, falsified.breach.text, falsified.vector,
        trace_hash(falsified.trial),
    )  # fmt: skip
    file = tmp_path / "found.json"
    file.write_text(example.as_json(falsified.trial.rows))
    assert read_counterexample(file) == example
    assert json.loads(file.read_text())["trace"], "what happened is in it, for people"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "'other' - at `$.format`"),
        ({"format": ...}, "missing required field `format`"),
        ({"version": ...}, "missing required field `version`"),
        ({"vector": ...}, "missing required field `vector`"),
        ({"version": 2}, "of version 1: Invalid enum value 2 - at `$.version`"),
        ({"vector": [2.0]}, "<= 1.0 - at `$.vector["),
        ({"vector": [0.5, -0.1]}, ">= 0.0 - at `$.vector["),
        ({"vector": []}, "length >= 1 - at `$.vector`"),
        ({"obligation": "P9"}, "'P9' - at `$.obligation`"),
        ({"time_s": None}, "got `null` - at `$.time_s`"),
    ],
)
def test_a_file_that_is_no_counterexample(tmp_path: Path, change: dict[str, object], message: str) -> None:
    good = {
        "format": "soter-counterexample", "version": 1, "subject": {}, "obligation": "P2a", "time_s": 1.0, "text": "",
        "vector": [0.5], "trace_sha256": "",
    }  # fmt: skip
    file = tmp_path / "found.json"
    file.write_text(json.dumps({key: value for key, value in {**good, **change}.items() if value is not ...}))
    with pytest.raises(ConfigError, match="soter check --counterexample") as caught:
        read_counterexample(file)
    assert message in str(caught.value)


def test_what_is_no_json_is_no_counterexample(tmp_path: Path) -> None:
    file = tmp_path / "found.json"
    file.write_text("{")
    with pytest.raises(ConfigError, match="not valid JSON"):
        read_counterexample(file)


# --- the same as a suite -----------------------------------------------------------------------------------


class TestRight(ModuleSuite):
    subject = partial(floor_bench, "tests.check.planted:right")
    budget = 40


class TestPredicates(ModuleSuite):
    subject = partial(floor_bench, "tests.check.planted:predicates")
    budget = 40
    assumed = frozenset({"P3"})


def test_a_suite_fails_where_the_module_does() -> None:
    class Holds(ModuleSuite):
        subject = partial(bench, "sc_holds")
        budget = 10

    suite = Holds()
    with pytest.raises(AssertionError, match="P2b: REJECTED: after 15 s"):
        suite.test_obligation("P2b")
    for obligation in ("P1a", "P1b", "P3"):
        suite.test_obligation(obligation)


def test_a_suite_does_not_pass_what_is_only_assumed() -> None:
    class Assumed(ModuleSuite):
        subject = partial(bench, "predicates")
        budget = 10

    with pytest.raises(AssertionError, match="P3: ASSUMED"):
        Assumed().test_obligation("P3")


def test_a_suite_has_a_test_for_every_obligation() -> None:
    class Metafunc:
        fixturenames = ("obligation",)
        values: tuple[str, ...] = ()

        def parametrize(self, name: str, values: tuple[str, ...]) -> None:
            self.values = values

    metafunc = Metafunc()
    TestRight().pytest_generate_tests(metafunc)
    assert metafunc.values == OBLIGATIONS


# --- found by it, and mended --------------------------------------------------------------------------------


def test_two_robots_that_stand_in_each_others_way_come_apart() -> None:
    """Each chose a refuge beyond the other, ahead of it, and stood there for ever: no leg towards it was certified."""
    mission = load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "kinematic"})
    workspace = mission.read_workspace()
    specs = [RobotSpec(1, 2.79, 2.54, -2.42, 0.72), RobotSpec(2, 2.46, 2.73, 0.19, 0.63)]
    backend = load_backend("kinematic")
    with backend().open(backend.config_model(workspace=workspace), specs) as fleet:
        for robot in fleet.robots:
            robot.init(1.0)
        supervisor = assemble(mission, workspace, fleet.robots, lambda _: None).supervisor
        released: set[int] = set()
        for tick in range(round(40.0 / mission.base_tick_s)):
            supervisor.tick(tick * mission.base_tick_s)
            released |= {robot.robot_id for robot in supervisor.robots.values() if robot.driver is None}
            fleet.clock.sleep_until((tick + 1) * mission.base_tick_s)
        assert fleet.truth is not None
        assert fleet.truth.report().violations == ()
    assert released == {1, 2}


def test_a_rule_about_pairs_is_never_tried_with_one_robot() -> None:
    pairs = partial(floor_bench, "soter.campaign.random.attackers:declare_far", {"far_m": 1.0, "spare_m": 0.6})
    assert pairs().robots == 2
    assert pairs(robots=3).robots == 3
    assert floor_bench("tests.check.planted:of_two").robots == 2
    assert floor_bench("tests.check.planted:right").robots == 1
    with pytest.raises(ConfigError, match=r"robots is 1, but the rule of 'module' is about pairs .* 2 or more"):
        pairs(robots=1)
    warehouse = ROOT / "examples" / "warehouse.toml"
    assert mission_bench(warehouse, "collision").robots == TRIED_ROBOTS
    assert mission_bench(warehouse, "geofence").robots == 1
