"""The evaluation resumes, judges by its bounds, and writes only between its markers."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from soter.config import load_mission
from soter.runner import RunResult, run_mission
from soter.sdk import RULES
from tools import accept
from tools.acceptance import page, running
from tools.acceptance.cases import Case, all_cases
from tools.acceptance.judge import Criterion, Outcome, Verdict, criteria, upper_rate
from tools.acceptance.store import ROOT, Store, source_hash

QUICK = ["--scale", "0.001", "--only", "protected-uniform-kinematic-[12]"]


@cache
def some_result() -> RunResult:
    """The result of a real run."""
    options = {"backend": "kinematic", "planner": "straight-line", "duration_s": 1.0}
    return run_mission(load_mission(ROOT / "examples" / "surveillance.toml", options)).result


def result_of(case: Case, **changes: Any) -> RunResult:
    """The result of a run in which all went as it should."""
    broken: Mapping[str, set[str]] = {"unprotected": set(RULES), "without": {case.subject}}
    good: dict[str, Any] = {
        "seed": case.seed,
        "violations": {rule: int(rule in broken.get(case.group, ())) for rule in RULES},
        "ac_share": 0.81,
        "targets_reached": 3,
        "longest_stall_s": 59.0,
        "no_progress_s": 179.0,
        "deterministic": True,
        "trace_sha256": f"{case.engine}/{case.subject}/{case.seed}",
    }
    return some_result().model_copy(update={**good, **changes})


def judged(name: str = "", **changes: Any) -> list[Criterion]:
    """The criteria after a run by that name went otherwise."""
    outcomes = [Outcome(case, result_of(case, **(changes if case.name == name else {}))) for case in all_cases()]
    return criteria(outcomes)


def not_reached(found: list[Criterion]) -> list[str]:
    return [each.text for each in found if each.verdict is not Verdict.REACHED]


def test_names_and_commands_are_unique() -> None:
    cases = all_cases()
    assert len({case.name for case in cases}) == len(cases)
    assert {case.repeats for case in cases} - {""} < {case.name for case in cases}
    assert len({case.command() for case in cases if not case.loaded}) == len([c for c in cases if not c.loaded])


def test_all_is_reached_when_all_goes_well() -> None:
    assert not_reached(judged()) == []


@pytest.mark.parametrize(
    ("name", "changes", "part"),
    [
        ("protected-hostile-kinematic-3", {"violations": {**dict.fromkeys(RULES, 0), "obstacle": 1}}, "no violation"),
        ("protected-grid-pybullet-1", {"violations": None}, "no violation"),
        ("protected-warehouse-kinematic-4", {"longest_stall_s": 60.1}, "stall"),
        ("protected-warehouse-pybullet-1", {"no_progress_s": 180.1}, "progress"),
        ("protected-grid-kinematic-1", {"ac_share": 0.77}, "AC in control"),
        ("unprotected-hostile-kinematic-2", {"violations": {**dict.fromkeys(RULES, 1), "battery": 0}}, "four kinds"),
        ("without-geofence-kinematic-1", {"violations": dict.fromkeys(RULES, 0)}, "geofence"),
        ("repeated-grid-pybullet-1", {"trace_sha256": "another"}, "loaded machine (pybullet)"),
        ("repeated-grid-kinematic-1", {"deterministic": False}, "loaded machine (kinematic)"),
        ("planner-slow-kinematic-1", {"targets_reached": 0}, "ten seconds"),
    ],
)
def test_each_bound_is_judged(name: str, changes: dict[str, Any], part: str) -> None:
    (text,) = not_reached(judged(name, **changes))
    assert part in text


def test_shares_are_judged_by_their_mean() -> None:
    assert not_reached(judged("protected-grid-kinematic-1", ac_share=0.79)) == []


def test_missing_runs_are_neither_passed_nor_failed() -> None:
    outcomes = [Outcome(case, None) for case in all_cases()]
    assert {each.verdict for each in criteria(outcomes)} == {Verdict.INCOMPLETE}


def test_a_failure_counts_while_runs_are_missing() -> None:
    outcomes = [Outcome(case, None) for case in all_cases()]
    outcomes[0] = Outcome(outcomes[0].case, result_of(outcomes[0].case, longest_stall_s=61.0))
    assert Verdict.NOT_REACHED in {each.verdict for each in criteria(outcomes)}


def test_upper_bound_is_three_over_t_without_violations() -> None:
    assert upper_rate(0, 10.0) == pytest.approx(0.2996, abs=1e-4)
    assert upper_rate(1, 10.0) == pytest.approx(0.4744, abs=1e-4)


def test_finished_runs_are_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[str] = []

    def run_case(case: Case, scale: float, stop: Event) -> RunResult:
        started.append(case.name)
        if case.name.endswith("2") and len(started) < 3:
            raise running.CaseFailed("out of luck")
        return result_of(case)

    monkeypatch.setattr(running, "run_case", run_case)
    command = [*QUICK, "--folder", str(tmp_path), "--jobs", "1"]
    assert accept.main(command) == 1, "one of two runs failed"
    assert accept.main(command) == 0
    assert accept.main(command) == 0
    assert started == [f"protected-uniform-kinematic-{seed}" for seed in (1, 2, 2)]


def test_other_sources_scales_and_damage_make_a_run_missing(tmp_path: Path) -> None:
    case = all_cases()[0]
    store = Store("source", 0.5, tmp_path)
    store.save(case, result_of(case))
    assert store.load(case) == result_of(case)
    assert Store("another", 0.5, tmp_path).load(case) is None
    assert Store("source", 1.0, tmp_path).load(case) is None
    store.path(case).write_text("{")
    assert store.load(case) is None


def test_results_of_changed_sources_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "run_case", lambda case, scale, stop: result_of(case))
    monkeypatch.setattr(running, "source_hash", lambda: "changed meanwhile")
    assert accept.main([*QUICK, "--folder", str(tmp_path)]) == 1
    assert list(tmp_path.glob("*.json")) == []


def test_source_hash_sees_changes(tmp_path: Path) -> None:
    (tmp_path / "soter").mkdir()
    file = tmp_path / "soter" / "a.py"
    file.write_text("a = 1\n")
    before = source_hash(tmp_path)
    file.write_text("a = 2\n")
    assert source_hash(tmp_path) != before


def test_a_scaled_evaluation_runs_and_stays_out_of_the_documentation(tmp_path: Path) -> None:
    shown = accept.PAGE.read_text() if accept.PAGE.exists() else None
    command = [sys.executable, "tools/accept.py", "--scale", "0.0005", "--folder", str(tmp_path), "--only"]
    done = subprocess.run(
        [*command, "unprotected-hostile-kinematic-1"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert "NOT REACHED" in done.stdout
    assert "This is no evaluation" in (tmp_path / "evaluation.md").read_text()
    assert (accept.PAGE.read_text() if accept.PAGE.exists() else None) == shown


def test_page_keeps_what_is_outside_its_markers(tmp_path: Path) -> None:
    path = tmp_path / "evaluation.md"
    page.write(path, "one")
    path.write_text(path.read_text() + "\nWhat drives the numbers.\n")
    page.write(path, "two")
    text = path.read_text()
    assert "two" in text
    assert "one\n" not in text
    assert text.endswith("What drives the numbers.\n")
    path.write_text("no markers")
    with pytest.raises(ValueError, match="lost the lines"):
        page.write(path, "three")


def test_page_has_every_run(tmp_path: Path) -> None:
    outcomes = [Outcome(case, result_of(case)) for case in all_cases()]
    text = page.section(outcomes, criteria(outcomes), "source", 1.0)
    assert "This is no evaluation" not in text
    for outcome in outcomes:
        assert f"`{outcome.case.command()}`" in text
