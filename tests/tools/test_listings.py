"""`tools/listings.py`: the commands of a page run as printed, and what is said of each."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.project.markdown import blocks
from tests.waiting import wait_until
from tools import listings


@pytest.fixture
def environment(tmp_path: Path) -> Mapping[str, str]:
    """What commands are started with."""
    (tmp_path / "said").mkdir()
    return {**os.environ, "SAID": str(tmp_path / "said")}


def verdicts(text: str, tmp_path: Path, environment: Mapping[str, str], limit_s: float = 5.0) -> list[tuple[int, str]]:
    """Line and verdict of each command of a page."""
    page = tmp_path / "page.md"
    page.write_text(text)
    found = [each for block in blocks(page) for each in listings.run_block(block, tmp_path, environment, limit_s, 0.05)]
    return [(line, says.splitlines()[0]) for line, _, _, says in found]


def test_a_command_ends_as_the_page_says(tmp_path: Path, environment: Mapping[str, str]) -> None:
    text = "# A page\n\n```sh exit-2\ntrue\n(exit 1)   # exits with 1\n\nfalse\n(exit \\\n  2)\n```\n"
    assert verdicts(text, tmp_path, environment) == [
        (4, "right"), (5, "right"), (7, "FAILED: 0 was expected"), (8, "right"),
    ]  # fmt: skip


def test_what_a_console_has_printed_is_no_command(tmp_path: Path, environment: Mapping[str, str]) -> None:
    assert verdicts("```console\n$ true\nfalse it's\n```\n", tmp_path, environment) == [(2, "right")]


def test_a_traceback_is_wrong_whatever_the_code(tmp_path: Path, environment: Mapping[str, str]) -> None:
    text = "```sh\necho 'Traceback (most recent call last):'\n```\n"
    assert verdicts(text, tmp_path, environment) == [(2, "FAILED: a traceback")]


def test_what_is_not_over_or_not_there_is_never_right(tmp_path: Path, environment: Mapping[str, str]) -> None:
    (_, late), (_, absent) = verdicts("```sh\nsleep 9\ncolcon build\n```\n", tmp_path, environment, 0.05)
    assert late == "STILL RUNNING after 0 s, nothing wrong so far"
    assert absent.startswith("NOT RUN: ")


def test_what_has_failed_by_its_limit_is_wrong(tmp_path: Path, environment: Mapping[str, str]) -> None:
    process = listings.start(1, "echo 'FAIL  1 s  a.clause'; sleep 9", 0, tmp_path, environment)
    wait_until(process.said.read_text)
    by_itself = listings.end(process, 0.0)
    assert listings.verdict(process, by_itself, 0.0).startswith("FAILED: a clause has failed before 0 s")


def test_lines_that_belong_together_run_at_the_same_time(
    tmp_path: Path, environment: Mapping[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listings, "BETWEEN_S", 0.0)
    text = "```sh together\nuntil [ -e there ]; do sleep 0.01; done\ntouch there\n```\n"
    assert verdicts(text, tmp_path, environment) == [(2, "right"), (3, "right")]


@pytest.mark.parametrize(
    ("code", "says"),
    [(0, "right, until Ctrl-C"), (1, "FAILED: it serves until Ctrl-C"), (130, "FAILED: it serves until Ctrl-C")],
)
def test_what_serves_gets_ctrl_c_and_ends_with_0(
    code: int, says: str, tmp_path: Path, environment: Mapping[str, str]
) -> None:
    program = tmp_path / "bin" / "soter"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\ntrap 'exit {code}' INT\necho ready\nwhile :; do sleep 0.01; done\n")
    program.chmod(0o755)
    path = f"{program.parent}:{environment['PATH']}"
    process = listings.start(1, "soter zenoh-router", 0, tmp_path, {**environment, "PATH": path})
    wait_until(lambda: "ready" in process.said.read_text())
    by_itself = listings.end(process, 0.0)
    assert listings.verdict(process, by_itself, 0.0).splitlines()[0] == says
