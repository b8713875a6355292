"""`soter check`: its exit codes, its files, its refusals, and the finding about the thesis's own numbers."""

from __future__ import annotations

import io
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from soter.adapters.pybullet.backend import KinematicBackend
from soter.check import admission
from soter.check.bench import ModuleBench
from soter.check.conditions import Certainty, Finding
from soter.check.falsify import Falsified
from soter.check.mission import check_mission
from soter.cli import app
from soter.cli.check import _print
from soter.cli.console import HumanConsole
from soter.config import load_mission
from tests.project.source import ROOT

EXAMPLES = ROOT / "examples"
TOO_LATE = "module:examples.modules.too_late:declare"
# One robot is enough where several would only be tried.
QUICK = ("--backend", "kinematic", "--set", "robots=1", "--budget", "10")


def check(*words: str) -> Result:
    return CliRunner().invoke(app, ["check", *words])


def lines(done: Result) -> dict[tuple[str, str], str]:
    """The verdict of every module and condition, as they are printed."""
    found = re.findall(r"^(\S+) +(P\S+) +([A-Z]+) ", done.output, re.MULTILINE)
    return {(module, condition): verdict for module, condition, verdict in found}


def test_the_thesiss_numbers_are_rejected_with_a_value_that_would_do(tmp_path: Path) -> None:
    record = tmp_path / "thesis.json"
    done = check(str(EXAMPLES / "thesis.toml"), "--json", str(record))
    assert done.exit_code == 1, done.output
    assert lines(done)["collision", "P3"] == "REJECTED"
    assert lines(done)["geofence", "P3"] == lines(done)["battery", "P3"] == "PROVED"
    assert "fall by 0.510 m" in done.output
    assert "only 0.200 m" in done.output
    assert "Delta = 0.1 s, would do" in done.output
    content = json.loads(record.read_text())
    assert content["rejected"] is True
    assert {each["verdict"] for each in content["findings"]} == {"PROVED", "ASSUMED", "REJECTED"}


def test_the_value_that_would_do_does() -> None:
    done = check(str(EXAMPLES / "thesis.toml"), "--set", "rta.collision.delta_s=0.1", "--allow-gaps", *QUICK[2:])
    assert done.exit_code == 0, done.output
    assert lines(done)["collision", "P3"] == "PROVED"


def test_what_would_do_is_said_by_key_all_at_once_and_does() -> None:
    mission = str(EXAMPLES / "ardurover" / "mission.toml")
    promise = {"v_max_m_s": 1.6, "brake_m_s2": 1.0, "lease_s": 0.3}
    fast = [word for key, value in promise.items() for word in ("--set", f"backends.mavlink.promise.{key}={value}")]
    fast += ["--budget", "2"]
    done = check(mission, *fast)
    assert done.exit_code == 1, done.output
    tables = tomllib.loads(done.output.partition("together would do:")[2])["rta"]
    # Legs grow with the square of the speed, and the separation with them; Delta has to leave time to brake.
    assert tables["collision"]["phi_safe_m"] == pytest.approx(8.0)
    assert tables["collision"]["delta_s"] >= 0.253
    settings = (f"rta.{name}.{key}={value}" for name, table in tables.items() for key, value in table.items())
    again = check(mission, *fast, *(word for each in settings for word in ("--set", each)))
    assert again.exit_code == 0, again.output


def test_a_mission_is_proved_where_it_can_be(tmp_path: Path) -> None:
    record, drawn = tmp_path / "record.json", tmp_path / "room.png"
    done = check(str(EXAMPLES / "surveillance.toml"), *QUICK, "--json", str(record), "--picture", str(drawn))
    assert done.exit_code == 0, done.output
    verdicts = lines(done)
    assert len(verdicts) == 23
    assert set(verdicts.values()) == {"PROVED"}
    assert verdicts["obstacle", "P2c"] == "PROVED"
    assert "always has a return path that is paid for" in done.output
    findings = json.loads(record.read_text())["findings"]
    figures = next(each["figures"] for each in findings if (each["module"], each["condition"]) == ("battery", "P2a"))
    assert figures["extra"] < figures["reserve"]
    assert drawn.read_bytes().startswith(b"\x89PNG")


def test_a_gap_is_exit_code_1_unless_it_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    gap = Finding("obstacle", "P2a", Certainty.PARTLY, "a part of the room is not")
    monkeypatch.setattr(admission, "prove", lambda *_: [gap, replace(gap, condition="P2b")])
    only = ("--set", "rta.modules=['obstacle']", *QUICK)
    assert check(str(EXAMPLES / "surveillance.toml"), *only).exit_code == 1
    assert check(str(EXAMPLES / "surveillance.toml"), "--allow-gaps", *only).exit_code == 0


def test_several_robots_are_said_to_be_tested_only() -> None:
    only = ("--set", "rta.modules=['collision', 'obstacle']", "--backend", "kinematic", "--budget", "10")
    done = check(str(EXAMPLES / "surveillance.toml"), *only)
    assert done.exit_code == 0, done.output
    assert lines(done)["collision", "P2a"] == "TESTED"
    assert "2 robots jointly, not proved" in done.output


def test_a_wrong_module_is_found_and_its_counterexample_breaks_again(tmp_path: Path) -> None:
    found, drawn = tmp_path / "found.json", tmp_path / "found.png"
    words = (TOO_LATE, "--budget", "40", "--patience", "15", "--counterexample", str(found), "--picture", str(drawn))
    done = check(*words)
    assert done.exit_code == 1, done.output
    assert lines(done)["module", "P3"] == "REJECTED"
    assert drawn.read_bytes().startswith(b"\x89PNG")
    again = check("--replay", str(found))
    assert again.exit_code == 1, again.output
    assert "P3 is broken again" in again.output
    assert "too late to stop" in again.output
    assert "the same, bit for bit" in again.output
    replayed = tmp_path / "replayed.json"
    assert check("--replay", str(found), "--json", str(replayed), "--picture", str(drawn), "--force").exit_code == 1
    assert json.loads(replayed.read_text()) == {
        "broken": True, "same_trace": True, "text": json.loads(found.read_text())["text"],
    }  # fmt: skip


def test_a_counterexample_that_breaks_nothing_any_more_is_exit_code_0(tmp_path: Path) -> None:
    found = tmp_path / "found.json"
    assert check("module:tests.check.planted:never_looks", "--budget", "10", "--counterexample", str(found)).exit_code
    content = json.loads(found.read_text())
    content["subject"]["target"] = "module:tests.check.planted:right"
    found.write_text(json.dumps(content))
    done = check("--replay", str(found))
    assert done.exit_code == 0, done.output
    assert "not broken any more" in done.output


def test_a_right_module_is_exit_code_0(tmp_path: Path) -> None:
    found = tmp_path / "found.json"
    done = check("module:tests.check.planted:right", "--budget", "10", "--counterexample", str(found))
    assert done.exit_code == 0, done.output
    assert set(lines(done).values()) == {"PROVED", "TESTED"}
    assert not found.exists()
    assert "no counterexample was found" in done.output


def test_options_and_declarations_that_were_made_beforehand() -> None:
    done = check("module:tests.check.planted:with_options", "--set", "options.least_m=2.0", "--budget", "6")
    assert done.exit_code == 0, done.output
    assert check("module:tests.check.planted:DECLARED", "--budget", "6").exit_code == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "say what to check"),
        (("a.toml", "--replay", "b.json"), "one of them"),
        (("no-such.toml",), "does not exist"),
        (("module:nowhere:x",), "there is no module 'nowhere'"),
        (("module:tests.check.planted:rihgt",), "did you mean 'right'?"),
        (("module:tests.check.planted",), "allowed: a function as 'package.module:function'"),
        (("module:tests.check.planted:NOT_A_MODULE",), "a function that takes a ModuleKit"),
        (("module:tests.check.planted:wrong_type",), "returned a int, allowed: a soter.rta.RTAModule"),
        (("module:tests.check.planted:broken",), "RuntimeError('I am broken')"),
        (("module:tests.check.planted:too_many",), "has to be declare(kit) or declare(kit, options"),
        (("module:tests.check.planted:with_options",), "least_m: it is missing"),
        (("module:tests.check.planted:with_options", "--set", "options.leest_m=2"), "did you mean 'least_m'?"),
        (("module:tests.check.planted:right", "--set", "options.x=1"), "takes no options"),
        (("module:tests.check.planted:right", "--set", "seed=1"), "written as options.KEY=VALUE"),
        (("module:tests.check.planted:right", "--backend", "kinematic"), "simulated robots"),
        (("module:tests.check.planted:sc_is_slow",), "ill-formed (P1a)"),
        (("module:tests.check.planted:sc_publishes_elsewhere",), "ill-formed (P1b)"),
        (("module:tests.check.planted:safer_too_near",), "ill-formed (P3)"),
        (("--replay", "pyproject.toml"), "not valid JSON"),
        ((TOO_LATE, "--picture", "x.jpg"), "does not end in .png"),
    ],
)
def test_what_is_wrong_is_named_and_exit_code_2(words: tuple[str, ...], message: str) -> None:
    done = check(*words)
    assert done.exit_code == 2, done.output
    assert message in done.output


@pytest.mark.parametrize(
    "setting",
    [
        "ac=adversary:chaise",
        "ac=nowhere.py:Greedy",
        "planner=straight_line",
        "planner=nowhere:Planner",
        "planners.straight-line.nowhere=1",
        "mission=nowhere.py",
        "mission.nowhere=1",
    ],
)
def test_what_a_run_refuses_of_what_a_mission_names_is_refused_in_the_same_words(setting: str) -> None:
    words = [str(EXAMPLES / "surveillance.toml"), "--backend", "kinematic"]
    if not setting.startswith("planner="):
        words += ["--set", "planner=straight-line"]
    said = []
    for command, more in (("run", ("--no-record", "--duration", "1")), ("check", ("--budget", "2"))):
        done = CliRunner().invoke(app, [command, *words, "--set", setting, *more])
        assert done.exit_code == 2, (command, done.output)
        said.append(done.output.splitlines()[-1])
    assert len({*said}) == 1, said
    assert "command line: " in said[0]


def test_a_mission_that_cannot_be_done_in_its_workspace_is_refused_before_a_robot_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    corridor = "polygon = [[0.1, 0.1], [2.9, 0.1], [2.9, 0.9], [0.1, 0.9]]"
    (tmp_path / "corridor.toml").write_text(f"[fence]\n{corridor}\n[[station]]\nx_m = 0.6\ny_m = 0.5\n")
    mission = tmp_path / "mission.toml"
    mission.write_text('workspace = "corridor.toml"\nbackend = "kinematic"\ntargets = "grid"\nrobots = 1\n')
    monkeypatch.setattr(KinematicBackend, "open", lambda *_: pytest.fail("robots were opened"))
    for command, more in (("run", ("--no-record", "--duration", "1")), ("check", ("--budget", "2"))):
        done = CliRunner().invoke(app, [command, str(mission), "--set", "planner=straight-line", *more])
        assert done.exit_code == 2, (command, done.output)
        assert f"{mission.name}:3: targets: it is 'grid', and no integer point" in done.output


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vector": [0.5]}, "its point has 1 numbers, and 11 are needed"),
        ({"subject": {}}, "what was tried cannot be read"),
    ],
)
def test_a_counterexample_of_another_version(tmp_path: Path, change: dict[str, object], message: str) -> None:
    subject: dict[str, object] = {"target": "module:tests.check.planted:right", "backend": None, "settings": [],
               "module": "module", "robots": 1, "patience_s": 5.0}  # fmt: skip
    good = {"format": "soter-counterexample", "version": 1, "subject": subject, "obligation": "P2a", "time_s": 1.0,
            "text": "", "vector": [0.5] * 11, "trace_sha256": ""}  # fmt: skip
    file = tmp_path / "found.json"
    file.write_text(json.dumps({**good, **change}))
    done = check("--replay", str(file))
    assert done.exit_code == 2, done.output
    assert message in done.output


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_findings_are_broken_below_themselves_and_in_a_pipe_not_at_all() -> None:
    report: Any = SimpleNamespace(
        findings=[Finding("fence", "P2a", Certainty.PROVED, "one two three four " * 5)], rejected=False
    )
    for file in (Terminal(), io.StringIO()):
        _print(HumanConsole(file=file, width=60, color_system=None), report)
        found = file.getvalue().partition("\n\n")[0].splitlines()
        assert found[0].startswith("fence  P2a  PROVED    one two")
        assert max(map(len, found)) <= 60 or not file.isatty()
        assert len(found) == (3 if file.isatty() else 1)
        assert all(line.startswith(" " * 22 + word) for line, word in zip(found[1:], ("one", "one"), strict=False)), (
            found
        )


MISSIONS = [
    each
    for each in sorted((ROOT / "examples").rglob("*.toml"))
    if "workspace" in tomllib.loads(each.read_text())
    and each.stem != "thesis"
    and each.parent.name not in ("campaigns", "faults")
]


@pytest.mark.parametrize("example", MISSIONS, ids=lambda each: str(each.relative_to(ROOT / "examples")))
def test_every_shipped_mission_but_the_thesiss_is_accepted(example: Path) -> None:
    result = check(str(example), "--budget", "4", "--allow-gaps")
    assert result.exit_code == 0, result.output
    assert "PARTLY" not in result.output, "what gaps there are, are of trials too few"


def test_trials_wait_as_long_as_the_ways_home_and_users_controllers_may_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that had to wait for others in a large hall, or for a user's controller, counted as not given back."""
    patience_s = {}

    def falsify(bench: ModuleBench, *_: object) -> tuple[list[Finding], list[Falsified]]:
        patience_s[bench.name] = bench.patience_s
        return [], []

    monkeypatch.setattr("soter.check.mission.falsify", falsify)
    check_mission(load_mission(ROOT / "examples" / "unlike-fleet.toml"))
    assert patience_s["collision"] > 60.0 + 20.0 / 0.22, "the hall is 20 m long, and the slowest robot makes 0.22 m/s"
    check_mission(load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "kinematic"}))
    alone_s = patience_s["collision"]
    check_mission(load_mission(ROOT / "examples" / "modules" / "zone.toml"))
    assert patience_s["zone-speed"] == patience_s["collision"] >= alone_s + 2 * 30.0, "30 s for each robot, by A16"
