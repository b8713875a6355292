"""Output that cannot be brought out, since a disk is full or its reader has left, ends no command and is told once."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from soter.record.digest import DigestState, prove
from tests.project.source import ROOT

MISSION = [
    "run", str(ROOT / "examples" / "surveillance.toml"), "--backend", "kinematic", "--planner", "straight-line",
    "--no-record", "--duration", "1",
]  # fmt: skip
CONFORM = ["conform", "kinematic", "--only", "deadman.lease"]
COMPLETION = {"_SOTER_COMPLETE": "complete_bash", "COMP_WORDS": "soter b", "COMP_CWORD": "1"}
SAYING = {
    "version": ["--version"],
    "help": ["--help"],
    "a record": [*CONFORM, "--json", "-"],
    "completion": [],
}


def said(
    arguments: list[str], out: int, before: Sequence[str] = (), *, unbuffered: bool = False
) -> subprocess.CompletedProcess[str]:
    """Run `soter` as a shell would, with a standard output of one's own."""
    beside = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    beside |= {"PYTHONUNBUFFERED": "1"} if unbuffered else {}
    beside |= {} if arguments else COMPLETION
    return subprocess.run(
        [*before, sys.executable, "-m", "soter.cli", *arguments], cwd=ROOT, env=beside,
        stdout=out, stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip


def complaints(done: subprocess.CompletedProcess[str]) -> list[str]:
    """What a command complains of; it must not have lines of Python's."""
    assert "Traceback" not in done.stderr
    assert "ignored" not in done.stderr
    return [line for line in done.stderr.splitlines() if line.startswith("error: ")]


@pytest.mark.parametrize(("what", "unbuffered"), [*((each, False) for each in SAYING), ("version", True)])
def test_a_full_disk_is_told_once_and_exits_with_3(what: str, unbuffered: bool) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    done = said(SAYING[what], full, unbuffered=unbuffered)
    os.close(full)
    expected = ["error: nothing more can be written: No space left on device; make room, or write elsewhere"]
    assert (complaints(done), done.returncode) == (expected, 3)


@pytest.mark.parametrize("arguments", [["--help"], MISSION], ids=["help", "a run"])
def test_a_reader_that_leaves_ends_no_command(arguments: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = said(arguments, writer)
    os.close(writer)
    assert (complaints(done), done.returncode) == ([], 0)


@pytest.mark.parametrize("closed", [[1], [2], [1, 2], [0, 1, 2]], ids=str)
def test_a_run_that_is_started_without_its_streams_says_and_keeps_all_the_same(
    closed: list[int], tmp_path: Path
) -> None:
    recording, result = tmp_path / "run.mcap", tmp_path / "result.json"
    mission = [each for each in MISSION if each != "--no-record"]
    done = subprocess.run(
        [sys.executable, "-m", "soter.cli", *mission, "--record", str(recording), "--json", str(result)],
        cwd=ROOT, capture_output=True, text=True, check=False,
        preexec_fn=lambda: [os.close(fd) for fd in closed],  # type: ignore[func-returns-value]
    )  # fmt: skip
    assert (complaints(done), done.returncode) == ([], 0)
    assert json.loads(result.read_text())["status"] == "completed"
    assert prove(recording).state is DigestState.WHOLE


TAKES_THEM_AWAY = """
import os, sys
from soter import Mission

class Mute(Mission):
    async def run(self, robot):
        if robot.id == 1:
            {deed}
"""


@pytest.mark.parametrize("deed", ["sys.stdout = sys.stderr = None", "os.close(1); os.close(2)"])
def test_a_script_that_takes_the_streams_away_changes_neither_exit_code_nor_result(deed: str, tmp_path: Path) -> None:
    script, result = tmp_path / "mute.py", tmp_path / "result.json"
    script.write_text(TAKES_THEM_AWAY.format(deed=deed))
    done = said([*MISSION, "--mission", str(script), "--json", str(result)], subprocess.PIPE)
    assert (complaints(done), done.returncode) == ([], 0)
    assert json.loads(result.read_text())["status"] == "completed"


def test_a_terminal_that_is_gone_costs_a_run_nothing(tmp_path: Path) -> None:
    shown, terminal = pty.openpty()
    # As with `nohup` or in a session that is left: no signal ends it, and what it writes fails.
    run = subprocess.Popen(
        ["sh", "-c", 'trap "" HUP; exec "$@"', "sh", sys.executable, "-m", "soter.cli", *MISSION,
         "--json", "result.json"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim")))},
        stdin=terminal, stdout=terminal, stderr=terminal, start_new_session=True,
    )  # fmt: skip
    os.close(terminal)
    os.close(shown)
    assert run.wait(60.0) == 0
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "completed"


def test_a_run_whose_output_is_lost_goes_on_to_its_end(tmp_path: Path) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    done = said([*MISSION, "--json", str(tmp_path / "result.json")], full)
    os.close(full)
    assert (len(complaints(done)), done.returncode) == (1, 3)
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "completed"


def test_a_record_that_finds_no_room_at_every_clause_is_told_once(tmp_path: Path) -> None:
    # A limit of the system's is as good as a disk of that size.
    shell = ["sh", "-c", 'ulimit -f 1; exec "$@"', "sh"]
    command = ["conform", "kinematic", "--only", "deadman", "--json", str(tmp_path / "record.json")]
    done = said(command, subprocess.DEVNULL, shell)
    assert complaints(done) == ["error: the record could not be written: [Errno 27] File too large"]
    assert done.returncode == 3
    assert not [*tmp_path.iterdir()]
