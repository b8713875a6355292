"""A release has one version, wherever it stands."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import pytest

import soter
from tests.project.source import ROOT
from tools.dist import run, tag_problem
from tools.release import PLACES, main, set_version


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in PLACES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def found(tree: Path) -> list[str]:
    return [re.findall(each, (tree / name).read_text(), re.MULTILINE)[0] for name, each in PLACES.items()]


def test_every_place_has_the_version_of_the_package(tree: Path) -> None:
    assert found(tree) == [soter.__version__] * len(PLACES)
    set_version(tree, "7.8.9rc1")
    assert found(tree) == ["7.8.9rc1"] * len(PLACES)


@pytest.mark.parametrize("version", ["", "1.2", "v1.2.3", "1.2.3 ", "1.2.3-beta"])
def test_what_is_no_version_is_refused(tree: Path, version: str) -> None:
    with pytest.raises(ValueError, match=r"VERSION is .*allowed"):
        set_version(tree, version)


def test_nothing_is_written_where_a_place_is_missing(tree: Path) -> None:
    (tree / "CITATION.cff").write_text("title: SOTER\n")
    with pytest.raises(ValueError, match=r"CITATION\.cff has 0 versions"):
        set_version(tree, "7.8.9")
    assert (tree / "soter" / "__init__.py").read_text() == (ROOT / "soter" / "__init__.py").read_text()


def test_it_says_how_it_is_called(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["release.py", "--help"])
    with pytest.raises(SystemExit, match="0"):
        main()
    assert "usage: release.py [-h] version" in capsys.readouterr().out


def test_a_tag_has_to_say_what_is_built() -> None:
    assert tag_problem(["v7.8.9", "nightly"], "7.8.9") is None
    assert tag_problem([], "7.8.9") is None
    assert tag_problem(["nightly"], "7.8.9") is None
    assert "v7.8.8" in str(tag_problem(["v7.8.8"], "7.8.9"))


def test_what_was_built_is_tried_and_not_the_work_tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    assert run(sys.executable, "-c", "import os; print('PYTHONPATH' in os.environ)", cwd=tmp_path) == "False\n"
