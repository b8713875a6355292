"""The documentation's code runs, its commands exist and its links lead somewhere.

A block marked ```python runs in a process of its own, in an empty folder with the examples beside it. Words
behind the language change that: `continued` puts the earlier blocks of the page in front of it, `no-run` only
compiles it, for code that needs a robot.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

import soter
import soter.machine
import soter.sdk
from soter.cli import app
from soter.config import parse_mission
from soter.errors import ConfigError
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.registry import backend_names, load_backend
from soter.specs import read_options
from tests.project.markdown import Block, blocks, commands_of, links, prose, title_of
from tests.project.source import ROOT

PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
SHELLS = {"sh", "bash", "shell", "console"}


def programs() -> list[object]:
    """Every Python block of every page, whole: as it has to run."""
    found: list[object] = []
    for page in PAGES:
        code = ""
        for block in blocks(page):
            if block.language == "python":
                code = code + "\n" + block.code if "continued" in block.marks else block.code
                if title_of(block) and page.parent.name == "tutorials":
                    continue  # test_tutorials.py runs them
                name = f"{page.relative_to(ROOT)}:{block.line}"
                found.append(pytest.param(name, code, "no-run" in block.marks, id=name))
    return found


def commands() -> list[tuple[str, list[str]]]:
    """Every `soter …` and `make …` line of every shell block, with its place."""
    found = []
    for page in PAGES:
        for block in blocks(page):
            if block.language in SHELLS:
                found += [(f"{page.relative_to(ROOT)}:{block.line}", words) for words in words_of(block)]
    return found


def words_of(block: Block) -> list[list[str]]:
    """The commands of a shell block that are this project's, split into words."""
    split = [shlex.split(line, comments=True) for _, line in commands_of(block)]
    return [words for words in split if words[0] in {"soter", "make"}]


@cache
def help_text(*subcommand: str) -> str:
    """What `soter SUBCOMMAND --help` prints."""
    # Wide enough that no option's name is cut or wrapped.
    environment = {"COLUMNS": "400", "TERM": "dumb", "NO_COLOR": "1"}
    done = CliRunner().invoke(app, [*subcommand, "--help"], env=environment)
    assert done.exit_code == 0, f"soter {' '.join(subcommand)} --help: {done.output}"
    return done.stdout


@pytest.mark.parametrize(("name", "code", "only_compiles"), programs())
def test_python_blocks_run(name: str, code: str, only_compiles: bool, tmp_path: Path) -> None:
    compile(code, name, "exec")
    if only_compiles:
        return
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    program = tmp_path / "block.py"
    program.write_text(code, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim")))}
    done = subprocess.run(
        [sys.executable, "-W", "error", program],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{name}\n{done.stdout}{done.stderr}"


def test_commands_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for place, (program, *words) in commands():
        if program == "make":
            assert words, f"{place}: make without a target"
            assert {word for word in words if "=" not in word} <= targets, f"{place}: make {words}"
            continue
        if words[:1] == ["campaign"] and words[1].endswith(".toml"):
            words = ["campaign", "run", *words[1:]]
        groups = (["sim"], ["campaign"])
        subcommand = [word for word in words[: 2 if words[:1] in groups else 1] if not word.startswith("-")]
        options = {word.partition("=")[0] for word in words if word.startswith("--")}
        known = set(re.findall(r"--[a-z][a-z0-9-]*", help_text(*subcommand)))
        assert options <= known, f"{place}: soter {' '.join(subcommand)} knows no {sorted(options - known)}"


def test_tables_of_mission_files_are_accepted() -> None:
    """The pages' TOML, but for campaigns, workspaces and packages, which have other keys."""
    room = Workspace(5.0, 5.0, (), (RobotPlace(1, 1.0, 1.0, Box(0.8, 0.8, 1.2, 1.2)),))
    count = 0
    for page in PAGES:
        for block in blocks(page):
            if block.language != "toml" or page.name == "campaigns.md" or re.match(r"\[(fence|project)", block.code):
                continue
            place = f"{page.relative_to(ROOT)}:{block.line}"
            text = block.code if "workspace =" in block.code else f'workspace = "room.xml"\n{block.code}'
            tables = parse_mission(text.encode(), place).backends
            for name in {*tables} & {*backend_names()}:
                mission = parse_mission(f'backend = "{name}"\n{text}'.encode(), place)
                try:
                    read_options(load_backend(name, to_open=False), mission, room)
                except ConfigError as refused:
                    # Keys and certificates are the reader's.
                    if not all("No such file" in line for line in str(refused).splitlines() if "allowed:" in line):
                        raise
            count += 1
    assert count > 15


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    assert [target for target in links(page) if not (page.parent / target).exists()] == []


def test_every_public_name_is_on_the_page_of_the_api() -> None:
    shown = re.findall(r"^::: ([\w.]+)$", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    assert len(shown) == len(set(shown))
    packages = (soter, soter.machine, soter.sdk)
    # A name that two packages share may mean two things: both are shown.
    there = [getattr(import_module(place), name) for place, _, name in (each.rpartition(".") for each in shown)]
    public = {f"{each.__name__}.{name}": getattr(each, name) for each in packages for name in each.__all__}
    assert [name for name, meant in public.items() if not any(meant is each for each in there)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_short_forms_are_spelled_out_where_they_first_appear(page: Path) -> None:
    if page in {ROOT / "CHANGELOG.md", ROOT / "docs" / "ablation.md"}:
        return  # no page to begin with; written by `soter ablate`
    text = prose(page)
    for short, words in (("AC", r"advanced\scontroller"), ("SC", r"safe\scontroller"), ("DM", r"decision\smodule")):
        first = re.search(rf"(?<![\w`-]){short}s?\b(?![`(])", text)
        said = rf"{words}s?[*_]*\s\({short}s?\)|^{short}, {words}$"
        spelled = re.search(said, text, re.MULTILINE | re.IGNORECASE)
        assert first is None or (spelled and spelled.start() <= first.start()), f"{short} of {page.name} is not said"


def test_every_page_says_what_it_is_for_before_its_first_part() -> None:
    for page in PAGES:
        title, _, rest = page.read_text(encoding="utf-8").partition("\n")
        assert title.startswith("# "), page
        assert re.match(r"\n(?!```|[#|!<-])\S", rest), f"{page}: no sentence under the title"


def test_hello_world_fits_on_the_first_screen() -> None:
    first = next(block for block in blocks(ROOT / "README.md") if block.language == "python")
    assert first.code.count("\n") <= 20
    assert first.line <= 20
