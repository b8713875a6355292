"""A safe controller that fails, or that SOTER has to bring home, is never called TESTED."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Final, cast

import pytest

from soter.check import node_failures
from soter.check.bench import ModuleBench, floor_bench
from soter.check.conditions import Certainty, Finding
from soter.check.falsify import falsify
from soter.check.mission import check_mission
from soter.check.trial import Attempt, Vector, Way
from soter.config import load_mission
from soter.errors import IllFormedModule
from soter.rta import Node, Situation
from tests.check import planted
from tests.project.source import ROOT

RIGHT: Final = floor_bench("tests.check.planted:right")


def tried(name: str, budget: int = 16) -> dict[str, Finding]:
    """Return what trials on an open floor find, where robots that stand are driven home within patience."""
    findings, _ = falsify(floor_bench(f"tests.check.planted:{name}"), budget, 1)
    return {each.condition: each for each in findings}


def line_of(text: str) -> int:
    lines = Path(planted.__file__).read_text().splitlines()
    return next(number for number, line in enumerate(lines, start=1) if text in line)


@pytest.mark.parametrize(
    ("name", "failure", "line"),
    [
        ("sc_raises", "KeyError('no such table')", 'raise KeyError("no such table")'),
        ("sc_cannot_choose", "RuntimeError('nowhere to go')", 'raise RuntimeError("nowhere to go")'),
        ("sc_publishes_nonsense", "ValueError('Waypoint.x_m is nan", ""),
        ("sc_passes_the_kit_by", "published on the robot's own topic, not the kit's", ""),
    ],
)
def test_one_that_fails_is_rejected_with_the_line_and_the_number_of_trials(name: str, failure: str, line: str) -> None:
    found = tried(name)
    assert found["P2a"].verdict is Certainty.ASSUMED
    assert "its safe controller failed in " in found["P2a"].text
    told = found["P2b"]
    assert told.verdict is Certainty.REJECTED
    assert failure in told.text
    # What is wrong with what it publishes is found outside its own code: then its `step` is named.
    where = line_of(line) if line else line_of("self.topic.publish(self.motion(situation))") - 1
    assert f"(planted.py, line {where})" in told.text
    counts = re.search(r"it failed in (\d+) of the (\d+) trials in which it drove$", told.text)
    assert counts
    assert counts[1] == counts[2]
    assert told.figures["failed"] == told.figures["driven"] == int(counts[1]) > 1


def test_one_that_seldom_fails_is_rejected_all_the_same() -> None:
    figures = tried("sc_raises_in_a_corner", 40)["P2b"].figures
    failed, driven = figures["failed"], figures["driven"]
    assert isinstance(failed, int)
    assert isinstance(driven, int)
    assert 0 < failed < driven


@pytest.mark.parametrize("name", ["sc_publishes_nothing", "sc_publishes_none", "sc_stays_where_it_is"])
def test_one_that_only_stands_is_rejected_although_the_robot_is_driven_home(name: str) -> None:
    found = tried(name)
    told = found["P2b"]
    assert told.verdict is Certainty.REJECTED
    home = told.figures["driven_home"]
    assert isinstance(home, int)
    assert home > 0
    assert told.text.startswith(f"{home} of {told.figures['returns']} returns to phi_safer")
    assert "stood for lets_go_s = 4 s and SOTER drove it home" in told.text
    assert told.text.endswith("its own controller did not bring it back, and did so in no other trial")


def test_one_that_stands_somewhere_holds_partly() -> None:
    told = tried("sc_stays_in_the_south", 40)["P2b"]
    assert told.verdict is Certainty.PARTLY
    assert told.text.endswith("its own controller did not bring it back")


def test_one_that_comes_back_by_itself_but_takes_long_is_tested_and_its_contract_explained() -> None:
    told = tried("sc_takes_long")["P2b"]
    assert told.verdict is Certainty.TESTED
    assert told.figures["driven_home"] == 0
    assert "; the 4 s of P2c count only while a robot stands, or has to charge" in told.text


@pytest.mark.parametrize(
    ("ways", "verdict"),
    [
        ([{Way.CHARGE}, {Way.ITSELF}], Certainty.TESTED),
        ([{Way.CHARGE}, set()], Certainty.ASSUMED),
        ([{Way.CHARGE}, {Way.HOME}], Certainty.REJECTED),
        ([{Way.ITSELF}, {Way.HOME}], Certainty.PARTLY),
        ([set(), set()], Certainty.TESTED),
    ],
)
def test_a_robot_that_had_to_charge_says_nothing_for_its_controller(ways: list[set[Way]], verdict: Certainty) -> None:
    class Bench:
        module, own_start, dimensions = RIGHT.module, None, 1
        left = itertools.cycle(ways)

        def run(self, vector: Vector) -> Attempt:
            return Attempt(True, 0.1, 40.0, 20.0, driven=True, ways=frozenset(next(self.left)))

    findings, _ = falsify(cast("ModuleBench", Bench()), 4, 1)
    told = next(each for each in findings if each.condition == "P2b")
    assert told.verdict is verdict
    assert ("had to charge" in told.text) is ({Way.CHARGE} in ways and verdict is not Certainty.REJECTED)


def test_an_ac_in_the_place_of_the_safe_controller_is_refused_without_a_trial() -> None:
    with pytest.raises(IllFormedModule, match=r"its safe controller is kit.ac, .* exchanged") as caught:
        floor_bench("tests.check.planted:exchanged")
    assert caught.value.condition == "P2a"


@pytest.mark.parametrize(("name", "fine"), [("right", True), ("sc_raises", False), ("sc_publishes_nothing", False)])
def test_so_it_is_in_a_mission(name: str, fine: bool, tmp_path: Path) -> None:
    examples, space = ROOT / "examples", tmp_path / "east.xml"
    # The rule holds in the east only: robot 1 lives there as well.
    text = (examples / "surveillance.xml").read_text().replace('<start x="1" y="1"', '<start x="4" y="1"')
    space.write_text(text.replace('<low x="0.8"', '<low x="3.8"').replace('<high x="1.2"', '<high x="4.2"'))
    overrides = {
        "backend": "kinematic", "rta.module.own.declare": f"tests.check.planted:{name}", "workspace": str(space)
    }  # fmt: skip
    room = load_mission(examples / "surveillance.toml", overrides)
    found = {each.condition: each for each in check_mission(room, 8, 1).findings if each.module == "own"}
    assert (found["P2b"].verdict is Certainty.TESTED) is fine
    assert (found["P2a"].verdict is Certainty.TESTED) is (name != "sc_raises")
    assert found["P2c"].text.startswith("a robot that has to charge, or stands, is let go within ")


def test_a_failure_without_a_line_of_the_users_is_told_without_one() -> None:
    class Plain(Node):
        name = "plain"

        def step(self, situation: Situation) -> None:
            raise NotImplementedError

    assert "test_broken_controllers.py, line" in node_failures.told(ValueError("no"), Plain())
    Plain.step = len  # type: ignore[assignment, method-assign]
    assert node_failures.told(ValueError("no"), Plain()) == "ValueError('no')"
