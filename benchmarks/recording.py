"""What recording costs a run, and showing it live: the same mission with and without; and how large recordings get.

Two robots, BIT*, all safety modules. Most of the work is done by processes of their own, beside the run; where the
machine has a core to spare, the run pays only for copying numbers into a pipe. Ticks of the same number do the same
work in every round, so the least that each of them took, summed up, shows that part alone: other processes disturb
other ticks in every round. Whoever looks at the live page is one more process, which takes all that it is told. In the
end the same on a wall clock, where nothing waits for anybody: how late ticks come.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from soter.config import MissionFile, load_mission
from soter.live.view import PAGE, LiveView
from soter.runner import Follower, RunResult, run_mission

GOAL: Final = 1.05
ENGINES: Final = ("pybullet", "kinematic")
SIDES: Final = {"without": "not recorded", "with": "recorded", "live": "recorded, live, one viewer"}
TWO_HOURS_S: Final = 7200.0

_VIEWER: Final = """
import re, sys, time, urllib.error, urllib.request
address, stream = sys.argv[1], None
try:
    while stream is None:
        time.sleep(0.1)
        try:
            page = urllib.request.urlopen(address).read().decode()
            stream = re.search('data-stream="([^"]*)"', page)[1].replace("&amp;", "&")
        except urllib.error.HTTPError:  # it has not begun
            continue
    print(sum(map(len, urllib.request.urlopen(address + stream))))
except OSError:  # it was over before anybody came
    print(0)
"""


class Bench:
    """Runs missions and remembers what they took.

    Args:
        folder: for recordings.

    Attributes:
        ticks_s: the least host time that each tick took in any round, by side.
        size_bytes: of the last recording.
        told_bytes: what the last viewer was told.
    """

    def __init__(self, folder: Path) -> None:
        self._folder: Final = folder
        self.ticks_s: Final[dict[str, list[float]]] = {}
        self.size_bytes = 0
        self.told_bytes = 0

    def measure(self, mission: MissionFile, side: str) -> float:
        """Run a mission; return the host time of its ticks in seconds."""
        return self.run(mission, side).wall_s

    def run(self, mission: MissionFile, side: str) -> RunResult:
        """Run a mission; return its result."""
        path = None if side == "without" else self._folder / "run.mcap"
        with ExitStack() as stack:
            view = stack.enter_context(self._viewed()) if side == "live" else None
            begin = None if view is None else view.begin
            seen_s: list[float] = []

            def look() -> bool:
                seen_s.append(time.perf_counter())
                return False

            run = run_mission(mission, record=path, follower=Follower(recording=begin, stop=look))
        took_s = [after - before for before, after in pairwise(seen_s)]
        self.ticks_s[side] = list(map(min, took_s, self.ticks_s.get(side, took_s)))
        if run.recording is not None:
            if run.recording.failure:
                raise RuntimeError(f"nothing was measured: {run.recording.failure}")
            self.size_bytes = run.recording.size_bytes
        return run.result

    @contextmanager
    def _viewed(self) -> Iterator[LiveView]:
        """Have a live page with somebody who looks at it."""
        with LiveView(PAGE) as view:
            command = [sys.executable, "-c", _VIEWER, view.address]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
                yield view
                view.close()
                told, _ = viewer.communicate(timeout=60.0)
        self.told_bytes = int(told)


def main(argv: Sequence[str] | None = None) -> float:
    """Measure and print; return the ratio of recording on the PyBullet engine."""
    quick = arguments(__doc__ or "", argv).quick
    ratios = {engine: _measured(engine, quick=quick) for engine in (ENGINES[:1] if quick else ENGINES)}
    _lateness(quick=quick)
    return ratios["pybullet"]


def _measured(engine: str, *, quick: bool) -> float:
    """Measure and print one engine; return the ratio of recording."""
    duration_s, rounds = (60.0 if engine == "pybullet" else 600.0, 15)
    if quick:
        duration_s, rounds = 1.0, 1
    mission = load_mission(SURVEILLANCE, {"backend": engine, "duration_s": duration_s, **_planner(quick=quick)})
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        times = in_turns({side: partial(bench.measure, mission, side) for side in SIDES}, rounds)
    ticks = duration_s / mission.base_tick_s
    least_s = {name: min(each) for name, each in times.items()}
    rows = [Row(f"{engine}, {SIDES['without']}", f"{least_s['without'] / ticks * 1e6:.0f} us/tick")]
    for name in ("with", "live"):
        ratio = least_s[name] / least_s["without"]
        goal, met = (f"<= {GOAL}", ratio <= GOAL) if (engine, name) == ("pybullet", "with") else ("", None)
        rows.append(Row(SIDES[name], f"{least_s[name] / ticks * 1e6:.0f} us/tick", ratio, goal, met))
        own_s, bare_s = sum(bench.ticks_s[name]), sum(bench.ticks_s["without"])
        rows.append(Row("  of that by the run itself", f"{(own_s - bare_s) / ticks * 1e6:.0f} us/tick", own_s / bare_s))
    size_mb = bench.size_bytes / 1e6 / duration_s * TWO_HOURS_S
    told = f"the viewer was told {bench.told_bytes / 1e3:.0f} kB"
    show("Cost of recording", rows, f"Two robots, BIT*; least of {rounds} rounds; {size_mb:.0f} MB in 2 h; {told}.")
    return least_s["with"] / least_s["without"]


def _planner(*, quick: bool) -> dict[str, object]:
    """Return what a quick run has in place of BIT*: a planner without a process, which takes most of such a run."""
    return {"planner": "straight-line"} if quick else {}


def _lateness(*, quick: bool) -> None:
    """Measure and print how late ticks come on a wall clock, with whatever scheduling the kernel allows."""
    duration_s, rounds = (1.0, 1) if quick else (20.0, 3)
    given = {"backend": "benchmarks.wall_clock:WallClockBackend", "duration_s": duration_s}
    mission = load_mission(SURVEILLANCE, {**given, **_planner(quick=quick)})
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))

        def late_ms(side: str) -> float:
            nonlocal missed
            result = bench.run(mission, side)
            missed += result.missed_ticks
            assert result.tick_late_ms is not None
            return result.tick_late_ms.p99

        times = in_turns({side: partial(late_ms, side) for side in SIDES}, rounds)
    middle_ms = {side: median(each) for side, each in times.items()}
    rows = [
        Row(words, f"{middle_ms[side]:.2f} ms", None if side == "without" else middle_ms[side] / middle_ms["without"])
        for side, words in SIDES.items()
    ]
    remark = f"99 of 100 ticks come less late than that; medians of {rounds} rounds; {missed} ticks were missed in all."
    show("Lateness of ticks on a wall clock", rows, remark)


if __name__ == "__main__":
    main()
