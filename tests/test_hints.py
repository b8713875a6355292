"""The command that installs an extra works where SOTER came from: a clone, a wheel, an index."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from soter import hints
from tests.project.source import ROOT


class Installed:
    """A distribution, as far as pip's note of its origin goes."""

    def __init__(self, note: str | None) -> None:
        self._note = note

    def read_text(self, name: str) -> str | None:
        return self._note if name == "direct_url.json" else None


def test_in_a_clone_the_clone_is_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert hints.install_command("zenoh") == f'pip install -e "{ROOT}[zenoh]"'
    monkeypatch.chdir(ROOT)
    assert hints.install_command("zenoh") == 'pip install -e ".[zenoh]"'


def test_elsewhere_what_was_installed_is_or_else_a_clone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wheel = tmp_path / "a wheel.whl"
    wheel.touch()
    gone = json.dumps({"url": "file:///nowhere/soter.whl"})
    monkeypatch.setattr(hints, "_TREE", tmp_path)
    for note, said in (
        (json.dumps({"url": wheel.as_uri()}), f'pip install "{wheel}[sign]"'),
        (gone, 'pip install -e ".[sign]", in a clone of SOTER'),
        ("no json", 'pip install "soter-rta[sign]"'),
        (None, 'pip install "soter-rta[sign]"'),
    ):
        monkeypatch.setattr(hints, "distribution", lambda _, note=note: Installed(note))
        assert hints.install_command("sign") == said
