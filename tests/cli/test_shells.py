"""Shells themselves complete what is typed: the script that `soter --show-completion` prints is theirs to run."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.project.source import ROOT

WHOLE = {
    "soter ru": "soter run",
    "soter run --backend=kin": "soter run --backend=kinematic",
    "soter run --ac=adversary:ch": "soter run --ac=adversary:chase",
    "soter check examples/surv": "soter check examples/surveillance.toml",
}
# What is in the line is said at Ctrl-X, and the line is empty then.
SHELLS = {
    "bash": ["--norc", "--noprofile", "bind -x '\"\\C-x\": echo \"<$READLINE_LINE>\"; READLINE_LINE='",
             "bind 'set bell-style none'"],
    "zsh": ["-f", "-i", "autoload -Uz compinit; compinit -D -u",
            "show() { print -r -- \"<$BUFFER>\"; BUFFER= }; zle -N show; bindkey '^X' show"],
}  # fmt: skip
PATIENCE_S = 60.0


@pytest.fixture
def around(tmp_path: Path) -> dict[str, str]:
    """The environment of a shell that finds `soter`, and nothing of the user's."""
    (tmp_path / "soter").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m soter.cli "$@"\n')
    (tmp_path / "soter").chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "HOME": str(tmp_path), "TERM": "dumb", "PYTHONPATH": str(ROOT)}


def needs(shell: str) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell}: apt-get install {shell}")


class Terminal:
    """A shell on a terminal."""

    def __init__(self, shell: str, options: list[str], around: dict[str, str]) -> None:
        self._ours, theirs = pty.openpty()
        self._process = subprocess.Popen(
            [shell, *options], stdin=theirs, stdout=theirs, stderr=theirs, env=around, cwd=ROOT, start_new_session=True
        )
        os.close(theirs)

    def type(self, text: str, until: str) -> str:
        """Type a text; return what the shell has said by the time that what is awaited is there."""
        os.write(self._ours, text.encode())
        said, ends_s = "", time.monotonic() + PATIENCE_S
        while re.search(until, said) is None:
            assert time.monotonic() < ends_s, said
            if select.select([self._ours], [], [], 1.0)[0]:
                said += os.read(self._ours, 65536).decode(errors="replace")
        return said

    def close(self) -> None:
        """Let go of the shell."""
        self._process.kill()
        self._process.wait()
        os.close(self._ours)


@pytest.mark.parametrize("shell", SHELLS)
def test_a_shell_completes(shell: str, around: dict[str, str]) -> None:
    needs(shell)
    options = [each for each in SHELLS[shell] if each.startswith("-")]
    terminal = Terminal(shell, options, around)
    try:
        for each in SHELLS[shell][len(options) :]:
            terminal.type(f"{each}\n", r"\n")
        terminal.type(f'eval "$(soter --show-completion {shell})"; echo rea""dy\n', r"ready")
        for typed, whole in WHOLE.items():
            found = re.findall("<(.*?)>", terminal.type(f"{typed}\t\x18", r"<.*>"))
            assert found[-1].rstrip() == whole
    finally:
        terminal.close()


def test_fish_completes(around: dict[str, str]) -> None:
    needs("fish")
    asked = "; ".join(f"complete -C '{typed}'; echo" for typed in WHOLE)
    done = subprocess.run(
        ["fish", "--no-config", "-c", f"soter --show-completion fish | source; {asked}"],
        env=around, cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    told = [answer.partition("\t")[0] for answer in done.stdout.split("\n\n") if answer]
    assert told == [whole.rpartition(" ")[2] for whole in WHOLE.values()]
