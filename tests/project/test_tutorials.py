"""Every tutorial does what it says, from its first line to its last, in one folder and with nothing else.

A block with a `title` is a file that the reader saves. Every command has to exit with 0, or the
last of a block with N where it is marked `exit-N`; `no-run` leaves out what needs a vehicle or many minutes.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tests.project.markdown import blocks, commands_of, exit_code, title_of
from tests.project.source import ROOT
from tests.warm import warm

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
MOST_S = 600.0
"""An hour is promised for the longest of them, for reading and typing too."""


INSTALL = """
import sys, tomllib
from pathlib import Path
install, editable, folder = sys.argv[1:]
assert (install, editable) == ("install", "-e")
project = tomllib.loads(Path(folder, "pyproject.toml").read_text())["project"]
name, points = project["name"], project["entry-points"]
metadata = Path.cwd() / f"{name.replace('-', '_')}-{project['version']}.dist-info"
metadata.mkdir()
(metadata / "METADATA").write_text(f"Metadata-Version: 2.1\\nName: {name}\\nVersion: {project['version']}\\n")
lines = [line for group, each in points.items() for line in (f"[{group}]", *(f"{key} = {each[key]}" for key in each))]
(metadata / "entry_points.txt").write_text("\\n".join(lines))
Path(name.replace("-", "_")).symlink_to(Path(folder, name.replace("-", "_")).resolve())
"""


def ran(line: str, folder: Path, environment: Mapping[str, str], install: Path) -> CompletedProcess[str]:
    """Run a command: SOTER's, Python's and pip's as a reader has them, anything else by bash."""
    program, *arguments = shlex.split(line, comments=True)
    if program == "python":
        program, *arguments = arguments
    elif program == "pip":
        program = str(install)
    elif program != "soter":
        return subprocess.run(["bash", "-c", line], cwd=folder, env=environment, capture_output=True, text=True)
    return warm(program, *arguments, cwd=folder, env=environment)


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_does_what_it_says(page: Path, tmp_path: Path) -> None:
    (folder := tmp_path / "here").mkdir()
    (folder / "examples").symlink_to(ROOT / "examples")
    # What an editable install leaves in an environment: the folder on the path, and the entry points beside it.
    (install := tmp_path / "install.py").write_text(INSTALL)
    found = os.pathsep.join((str(folder), str(ROOT), str(ROOT / "sim")))
    environment = {**os.environ, "PYTHONPATH": found, "PYTHONWARNINGS": "error", "COLUMNS": "100"}
    began_s, count = time.monotonic(), 0
    for block in blocks(page):
        place = f"{page.relative_to(ROOT)}:{block.line}"
        if title := title_of(block):
            assert not (folder / title).exists(), f"{place}: {title} is there already"
            (folder / title).write_text(block.code, encoding="utf-8")
        elif block.language == "sh" and "no-run" not in block.marks:
            *firsts, last = [line for _, line in commands_of(block)]
            for line, expected in (*((each, 0) for each in firsts), (last, exit_code(block))):
                done = ran(line, folder, environment, install)
                assert done.returncode == expected, f"{place}\n{line}\n{done.stdout}{done.stderr}"
            count += 1
        else:
            assert block.language in {"sh", "text"}, f"{place}: a listing that nothing runs"
    assert count
    assert time.monotonic() - began_s < MOST_S


def test_every_file_that_a_tutorial_speaks_of_is_there() -> None:
    made = re.compile(r"^Save this as `([^`]+)`|and this as `([^`]+)`", re.MULTILINE)
    for page in TUTORIALS:
        spoken = {one or other for one, other in made.findall(page.read_text())}
        assert spoken <= {title_of(block) for block in blocks(page)}, page
