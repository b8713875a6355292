"""What `soter --version` and `soter --help` take, over a Python that only imports what the command line stands on."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
from collections.abc import Sequence

from benchmarks.common import ROOT, Row, arguments, in_turns, show

GOAL = 3.0
SIDES = {
    "import typer, rich": ("-c", "import typer, rich"),
    "soter --version": ("-m", "soter.cli", "--version"),
    "soter --help": ("-m", "soter.cli", "--help"),
}


def processor_s(command: Sequence[str]) -> float:
    """Return the processor time that a command takes; the host's time says more about what else it does."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *command], cwd=ROOT, check=True, capture_output=True, env={**os.environ, "COLUMNS": "100"}
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    quick = arguments(__doc__ or "", argv).quick
    sides = {name: lambda command=command: processor_s(command) for name, command in SIDES.items()}
    found = {name: statistics.median(times) for name, times in in_turns(sides, 1 if quick else 15).items()}
    (bare_name, bare_s), *others = found.items()
    rows = [Row(bare_name, f"{1000.0 * bare_s:.0f} ms")]
    for name, taken_s in others:
        ratio = taken_s / bare_s
        rows.append(Row(name, f"{1000.0 * taken_s:.0f} ms", ratio, f"ratio at most {GOAL:g}", ratio <= GOAL))
    show("Start of the command line", rows)


if __name__ == "__main__":
    main()
