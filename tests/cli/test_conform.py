"""`soter conform`: its exit codes, its files, its refusals."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app


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
