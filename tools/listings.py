"""Runs every command that the pages print, as printed, page by page: `make listings`, an hour.

Each page has a copy of the checkout and an environment of its own, so that nothing is left here and a page needs only
what it says itself. Listings with a title are saved as that file. A command ends with 0 unless the page says otherwise:
`# exits with 1` behind it, or the block's mark `exit-1` for its last one. What serves until Ctrl-C gets it after some
seconds. The lines of a block with the mark `together` are terminals: all run at the same time. With `here` they are run
in the page's folder. What needs something that is not there is listed with the reason, and never as right.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from tests.project.markdown import Block, blocks, commands_of, exit_code, title_of

ROOT: Final = Path(__file__).resolve().parents[1]
SHELLS: Final = {"sh", "bash", "shell", "console"}
SERVES: Final = re.compile(r"soter (sim|\w+-mux|zenoh-router|ros2-monitor)\b|soter run .*--(live|foxglove)\b")
BETWEEN_S = 3.0
"""Passes between the starts of commands that run at the same time."""

NOT_RUN: Final = {
    r"^apt-get ": "it changes the host; `make install-check` has apt look the names up",
    r"^make test": "`make check` runs it",
    r"my_robots\.harness|scheduler:8786|192\.0\.2\.7|3f2a91c07b5e|before\.sqlite": "it names something of the reader's",
    r"runs/evaluation\.sqlite": "it reads what takes hours to make",
    r"soter (download|measure|conform|run) examples/ardurover|field\.mcap": "it needs a vehicle; `make test-autopilot`",
    r"examples/distributed/mission\.toml --process": "it needs a host each; examples/distributed/README.md",
    r"colcon |setup\.bash|ros2 launch": "it needs ROS 2's own tools",
    r"ros2|reckless\.py": "it needs ROS 2, which has an environment of its own; `make test-ros2`",
}
"""What is not run, and why."""


class Process(NamedTuple):
    """A command under way: its line on the page, what it has to exit with, what it prints, and since when."""

    line: int
    command: str
    expected: int
    popen: subprocess.Popen[bytes]
    said: Path
    began_s: float

    @property
    def serves(self) -> bool:
        """Whether it goes on until Ctrl-C."""
        return SERVES.search(self.command) is not None


def scratch(folder: Path) -> dict[str, str]:
    """Copies what git knows of here into the folder, and returns the variables of an environment for that."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    # What is installed here is seen there too, but what a page installs is installed there.
    subprocess.run([sys.executable, "-m", "venv", folder / ".venv"], check=True)
    here = next(path for path in map(Path, sys.path) if path.name == "site-packages")
    (folder / ".venv" / here.relative_to(sys.prefix) / "here.pth").write_text(f"{here}\n")
    python = folder / ".venv" / "bin" / "python"
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "--editable", str(folder)], check=True)
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    path = os.pathsep.join((str(python.parent), str(Path(sys.prefix, "bin")), os.environ["PATH"]))
    return {**kept, "PATH": path, "BROWSER": "true", "COLUMNS": "120"}


def start(line: int, command: str, expected: int, folder: Path, environment: Mapping[str, str]) -> Process:
    """Runs a command by bash, in a session of its own, as a terminal does."""
    said = Path(tempfile.mkstemp(dir=environment["SAID"])[1])
    with said.open("wb") as into:
        popen = subprocess.Popen(
            ["bash", "-c", command],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=into,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            # Ignored, as where this runs in the background, it would be ignored by the command, too.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
    return Process(line, command, expected, popen, said, time.monotonic())


def end(process: Process, within_s: float) -> bool:
    """Waits for a command, interrupts it once it has had that long, and returns whether it has ended by itself."""
    try:
        process.popen.wait(max(0.0, process.began_s + within_s - time.monotonic()))
    except subprocess.TimeoutExpired:
        os.killpg(process.popen.pid, signal.SIGINT)
        try:
            process.popen.wait(60.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.popen.pid, signal.SIGKILL)
            process.popen.wait()
        return False
    return True


def verdict(process: Process, by_itself: bool, limit_s: float) -> str:
    """Says how a command ended."""
    code, said = process.popen.returncode, process.said.read_text(errors="replace")
    lines = "".join(f"\n    {line}" for line in said.splitlines()[-15:])
    if "Traceback (most recent call last)" in said:
        return f"FAILED: a traceback{lines}"
    if process.serves:
        # A run that is interrupted says so by 130, and may be over before; whatever else serves ends with 0.
        run = process.command.startswith("soter run")
        if code in ({0, 130} if run else {0}) and (run or not by_itself):
            return "right, until Ctrl-C"
        return f"FAILED: it serves until Ctrl-C{lines}"
    if not by_itself and re.search(r"^FAIL\b", said, re.MULTILINE):
        return f"FAILED: a clause has failed before {limit_s:.0f} s{lines}"
    if not by_itself and code != -signal.SIGKILL:
        return f"STILL RUNNING after {limit_s:.0f} s, nothing wrong so far"
    return "right" if code == process.expected else f"FAILED: {process.expected} was expected{lines}"


def run_block(
    block: Block, folder: Path, environment: Mapping[str, str], limit_s: float, serve_s: float
) -> Iterator[tuple[int, str, str, str]]:
    """Runs the commands of a block, and yields line, command, exit code and seconds, and verdict of each."""
    under_way: list[Process] = []
    commands = list(commands_of(block))
    try:
        for line, command in commands:
            if reason := next((why for what, why in NOT_RUN.items() if re.search(what, command)), None):
                yield line, command, "", f"NOT RUN: {reason}"
                continue
            said = re.search(r"# exits with (\d+)", command)
            expected = int(said[1]) if said else exit_code(block) if line == commands[-1][0] else 0
            under_way.append(start(line, command, expected, folder, environment))
            if "together" in block.marks and line != commands[-1][0]:
                time.sleep(BETWEEN_S)
                continue
            # What others serve is needed until the end.
            for each in sorted(under_way, key=lambda each: (each.serves, each.line if not each.serves else -each.line)):
                by_itself = end(each, serve_s if each.serves else limit_s)
                took = f"{each.popen.returncode:>4} {time.monotonic() - each.began_s:7.1f}"
                yield each.line, each.command, took, verdict(each, by_itself, limit_s)
            under_way.clear()
    finally:
        for each in under_way:
            if each.popen.poll() is None:
                os.killpg(each.popen.pid, signal.SIGKILL)


def run_page(page: Path, limit_s: float, serve_s: float) -> Iterator[str]:
    """Runs a page, and prints and yields the verdict on each of its commands."""
    found = list(blocks(page))
    if not any(block.language in SHELLS for block in found):
        return
    place = page.relative_to(ROOT)
    with tempfile.TemporaryDirectory(prefix="listings-") as name, tempfile.TemporaryDirectory() as said:
        folder = Path(name)
        environment = {**scratch(folder), "SAID": said}
        for block in found:
            if title := title_of(block):
                (folder / title).write_text(block.code, encoding="utf-8")
            elif block.language in SHELLS:
                where = (folder / place).parent if "here" in block.marks else folder
                for line, command, took, says in run_block(block, where, environment, limit_s, serve_s):
                    print(f"{f'{place}:{line}':38} {took:12} {command}\n{'':52}{says}", flush=True)
                    yield re.split(r":| after|,", says)[0]


def main() -> None:
    """Runs the pages; exits with 1 if a command fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", type=Path, help="all of them unless given")
    parser.add_argument("--limit", type=float, default=900.0, metavar="S", help="of a command (default: %(default)s)")
    parser.add_argument("--serve", type=float, default=20.0, metavar="S", help="before Ctrl-C (default: %(default)s)")
    given = parser.parse_args()
    # So that what is under way is ended, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    pages = given.pages or [
        *sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").rglob("*.md")),
    ]  # fmt: skip
    verdicts = [each for page in pages for each in run_page(page.resolve(), given.limit, given.serve)]
    print(", ".join(f"{verdicts.count(each)} {each}" for each in sorted(set(verdicts))))
    sys.exit("FAILED" in verdicts)


if __name__ == "__main__":
    main()
