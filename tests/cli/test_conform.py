"""`soter conform`: its exit codes, its files, its refusals."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.cli.conform_output import Files, Outcomes, print_summary
from soter.cli.console import make_console
from soter.cli.outputs import Output, StandardOutput
from soter.conformance import CLAUSES, Outcome, Overall, Record, Tier, Verdict, find_harness, judge, select
from soter.conformance.figure import Figure
from soter.conformance.measured import measured_of
from soter.conformance.record import make_record
from tests.project.source import ROOT


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
    assert content["subject"]["robot_class"] == "soter.adapters.pybullet.backend:KinematicRobot"
    assert {each["verdict"] for each in content["clauses"]} == {"PASS", "NOT TESTED"}
    assert len(content["sha256"]) == 64
    suite = ET.parse(junit).getroot()  # noqa: S314 - written above
    skipped = sum(each["verdict"] == "NOT TESTED" for each in content["clauses"])
    counts = (str(len(content["clauses"])), "0", str(skipped))
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == counts
    assert skipped > 0
    assert set(content["host_s"]) == {each["id"] for each in content["clauses"]}


def test_a_name_takes_its_clause_as_the_truth_judges_it_along() -> None:
    assert [each.id for each in select(["deadman.silence"])] == ["deadman.silence", "truth.deadman.silence"]
    assert [each.id for each in select(["truth.deadman.silence"])] == ["truth.deadman.silence"]
    assert {each.tier for each in select(["truth"])} == {Tier.TRUTH}
    assert {each.group.removeprefix("truth.") for each in select(["deadman"])} == {"deadman"}


@pytest.mark.parametrize("tiers", [("core",), ("truth",), ("wire",), ("truth", "wire")])
def test_it_tries_one_tier_or_several(tiers: tuple[str, ...]) -> None:
    done = conform("--list", *(word for tier in tiers for word in ("--tier", tier)))
    assert {line[34:].split()[0] for line in done.output.splitlines()} == set(tiers)
    assert len(done.output.splitlines()) == sum(each.tier.value in tiers for each in CLAUSES.values())


@pytest.mark.parametrize("promise", ["accel_m_s2 = 0.3", "accel_m_s2 = 0.163", "accel_m_s2 = 0.3\nv_max_m_s = 0.05"])
def test_velocities_of_robots_that_are_slow_or_speed_up_slowly_are_believed(promise: str, tmp_path: Path) -> None:
    (tmp_path / "hall.toml").write_text(
        "[fence]\ncircle = { x_m = 0.0, y_m = 0.0, radius_m = 15.0 }\n[[station]]\nx_m = 0.0\ny_m = 0.0\n"
    )
    (tmp_path / "m.toml").write_text(
        f'workspace = "hall.toml"\nbackend = "kinematic"\n[backends.kinematic.promise]\n{promise}\n'
    )
    done = conform(str(tmp_path / "m.toml"), "--room", "20", "--only", "truth.bounds.velocity")
    assert done.exit_code == 0, done.output


def test_it_says_what_was_not_tested_and_which_of_that_may_not_be_left_out() -> None:
    done = conform("kinematic", "--only", "link")
    assert done.exit_code == 0
    without = sum(each.hooks == ("cut",) for each in select(["link"]))
    assert f"\n  not tested: hook not given: cut ({without} clauses)\n" in done.output
    reason = "hook not given: delay"
    outcomes = [Outcome(each, Verdict.NOT_TESTED, reason, (), 0.0) for each in select(["link.delay"])]
    console = make_console(stderr=False)
    with console.capture() as captured:
        print_summary(console, make_record("mine", None, outcomes, complete=True), 0.0)
    assert captured.get().endswith(
        "\n  not tested, and may not be left out: hook not given: delay (1 clause)\nDOES NOT CONFORM\n"
    )


@pytest.mark.parametrize(
    ("name", "seen", "load", "said"),
    [
        ("latency_s", 0.2, 14.0, True),
        ("cut_run_m", 0.2, 14.0, True),
        ("latency_s", 0.2, 1.0, False),
        ("latency_s", 0.1, 14.0, False),
        ("v_max_m_s", 0.2, 14.0, False),
        ("overshoot_m", 0.2, 14.0, False),
    ],
)
def test_it_says_that_the_host_was_busy_as_something_was_late(
    name: str, seen: float, load: float, said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    figure = Figure.of(name, seen, 0.1)
    verdict = Verdict.PASS if figure.kept else Verdict.FAIL
    outcomes = [Outcome(CLAUSES["bounds.latency"], verdict, "", (figure,), 0.0)]
    console = make_console(stderr=False)
    with console.capture() as captured, Outcomes(console, 1) as shown:
        shown.add(outcomes[0])
        print_summary(console, make_record("mine", None, outcomes, complete=True), 0.0, shown.load)
    assert ("the host was busy, with 7.0 programs a core" in captured.get()) is said


def test_a_figure_shows_beside_its_bound() -> None:
    done = conform("kinematic", "--only", "goto.v_max")
    assert "v_max_m_s 0.22 of 0.22\n" in done.output


def test_it_says_what_was_measured_beside_what_was_promised(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    done = conform("kinematic", "--only", "bounds.latency", "--only", "bounds.tube", "--json", str(path))
    rows = {line.split()[0]: line.split()[1:] for line in done.output.splitlines() if "bounds.tube" in line}
    promised, measured, share, clause = rows["tube_m"]
    assert clause == "bounds.tube"
    assert float(share.rstrip("%")) / 100 == pytest.approx(float(measured) / float(promised), abs=0.006)
    written = {each["name"]: each for each in json.loads(path.read_text())["promises"]}
    assert written["tube_m"]["measured"] == pytest.approx(float(measured), rel=0.01)
    assert written["lease_s"] == {"name": "lease_s", "promised": 0.1, "measured": None, "clause": None}
    assert re.search(r"\nlease_s +0\.1 +- +- *\n", done.output), "what was not measured shows"


def test_of_a_promise_that_is_a_least_the_least_counts() -> None:
    record = judge(find_harness("kinematic"), select(["state.start"]))
    assert record.subject is not None
    figures = tuple(Figure("brake_m_s2", value, 1.0) for value in (2.0, 0.8, 1.6))
    outcome = replace(record.outcomes[0], figures=(*figures, Figure("tube_m", 0.01), Figure("tube_m", 0.03)))
    found = {each.name: each for each in measured_of(replace(record, outcomes=(outcome,)))}
    assert (found["brake_m_s2"].measured, found["brake_m_s2"].share) == (0.8, 1.25)
    assert found["tube_m"].measured == 0.03
    assert found["lease_s"].share is None


def test_a_record_is_whole_after_every_clause(tmp_path: Path) -> None:
    path, seen = tmp_path / "record.json", []
    files = Files({"--json": Output(path, "--json"), "--junit": StandardOutput()})

    def look(_: Outcome, record: Record) -> None:
        files.keep_up(record)
        content = json.loads(path.read_text())
        seen.append((len(content["clauses"]), content["verdict"]))

    judge(find_harness("kinematic"), select(["deadman.silence"]), look)
    assert seen == [(1, Overall.UNFINISHED.value), (2, Overall.PARTIAL.value)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_it_stops_the_robot_ends_its_children_and_has_what_there_is(
    tmp_path: Path, number: signal.Signals
) -> None:
    words = ["conform", "tests.conformance.failing:SlowHarness", "--only", "lifecycle.init", "--only", "goal.cancel"]
    kit = subprocess.Popen(
        [sys.executable, "-m", "soter.cli", *words, "--json", "record.json"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim")))},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert kit.stderr is not None
    assert kit.stderr.readline() == "stopping\n"
    kit.send_signal(number)
    out, err = kit.communicate(timeout=60.0)
    assert kit.returncode == 128 + number, err
    assert "NOT JUDGED (ended before all clauses were tried)" in out
    record = json.loads((tmp_path / "record.json").read_text())
    assert [each["verdict"] for each in record["clauses"]] == ["PASS"]
    assert (tmp_path / "closed").exists()
    beside = Path("/proc") / (tmp_path / "pid").read_text() / "stat"
    # It may be left waiting for whoever inherits orphans.
    assert not beside.exists() or beside.read_text().rpartition(")")[2].split()[0] == "Z"


def test_the_same_run_has_the_same_hash() -> None:
    runs = [json.loads(conform("kinematic", "--only", "bounds.latency", "--json", "-").stdout) for _ in range(2)]
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
        (("kinematic", "--tier", "wires"), "did you mean 'wire'?"),
        (("kinematic", "--only", "bounds", "--tier", "wire"), "none of bounds is in tier wire"),
        (("kinematic", "--jobs", "0"), "--jobs"),
        (("tests.conformance.failing:CrashingAtImportHarness",), "ended with signal SIGABRT"),
        (("tests.conformance.failing:MisspeltHarness",), "unexpected keyword argument 'enginne'"),
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
