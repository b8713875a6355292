"""Every benchmark runs, with sizes that measure nothing."""

from __future__ import annotations

import importlib

import pytest

from benchmarks.common import ROOT, in_turns

HELPERS = {"common", "replay", "wall_clock"}
NAMES = sorted({path.stem for path in (ROOT / "benchmarks").glob("*.py")} - HELPERS)
NEEDS = {
    "stack_cost": (pytest.mark.pybullet, pytest.mark.ompl),
    "real_time_factor": (pytest.mark.ompl,),
    "recording": (pytest.mark.pybullet, pytest.mark.ompl),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=NEEDS.get(name, ())) for name in NAMES])
def test_benchmark_prints_a_table(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    importlib.import_module(f"benchmarks.{name}").main(["--quick"])
    assert "ratio" in capsys.readouterr().out


def test_every_benchmark_is_explained_and_run() -> None:
    readme, makefile = (ROOT / "benchmarks" / "README.md").read_text(), (ROOT / "Makefile").read_text()
    for name in NAMES:
        assert f"`{name}.py`" in readme
        assert f" {name}" in makefile


def test_turns_alternate() -> None:
    order: list[str] = []

    def side(name: str) -> float:
        order.append(name)
        return float(len(order))

    times = in_turns({"a": lambda: side("a"), "b": lambda: side("b")}, 2)
    assert order == ["a", "b", "b", "a"]
    assert times == {"a": [1.0, 4.0], "b": [2.0, 3.0]}
