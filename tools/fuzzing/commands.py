"""Inputs through the command line: each command in a process that begins where everything is imported."""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from soter.cli.app import main
from tools.fuzzing.formats import MISSION, ROOT

Fails = Callable[[bytes], str]
"""Takes an input; returns what was wrong, or nothing."""

LONGEST_S: Final = 10
"""Of processor time, which a busy host does not change."""

WAITING_S: Final = 120
"""Of the host's time, for one that waits and does nothing."""

MOST_BYTES: Final = 1 << 30
_QUICK: Final = ("--set", "backend=kinematic", "--set", "planner=straight-line", "--duration", "0.5", "--no-record")
_COMMANDS: Final[dict[str, tuple[tuple[str, ...], ...]]] = {
    "toml": (("run", "FILE", "--quiet", *_QUICK), ("run", "FILE", "--backend", "kinematic", "--duration", "0.2",
             "--no-record", "--planner", "straight-line")),
    "xml": (("run", "MISSION", "--set", "workspace=FILE", "--quiet", *_QUICK),),
    "mcap": (("info", "FILE"), ("info", "FILE", "--csv", "tables"), ("replay", "FILE"),
             ("report", "FILE", "-o", "page.html", "--png", "p.png")),
}  # fmt: skip


def address_space() -> int:
    """Return how much address space this process has, in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def runner(name: str) -> Fails:
    """Return what runs the commands for a format.

    Raises:
        SystemExit: no command reads such inputs from a file.
    """
    if name not in _COMMANDS:
        sys.exit(f"no command reads {name}; allowed with --commands: {', '.join(_COMMANDS)}")
    import soter.report.picture  # noqa: F401 - so that no child has to

    turn = 0

    def fails(data: bytes) -> str:
        nonlocal turn
        arguments = _COMMANDS[name][turn % len(_COMMANDS[name])]
        turn += 1
        with tempfile.TemporaryDirectory(prefix="soter-fuzz-") as folder:
            file = Path(folder) / f"file.{name}"
            file.write_bytes(data)
            mission = Path(folder) / "mission.toml"
            mission.write_text(MISSION.read_text())
            for space in (ROOT / "examples").glob("*.xml"):
                (Path(folder) / space.name).write_bytes(space.read_bytes())
            known = {"FILE": str(file), "MISSION": str(mission), "workspace=FILE": f"workspace={file.name!r}"}
            return _run([known.get(each, each) for each in arguments], Path(folder))

    return fails


def _run(arguments: Sequence[str], folder: Path) -> str:
    said = folder / "said"
    child = os.fork()
    if not child:
        _be(arguments, folder, said)
    _, status, used = os.wait4(child, 0)
    text = said.read_text(errors="replace") if said.exists() else ""
    called = f"soter {' '.join(arguments)}"
    if os.WIFSIGNALED(status):
        number = signal.Signals(os.WTERMSIG(status)).name
        limits = {"SIGPROF": f", after {LONGEST_S} s of processor time", "SIGALRM": f", after {WAITING_S} s"}
        return f"{called}: ended by {number}{limits.get(number, '')}"
    if "Traceback" in text or "fault of SOTER" in text:
        return f"{called}:\n{text}"
    if used.ru_maxrss * 1024 > MOST_BYTES:
        return f"{called}: {used.ru_maxrss / 1e3:.0f} MB"
    return ""


def _be(arguments: Sequence[str], folder: Path, said: Path) -> None:
    """Be a command; never return."""
    code = 70
    try:
        for number in (signal.SIGALRM, signal.SIGPROF):
            signal.signal(number, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        signal.alarm(WAITING_S)
        out = os.open(said, os.O_WRONLY | os.O_CREAT)
        for fd in (1, 2):
            os.dup2(out, fd)
        os.chdir(folder)
        sys.argv = ["soter", *arguments]
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 70
    except BaseException:  # noqa: BLE001 - this process has to end here
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
