"""How late the supervisor's ticks come while missions misbehave, against a loop that does nothing but sleep.

The missions are those of the tests in `tests/runner/hostile.py`, which turn after a second and a half. They count as
hung only after a minute here, so that they go on doing what they do. The loop has the same period and runs beside each
of them in a process of its own, so that what the host delays it delays for both. With load, as many more processes
spin as there are cores. Where the kernel allows it ticks are scheduled in real time, and compared with that they are
measured without it too.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from benchmarks.common import SURVEILLANCE, Row, arguments, load, show
from benchmarks.wall_clock import JITTER_S
from soter.config import load_mission
from soter.runner import run_mission

TICK_S = 0.05
GOAL = 2.0
HOSTILE = ("Spins", "EatsMemory", "Chatters", "FloodsWithTurns", "FloodsWithGarbage", "Crashes")
LOOP = f"""
import json, select, sys, time
start_s, late_ms = time.perf_counter(), []
while not select.select([sys.stdin], [], [], 0.0)[0]:
    due_s = start_s + len(late_ms) * {TICK_S}
    while (left_s := due_s - time.perf_counter()) > 0.0:
        time.sleep(left_s)
    late_ms.append(1e3 * (time.perf_counter() - due_s))
print(json.dumps(late_ms))
"""


class Lateness(NamedTuple):
    """How late ticks came, in milliseconds, and how many later than the robots allow."""

    p50: float
    p99: float
    max: float
    missed: int

    def __str__(self) -> str:
        return f"{self.p50:.2f} / {self.p99:.2f} / {self.max:.1f}, {self.missed}"


def lateness(late_ms: Sequence[float]) -> Lateness:
    """Sum up."""
    p50, p99 = np.percentile(late_ms, (50, 99))
    return Lateness(float(p50), float(p99), max(late_ms), sum(late > 1e3 * JITTER_S for late in late_ms))


@contextmanager
def beside() -> Iterator[list[float]]:
    """Run the loop; yield a list that holds its lateness when it is over."""
    found: list[float] = []
    loop = subprocess.Popen([sys.executable, "-c", LOOP], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        yield found
    finally:
        # The end of its input ends it.
        said, _ = loop.communicate()
        found += json.loads(said)


class Pair(NamedTuple):
    """The ticks of a run, the loop beside it, and whether the ticks were scheduled in real time."""

    ticks: Lateness
    loop: Lateness
    real_time: bool

    @property
    def ratio(self) -> float:
        """That of the 99th percentiles."""
        return self.ticks.p99 / self.loop.p99


def mission(ac: str, duration_s: float, real_time: str = "auto") -> Pair:
    """Run a mission on a wall clock."""
    overrides = {
        "backend": "benchmarks.wall_clock:WallClockBackend", "planner": "straight-line", "targets": "uniform",
        "duration_s": duration_s, "ac": ac, "base_tick_s": TICK_S,
        "isolation.silent_s": 60.0, "isolation.real_time": real_time,
    }  # fmt: skip
    with beside() as loop_ms:
        result = run_mission(load_mission(SURVEILLANCE, overrides)).result
    late = result.tick_late_ms
    assert late is not None
    ticks = Lateness(late.p50, late.p99, late.max, result.missed_ticks)
    return Pair(ticks, lateness(loop_ms), result.real_time)


def row(name: str, found: Pair) -> Row:
    """Return the line of one run."""
    ticks, loop, real_time = found
    if real_time:
        goal, met = f"none later than {1e3 * JITTER_S:g} ms", ticks.missed == 0
    else:
        goal, met = f"ratio <= {GOAL:g}", found.ratio <= GOAL
    return Row(f"{name}{'' if real_time else ', not real-time'}", f"{ticks} | {loop}", found.ratio, goal, met)


def main(argv: Sequence[str] | None = None) -> dict[str, Pair]:
    """Measure and print; return the lateness by what was measured."""
    quick = arguments(__doc__ or "", argv).quick
    duration_s = 0.5 if quick else 15.0
    acs = {"mission": "mission", **({} if quick else {name: f"tests.runner.hostile:{name}" for name in HOSTILE})}
    found: dict[str, Pair] = {}
    logging.disable(logging.ERROR)  # what missions print and fail by is not of interest here
    try:
        found |= {name: mission(ac, duration_s) for name, ac in acs.items()}
        if not quick:
            with load(os.cpu_count() or 1):
                found |= {f"{name}, load": mission(ac, duration_s) for name, ac in acs.items()}
                if any(each.real_time for each in found.values()):
                    found |= {f"{name}, load ": mission(acs[name], duration_s, "never") for name in list(acs)[:2]}
    finally:
        logging.disable(logging.NOTSET)
    remark = (
        f"Milliseconds: p50 / p99 / max, and how many were later than {1e3 * JITTER_S:g}; the ticks | the loop beside "
        "them. The ratio is that of the 99th percentiles."
    )
    show("Lateness of the supervisor's ticks", [row(name.strip(), each) for name, each in found.items()], remark)
    return found


if __name__ == "__main__":
    main()
