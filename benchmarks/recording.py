"""What recording costs a run: the same mission with and without, on both engines; and how large recordings get.

Two robots, BIT*, all safety modules. Most of the work is done by a process of its own, beside the run; where the
machine has a core to spare, the run pays only for copying numbers into a pipe. The processor time of the run's own
process shows that part alone, however busy the machine is.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from soter.config import Mission, load_mission
from soter.runner import run_mission

GOAL: Final = 1.05
ENGINES: Final = ("pybullet", "kinematic")
TWO_HOURS_S: Final = 7200.0


class Bench:
    """Runs missions and remembers what they took.

    Args:
        folder: for recordings.

    Attributes:
        processor_s: processor time of this process, by side.
        size_bytes: of the last recording.
    """

    def __init__(self, folder: Path) -> None:
        self._folder: Final = folder
        self.processor_s: Final[dict[str, list[float]]] = {"without": [], "with": []}
        self.size_bytes = 0

    def measure(self, mission: Mission, *, record: bool) -> float:
        """Run a mission; return the host time of its ticks in seconds."""
        path = self._folder / "run.mcap" if record else None
        before_s = time.process_time()
        run = run_mission(mission, record=path)
        self.processor_s["with" if record else "without"].append(time.process_time() - before_s)
        if run.recording is not None:
            if run.recording.failure:
                raise RuntimeError(f"nothing was measured: {run.recording.failure}")
            self.size_bytes = run.recording.size_bytes
        return run.result.wall_s


def main(argv: Sequence[str] | None = None) -> float:
    """Measure and print; return the ratio on the PyBullet engine."""
    quick = arguments(__doc__ or "", argv).quick
    ratios = {engine: _measured(engine, quick=quick) for engine in ENGINES}
    return ratios["pybullet"]


def _measured(engine: str, *, quick: bool) -> float:
    """Measure and print one engine; return the ratio."""
    duration_s, rounds = (2.0, 1) if quick else (120.0 if engine == "pybullet" else 1200.0, 7)
    mission = load_mission(SURVEILLANCE, {"backend": engine, "duration_s": duration_s})
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        sides = {
            "without": lambda: bench.measure(mission, record=False),
            "with": lambda: bench.measure(mission, record=True),
        }
        times = in_turns(sides, rounds)
    ticks = duration_s / mission.base_tick_s
    least_s = {name: min(each) for name, each in times.items()}
    own_s = {name: min(each) for name, each in bench.processor_s.items()}
    ratio = least_s["with"] / least_s["without"]
    goal, met = (f"<= {GOAL}", ratio <= GOAL) if engine == "pybullet" else ("", None)
    rows = [
        Row(f"{engine}, not recorded", f"{least_s['without'] / ticks * 1e6:.0f} us/tick"),
        Row("recorded", f"{least_s['with'] / ticks * 1e6:.0f} us/tick", ratio, goal, met),
        Row(
            "recorded, own processor time",
            f"{own_s['with'] / ticks * 1e6:.0f} us/tick",
            own_s["with"] / own_s["without"],
        ),
    ]
    size_mb = bench.size_bytes / 1e6 / duration_s * TWO_HOURS_S
    show("Cost of recording", rows, f"Two robots, BIT*; least of {rounds} rounds; {size_mb:.0f} MB in 2 h.")
    return ratio


if __name__ == "__main__":
    main()
