"""Nothing that a terminal obeys comes out of a command, whatever the names of files and whatever stands in them."""

from __future__ import annotations

import io
import json
import logging
import os
import pty
import subprocess
import sys
import unicodedata
from pathlib import Path

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from soter.cli.app import app, main
from soter.cli.console import HumanConsole
from soter.cli.plain import PlainFormatter, PlainStream, plain
from tests.project.source import ROOT
from tests.record.helpers import mission, rewrite

HOSTILE = "\x1b[31mred\x1b]0;title\x07\r\x9b2J\u202egnp.\u2066\x7f\u2028"
"""Colours, a title, a cleared screen, and directions of writing; a name of a file may be all of this."""


def obeyed(text: str) -> set[str]:
    """What of a text is not for eyes."""
    return {each for each in text if unicodedata.category(each) in {"Cc", "Cf", "Cs", "Zl", "Zp"}} - {"\n", "\t"}


@given(st.text() | st.text(st.characters(categories=["Cc", "Cf", "Zl", "Zp"])))
def test_what_is_not_for_eyes_is_written_out(text: str) -> None:
    written = plain(text)
    assert not obeyed(written) & {*"\x1b\x07\x08\r\x7f\x9b\u200e\u202e\u2066\u2028"}
    assert not any(unicodedata.category(each) == "Cc" for each in written if each not in "\n\t")
    assert plain(written) == written
    # Whatever reads JSON reads what it read before.
    assert json.loads(plain(json.dumps(text, ensure_ascii=False))) == text


def test_the_bytes_of_a_name_that_is_no_utf_8_are_written_out() -> None:
    assert plain(os.fsdecode(b"a\x9b2J")) == "a\\udc9b2J"


@given(st.text(st.characters(categories=["Cc", "Cf", "Ll"])))
def test_a_stream_that_is_guarded_lets_nothing_else_out(text: str) -> None:
    out = io.StringIO()
    PlainStream(out).write(text)
    assert out.getvalue() == plain(text)


def test_colours_pass_where_none_come_from_outside() -> None:
    out = io.StringIO()
    PlainStream(out, styled=True).write("\x1b[1;31mError\x1b[0m \x1b[2J")
    assert out.getvalue() == "\x1b[1;31mError\x1b[0m \\u001b[2J"


def test_rich_keeps_its_own_colours_only() -> None:
    out = io.StringIO()
    console = HumanConsole(file=out, force_terminal=True, width=200, color_system="standard")
    table = Table(HOSTILE)
    table.add_row(HOSTILE, style="green")
    console.print(table)
    console.print(HOSTILE)
    text = out.getvalue()
    assert "\x1b[32m" in text
    assert obeyed(text) == {"\x1b"}
    assert "\x1b[31m" not in text


def test_what_is_logged_is_plain() -> None:
    record = logging.LogRecord("a", logging.WARNING, "", 0, "%s", (HOSTILE,), None)
    assert not obeyed(PlainFormatter().format(record))


# --- every command -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a hostile name with a mission, a workspace and a recording that say hostile things."""
    folder = tmp_path_factory.mktemp("a") / HOSTILE
    folder.mkdir()
    text = (ROOT / "examples" / "surveillance.toml").read_text()
    space = folder / f"{HOSTILE}.xml"
    space.write_text((ROOT / "examples" / "surveillance.xml").read_text())
    quoted, hostile = (json.dumps(each).replace("\x7f", "\\u007f") for each in (space.name, HOSTILE))
    (folder / "good.toml").write_text(text.replace('"surveillance.xml"', quoted))
    (folder / "bad.toml").write_text(f"workspace = {hostile}\nbackend = {hostile}\n{hostile} = {hostile}\n")
    (folder / "bad.xml").write_text("<workspace><\u202e/></workspace>")
    plain_file = folder / "plain.mcap"
    from soter.runner import run_mission

    run_mission(mission(duration_s=2.0), record=plain_file)

    def spoilt(name: str, data: bytes) -> bytes:
        written = hostile.encode()[1:-1]
        return data.replace(b'"kinematic"', b'"' + written + b'"').replace(b'"completed"', b'"' + written + b'"')

    rewrite(plain_file, folder / "spoilt.mcap", lambda _, data: data, spoilt)
    (folder / "bad.mcap").write_bytes(plain_file.read_bytes()[:100])
    return folder


CALLS: dict[str, list[list[str]]] = {
    "run": [["good.toml", "--backend", "kinematic", "--duration", "0.2", "--planner", "straight-line", "--json", "-"],
            ["bad.toml"], ["good.toml", "--set", f"{HOSTILE}={HOSTILE}"], ["good.toml", "--json", f"{HOSTILE}/x"]],
    "check": [["bad.toml"], ["--replay", "bad.toml"]],
    "ablate": [["bad.toml"], ["good.toml", "--variants", HOSTILE]],
    "info": [["spoilt.mcap"], ["plain.mcap"], ["bad.mcap"], ["plain.mcap", "--json"]],
    "replay": [["spoilt.mcap"], ["plain.mcap"], ["bad.mcap"]],
    "tune": [["bad.toml"], ["good.toml", "--set", f"{HOSTILE}={HOSTILE}"]],
    "measure": [["bad.toml", "--room", "2"], ["good.toml", "--room", "2", "--set", f"{HOSTILE}={HOSTILE}"]],
    "download": [["bad.toml"], ["good.toml", "--backend", "kinematic"], ["good.toml", "--set", f"{HOSTILE}={HOSTILE}"]],
    "workspace": [["bad.xml"], [HOSTILE], ["bad.xml", "--to", f"{HOSTILE}.toml"]],
    "verify": [["spoilt.mcap"], ["plain.mcap"], ["bad.mcap"]],
    "report": [["bad.mcap"], ["plain.mcap", "-o", f"{HOSTILE}.html"]],
    "backends": [[HOSTILE]],
    "conform": [[HOSTILE]],
    "sim mavlink": [["bad.xml"]],
    "sim ros2": [["bad.xml"]],
    "sim zenoh": [["bad.xml"]],
    "ros2-mux": [["--robot", HOSTILE, f"--{HOSTILE}"]],
    "ros2-monitor": [["bad.toml"]],
    "zenoh-mux": [["--robot", HOSTILE]],
    "zenoh-router": [["--listen", HOSTILE]],
    "new adapter": [["name", "--out", HOSTILE]],
    "compare": [["spoilt.mcap", "plain.mcap", "-o", f"{HOSTILE}.html"], ["bad.mcap", "plain.mcap"]],
    "campaign run": [["bad.toml"], ["good.toml"]],
    "campaign report": [["bad.toml"]],
    "campaign compare": [["bad.toml", "--by", HOSTILE]],
    "campaign run-again": [["bad.toml", "1"]],
    "campaign draw": [["1", "--engine", HOSTILE]],
}  # fmt: skip


def commands() -> set[str]:
    """The names of all commands."""
    found = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    return {
        f"{name} {inner}" if inner else name
        for name, command in found.items()
        for inner in (getattr(command, "commands", None) or [""])
    }


def test_every_command_is_driven() -> None:
    assert set(CALLS) == commands()


@pytest.mark.parametrize("command", CALLS)
def test_no_command_says_what_a_terminal_obeys(
    command: str, hostile: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hostile)
    monkeypatch.setattr(sys, "stdout", sys.stdout)
    monkeypatch.setattr(sys, "stderr", sys.stderr)
    for arguments in [*CALLS[command], [HOSTILE], [str(hostile / "absent")], [f"--{HOSTILE}"]]:
        monkeypatch.setattr(sys, "argv", ["soter", *command.split(), *arguments])
        with pytest.raises(SystemExit):
            main()
        for text in capfd.readouterr():
            assert not obeyed(text), f"{arguments}: {text!r}"
            assert "Traceback" not in text, text


def test_on_a_terminal_colours_are_our_own(hostile: Path) -> None:
    ours, theirs = pty.openpty()
    subprocess.run(
        [sys.executable, "-m", "soter.cli", "info", str(hostile / "spoilt.mcap")],
        stdin=theirs, stdout=theirs, stderr=theirs, check=False,
    )  # fmt: skip
    os.close(theirs)
    said = bytearray()
    try:
        while data := os.read(ours, 65536):
            said += data
    except OSError:
        os.close(ours)
    text = said.decode()
    assert "spoilt.mcap" in text
    for sequence in ("\x1b[31mred", "\x1b]0;", "\x07", "\x9b", "\u202e", "\u2066"):
        assert sequence not in text
