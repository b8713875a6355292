"""What all benchmarks share: taking turns, and one way to show ratios.

A time by itself says as much about the machine, and about what else it was doing, as about SOTER. So each benchmark
measures what it is about and a reference in turns, in one process, and reports their ratio.
"""

from __future__ import annotations

import argparse
import gc
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
SURVEILLANCE = ROOT / "examples" / "surveillance.toml"


class Row(NamedTuple):
    """One line of a benchmark's table.

    Attributes:
        name: what was measured.
        value: the figure, with its unit.
        ratio: the figure over the reference of the same run, or the other way round; None for the reference.
        goal: what the ratio or the figure should be; empty where there is no goal.
        met: whether it is; None where there is no goal.
    """

    name: str
    value: str
    ratio: float | None = None
    goal: str = ""
    met: bool | None = None


def arguments(summary: str, argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the command line's arguments: `quick`, which makes everything tiny and the figures meaningless."""
    parser = argparse.ArgumentParser(description=summary.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="tiny sizes: shows that it runs, measures nothing")
    return parser.parse_args(argv)


def in_turns(sides: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Measure several things in turns, every other round in reverse, so that a slow moment of the machine hits all.

    Args:
        sides: by name, what measures itself once and returns how long it took.
        rounds: how often.

    Returns:
        All times, by name, in the order of the rounds.
    """
    times: dict[str, list[float]] = {name: [] for name in sides}
    gc.collect()
    # Each begins without the garbage of the one before; what was there before all of them is not looked through again.
    gc.freeze()
    try:
        for turn in range(rounds):
            order = list(sides) if turn % 2 == 0 else list(sides)[::-1]
            for name in order:
                gc.collect()
                times[name].append(sides[name]())
    finally:
        gc.unfreeze()
    return times


@contextmanager
def load(processes: int) -> Iterator[None]:
    """Keep so many cores busy."""
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def show(title: str, rows: Sequence[Row], remark: str = "") -> None:
    """Print a table."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    table.add_column("measured", justify="right")
    table.add_column("ratio", justify="right")
    table.add_column("goal", justify="right")
    table.add_column("")
    for row in rows:
        verdict = "" if row.met is None else "[green]met[/]" if row.met else "[red]missed[/]"
        table.add_row(row.name, row.value, "1" if row.ratio is None else f"{row.ratio:.3g}", row.goal, verdict)
    console = Console(highlight=False)
    console.print(table)
    if remark:
        console.print(remark, soft_wrap=True)
