"""Completes the values of arguments and options in a shell. Imports are made only when they are needed."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import get_args


def backends() -> list[str]:
    """Return the names of all registered backends."""
    from soter.registry import backend_names

    return backend_names()


def engines() -> list[str]:
    """Return the engines of simulated robots."""
    return ["pybullet", "kinematic"]


def targets() -> list[str]:
    """Return the names of target sets."""
    from soter.config.tables import Targets

    return [*get_args(Targets)]


def planners() -> list[str]:
    """Return the planners of this distribution."""
    from soter.stack.planners.names import BUILT_IN

    return [*BUILT_IN]


def modules(incomplete: str) -> list[str]:
    """Return the completions of a list of modules separated by commas."""
    from soter.config.tables import MODULES

    before, comma, _ = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in MODULES if name not in before.split(",")]


def scripts(incomplete: str) -> list[str]:
    """Return the values of `--mission`: the surveillance mission, and scripts."""
    from soter.config.tables import SURVEILLANCE

    return [SURVEILLANCE, *_files(incomplete, ".py")]


def controllers(incomplete: str) -> list[str]:
    """Return the values of `--ac`: the mission, adversaries, and files with a user's classes."""
    from soter.controllers.names import ADVERSARIES, MISSION, PREFIX

    return [MISSION, *(PREFIX + name for name in ADVERSARIES), *_files(incomplete, ".py")]


def missions(incomplete: str) -> list[str]:
    """Return mission files."""
    return _files(incomplete, ".toml")


def robots(incomplete: str) -> list[str]:
    """Return what the conformance kit can try: backends, and mission files."""
    return [*backends(), *missions(incomplete)]


def recordings(incomplete: str) -> list[str]:
    """Return recordings."""
    return _files(incomplete, ".mcap")


def _files(incomplete: str, ending: str) -> list[str]:
    """Return files of one kind and folders that begin with `incomplete`; a single folder is replaced by its content.

    Otherwise a shell would take that folder for the end of the word.
    """
    folder = Path(incomplete).parent if not incomplete.endswith("/") else Path(incomplete)
    name = incomplete.rpartition("/")[2]
    prefix = incomplete[: len(incomplete) - len(name)]
    try:
        found = sorted(each for each in folder.iterdir() if each.name.startswith(name))
    except OSError:
        return []
    hidden = name.startswith(".")
    shown = [each for each in found if hidden or not each.name.startswith(".")]
    folders = [f"{prefix}{each.name}/" for each in shown if each.is_dir()]
    files = [prefix + each.name for each in shown if each.suffix == ending and each.is_file()]
    return files + folders if files or len(folders) != 1 else _files(folders[0], ending)


def answer(command: Callable[[], object]) -> None:
    """Print the completions for a shell.

    Bash treats colons and equals signs as words of their own, and replaces only the text behind them with a completion.
    Fish and zsh replace the whole word, such as `--backend=k`.
    """
    cut = _join() if "COMP_CWORD" in os.environ else 0
    word = os.environ.get("_TYPER_COMPLETE_ARGS", "").rpartition(" ")[2]
    option = word[: word.find("=") + 1] if word.startswith("-") else ""
    zsh = os.environ["_SOTER_COMPLETE"] == "complete_zsh"
    said = io.StringIO()
    try:
        with redirect_stdout(said):
            command()
    finally:
        before = "" if zsh else option
        lines = (before + line[cut:] for line in said.getvalue().splitlines(keepends=True))
        sys.stdout.write("compset -P '*='; " * bool(zsh and option) + "".join(lines))


def _join() -> int:
    """Join the words that bash has split; return how many characters to leave out at the start of each completion."""
    words, at = os.environ["COMP_WORDS"].split("\n"), int(os.environ["COMP_CWORD"])
    if at >= len(words):
        return 0
    joined: list[str] = []
    for word in words[: at + 1]:
        if joined and (word.startswith((":", "=")) or joined[-1].endswith((":", "="))):
            joined[-1] += word
        else:
            joined.append(word)
    os.environ["COMP_WORDS"], os.environ["COMP_CWORD"] = "\n".join(joined), str(len(joined) - 1)
    value = joined[-1].partition("=")[2] if joined[-1].startswith("-") else joined[-1]
    return value.rfind(":") + 1 if words[at] != joined[-1] else 0
