"""Every benchmark runs, with sizes that measure nothing."""

from __future__ import annotations

import importlib
import re
import sys

import pytest

from benchmarks.common import ROOT, in_turns
from tests.report.chromium import NEEDED

HELPERS = {"common", "replay", "switching", "wall_clock"}
OWN_ENVIRONMENT = {"peers"}
"""What it compares with is not installed here."""

NAMES = sorted({path.stem for path in (ROOT / "benchmarks").glob("*.py")} - HELPERS - OWN_ENVIRONMENT)
NEEDS = {
    "stack_cost": (pytest.mark.pybullet, pytest.mark.ompl),
    "real_time_factor": (pytest.mark.ompl,),
    "recording": (pytest.mark.pybullet,),
    "ros2_latency": (pytest.mark.rclpy,),
    "page": tuple(NEEDED),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=NEEDS.get(name, ())) for name in NAMES])
def test_benchmark_prints_a_table(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    importlib.import_module(f"benchmarks.{name}").main(["--quick"])
    assert "ratio" in capsys.readouterr().out


def test_every_benchmark_is_explained_and_run() -> None:
    readme, makefile = (ROOT / "benchmarks" / "README.md").read_text(), (ROOT / "Makefile").read_text()
    for name in (*NAMES, *OWN_ENVIRONMENT):
        assert f"`{name}.py`" in readme
        assert re.search(rf"[ /]{name}\b", makefile)


def test_a_benchmark_that_needs_other_libraries_says_how_to_run_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rtamt", None)
    monkeypatch.setitem(sys.modules, "run_time_assurance.rta", None)
    with pytest.raises(SystemExit, match="make bench-peers"):
        importlib.import_module("benchmarks.peers").main(["--quick"])


def test_what_other_libraries_are_compared_with_is_locked_without_an_index() -> None:
    lines = (ROOT / "benchmarks" / "peers-requirements.txt").read_text().splitlines()
    pinned = [line for line in lines if not line.startswith("#")]
    assert {"rtamt==0.4.10", "run-time-assurance==1.18.6"} <= set(pinned)
    assert [line for line in pinned if not re.fullmatch(r"[a-z0-9._-]+==[a-z0-9.+]+", line)] == []


def test_turns_alternate() -> None:
    order: list[str] = []

    def side(name: str) -> float:
        order.append(name)
        return float(len(order))

    times = in_turns({"a": lambda: side("a"), "b": lambda: side("b")}, 2)
    assert order == ["a", "b", "b", "a"]
    assert times == {"a": [1.0, 4.0], "b": [2.0, 3.0]}
