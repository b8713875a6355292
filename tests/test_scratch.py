"""Folders of runs that were killed are taken away, and none that is in use."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from soter.scratch import Scratch, sweep
from tests.project.source import ROOT

KILLED = """
import os
from soter.scratch import Scratch
(Scratch("test").path / "file").touch()
os.kill(os.getpid(), 9)
"""


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files of this test's own."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_what_a_killed_run_leaves_behind_is_gone_with_the_next_one(temporary: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED], cwd=ROOT, env={**os.environ, "TMPDIR": str(temporary)}, check=False)
    (left,) = temporary.iterdir()
    used = Scratch("test")
    assert not left.exists()
    sweep()
    assert [*temporary.iterdir()] == [used.path]
    assert used.path.stat().st_mode & 0o077 == 0
    used.close()
    used.close()
    assert not [*temporary.iterdir()]


def test_what_is_not_ours_is_left_alone(temporary: Path) -> None:
    others = temporary / "soter-notes"
    others.mkdir()
    (others / "file").touch()
    (temporary / "soter-link").symlink_to(others)
    (temporary / "soter-file").touch()
    sweep()
    assert (others / "file").exists()
    assert len([*temporary.iterdir()]) == 3


def test_nothing_else_makes_temporary_folders() -> None:
    """One that is not held is never removed, should its process be killed."""
    sources = [path for part in ("soter", "sim") for path in (ROOT / part).rglob("*.py") if path.name != "scratch.py"]
    assert len(sources) > 100
    assert not [path for path in sources if re.search("mkdtemp|TemporaryDirectory", path.read_text())]
