"""`soter conform`: its exit codes, its files, its refusals."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.cli.conform import _print_verdict
from soter.cli.console import make_console
from soter.conformance import Outcome, Verdict, select
from soter.conformance.record import make_record


def conform(*words: str) -> Result:
    return CliRunner().invoke(app, ["conform", *words])


def test_it_lists_the_clauses() -> None:
    done = conform("--list")
    assert done.exit_code == 0
    assert "goal.superseded" in done.output
    assert "needs cut" in done.output


def test_it_judges_a_selection_and_writes_the_record(tmp_path: Path) -> None:
    record, junit = tmp_path / "record.json", tmp_path / "junit.xml"
    done = conform("kinematic", "--only", "deadman", "--only", "link.age", "--json", str(record), "--junit", str(junit))
    assert done.exit_code == 0, done.output
    assert "NOT JUDGED" in done.output
    content = json.loads(record.read_text())
    assert content["subject"]["capabilities"]["in_process"] is True
    assert content["subject"]["robot_class"] == "soter.adapters.pybullet.robot:KinematicRobot"
    assert {each["verdict"] for each in content["clauses"]} == {"PASS", "NOT TESTED"}
    assert len(content["sha256"]) == 64
    suite = ET.parse(junit).getroot()  # noqa: S314 - written above
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("6", "0", "1")


def test_it_says_what_was_not_tested_and_which_of_that_may_not_be_left_out() -> None:
    done = conform("kinematic", "--only", "link")
    assert done.exit_code == 0
    assert "\n  not tested: hook not given: cut (5 clauses)\n" in done.output
    reason = "hook not given: delay"
    outcomes = [Outcome(each, Verdict.NOT_TESTED, reason, (), 0.0) for each in select(["link.delay"])]
    console = make_console(stderr=False)
    with console.capture() as captured:
        _print_verdict(console, make_record("mine", None, outcomes, complete=True))
    assert captured.get().endswith(
        "\n  not tested, and may not be left out: hook not given: delay (1 clause)\nDOES NOT CONFORM\n"
    )


def test_a_figure_beyond_its_bound_shows_how_exactly_it_was_measured() -> None:
    done = conform("kinematic", "--only", "goal.timeout", "--only", "goto.v_max")
    assert "timeout_s 2.3 of 2.27 (measured to 0.1), " in done.output
    assert "v_max_m_s 0.22 of 0.22\n" in done.output


def test_the_same_run_has_the_same_hash() -> None:
    runs = [json.loads(conform("kinematic", "--only", "bounds", "--json", "-").stdout) for _ in range(2)]
    assert runs[0]["sha256"] == runs[1]["sha256"]


def test_an_adapter_that_fails_is_exit_code_1() -> None:
    done = conform("tests.conformance.failing:FailingHarness", "--only", "goal.cancel")
    assert done.exit_code == 1
    assert "DOES NOT CONFORM" in done.output
    assert "_halt() does nothing" in done.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "say which"),
        (("kinematik",), "did you mean 'kinematic'?"),
        (("kinematic", "--only", "goal.cancle"), "did you mean 'goal.cancel'?"),
        (("no_such_module:Harness",), "there is no module 'no_such_module'"),
        (("soter.conformance:Harnes",), "did you mean 'Harness'?"),
        (("soter.conformance:Harness",), "is not complete: it does not define close, open"),
        (("soter.conformance:Clause",), "is neither a soter.conformance.Harness nor a soter.sdk.Backend"),
        (("tests.conformance.failing:WireBackend",), "names no harness"),
        (("kinematic", "--json", "-", "--junit", "-"), "cannot both go to standard output"),
        (("kinematic", "--json", "/no/such/folder/record.json"), "there is no folder"),
    ],
)
def test_bad_input_is_refused(words: tuple[str, ...], message: str) -> None:
    done = conform(*words)
    assert done.exit_code == 2
    assert message in done.output
