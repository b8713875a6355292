"""Tries every line of the pages that installs something: `make install-check`, a part of `make dist`.

pip resolves each line in a new environment, and apt simulates it: a name that no index has, an extra that there is not,
or a package that Debian does not know, is found. With `--really` each line of pip is carried out in an environment of
its own, and `soter backends` has to run there afterwards; that takes gigabytes. A package that a page has the reader
make is made first.
"""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md"),
    *(ROOT / "benchmarks").glob("*.md"),
]  # fmt: skip
_LINE = re.compile(r"`?((?:pip|apt-get) install [^`#\n]+)")


class Line(NamedTuple):
    """A line that installs something, and the page that it is on."""

    page: str
    words: tuple[str, ...]


def lines() -> Iterator[Line]:
    """Every different line of the pages, in listings and in the running text."""
    seen = set()
    for page in sorted(PAGES):
        for found in _LINE.finditer(page.read_text(encoding="utf-8")):
            words = tuple(shlex.split(found[1]))
            if words not in seen:
                seen.add(words)
                yield Line(str(page.relative_to(ROOT)), words)


class Failed(Exception):
    """A line does not do what it says."""


def run(*command: str | Path, cwd: Path = ROOT) -> str:
    """Runs a command to its end and returns all that it printed."""
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    said = done.stdout + done.stderr
    if done.returncode != 0:
        raise Failed(f"it ends with {done.returncode}: {said[-2000:]}")
    return said


def environment(folder: Path) -> Path:
    """Makes a new environment and returns its Python."""
    venv.create(folder, with_pip=True)
    return folder / "bin" / "python"


def try_apt(line: Line) -> str:
    """Simulates a line of apt-get."""
    if shutil.which("apt-get") is None:
        return "NOT RUN: no apt-get here"
    if not list(Path("/var/lib/apt/lists").glob("*Packages*")):
        return "NOT RUN: no package lists here (apt-get update)"
    run(line.words[0], "install", "--simulate", *line.words[2:])
    return "apt knows them"


def try_pip(line: Line, python: Path, made: Path, *, really: bool) -> str:
    """Has pip resolve a line, or carry it out, from the root of a clone."""
    arguments = list(line.words[2:])
    last = arguments[-1]
    if re.fullmatch(r"soter-[a-z_]+", last):
        # A package that the page has just made.
        if not (made / last).exists():
            run(sys.executable, "-m", "soter.cli", "new", "adapter", last.removeprefix("soter-"), "--out", made / last)
        arguments[-1] = str(made / last)
    if (ROOT / arguments[-1]).resolve() != ROOT and (ROOT / arguments[-1]).is_dir():
        # An adapter's package: SOTER is there already, as it is for whoever reads its page.
        arguments = ["-e", str(ROOT), *arguments]
    if not really:
        arguments.insert(0, "--dry-run")
    said = run(python, "-m", "pip", "--disable-pip-version-check", "install", *arguments)
    if unknown := re.search(r"does not provide the extra .*", said):
        raise Failed(unknown[0])
    if not really:
        return "pip resolves it"
    if "--no-deps" in arguments:
        run(python, "-c", "import soter.onboard")  # what such a robot needs
    elif (soter := python.with_name("soter")).exists():
        run(soter, "backends")
    return "installed"


def main() -> None:
    """Tries them all; exits with 1 if one fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--really", action="store_true", help="install each of them, in environments of their own")
    really: bool = parser.parse_args().really
    failed = False
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        shared = None if really else environment(scratch / "shared")
        for number, line in enumerate(lines()):
            try:
                if line.words[0] == "apt-get":
                    outcome = try_apt(line)
                else:
                    python = shared or environment(scratch / str(number))
                    outcome = try_pip(line, python, scratch, really=really)
            except Failed as failure:
                failed = True
                outcome = f"FAILED: {failure}"
            print(f"{line.page}: {shlex.join(line.words)}: {outcome}", flush=True)
            if shared is None:
                shutil.rmtree(scratch / str(number), ignore_errors=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
