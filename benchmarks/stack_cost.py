"""What the stack costs: a mission with everything on, against the bare PyBullet world driven the same way.

Two robots, BIT*, all safety modules. The reference replays the run's own wheel commands in a world without a stack,
with the same state reads and the same truth; that it is the same run is checked in every control period.
"""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from benchmarks.replay import record, replay
from soter.config import load_mission
from soter.runner import run_mission

GOAL = 1.25


def main(argv: Sequence[str] | None = None) -> float:
    """Measure and print; return the ratio."""
    quick = arguments(__doc__ or "", argv).quick
    duration_s, rounds = (2.0, 1) if quick else (120.0, 7)
    mission = load_mission(SURVEILLANCE, {"backend": "pybullet", "duration_s": duration_s})
    tape = record(mission, "pybullet")
    replay(tape, verify=True)
    sides = {
        "bare": lambda: replay(tape),
        "stack": lambda: run_mission(mission).result.wall_s,
    }
    times = in_turns(sides, rounds)
    bare_s, stack_s = min(times["bare"]), min(times["stack"])
    ratio = stack_s / bare_s
    tick_us = 1e6 / tape.ticks
    rows = [
        Row("bare PyBullet world", f"{bare_s * tick_us:.0f} us/tick"),
        Row("stack with everything on", f"{stack_s * tick_us:.0f} us/tick", ratio, f"<= {GOAL}", ratio <= GOAL),
    ]
    show("Cost of the stack", rows, f"{tape.ticks} ticks, two robots, BIT*; least of {rounds} rounds.")
    return ratio


if __name__ == "__main__":
    main()
