"""SOTER's programs in processes of their own that need not import it first: they are forked from one that has.

A process that begins as a user's costs a second of imports. Here a server of Python's own makes them; besides that they
are processes like any other, with their folder, their environment, their output and their exit code.
"""

from __future__ import annotations

import atexit
import importlib
import multiprocessing
import os
import runpy
import sys
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from subprocess import CompletedProcess

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(
    [
        "soter.adapters.pybullet",
        "soter.check.mission",
        "soter.cli.run",
        "soter.cli.summary",
        "soter.conformance",
        "soter.record.reader",
        "soter.report.page.html",
        "soter.runner",
    ]
)


def warm(program: str, *arguments: str, cwd: Path, env: Mapping[str, str] | None = None) -> CompletedProcess[str]:
    """Run `soter`, or a Python file, as `subprocess.run` would, and return what it printed.

    Args:
        program: "soter", or the path of a Python file.
        arguments: of the program.
        cwd: its folder.
        env: its environment; that of this process by default. `PYTHONPATH` and `PYTHONWARNINGS=error` are heeded.
    """
    with tempfile.TemporaryDirectory() as folder:
        printed = [Path(folder, name) for name in ("out", "err")]
        given = (program, arguments, str(cwd), dict(os.environ if env is None else env), [*map(str, printed)])
        process = _SERVER.Process(target=_run, args=given)
        process.start()
        process.join()
        assert process.exitcode is not None
        return CompletedProcess([program, *arguments], process.exitcode, *(path.read_text() for path in printed))


def _run(
    program: str, arguments: Sequence[str], folder: str, environment: Mapping[str, str], printed: Sequence[str]
) -> None:
    for number, path in enumerate(printed, start=1):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), number)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    ahead = [] if program == "soter" else [str(Path(program).resolve().parent)]
    sys.path[:0] = [*ahead, *filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))]
    importlib.invalidate_caches()
    if environment.get("PYTHONWARNINGS") == "error":
        warnings.simplefilter("error")
    sys.argv = [program, *arguments]
    try:
        if program == "soter":
            from soter.cli import main

            main()
        else:
            runpy.run_path(program, run_name="__main__")
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
