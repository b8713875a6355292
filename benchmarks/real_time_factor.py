"""How much faster than real time a mission runs on the kinematic engine, and how much faster the bare world would.

Two robots, all safety modules, with the straight-line planner and with BIT*.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from benchmarks.replay import record, replay
from soter.config import MissionFile, load_mission
from soter.runner import run_mission

GOALS = {"straight-line": 400.0, "ompl-bitstar": 250.0}


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure and print; return the real-time factors by planner."""
    quick = arguments(__doc__ or "", argv).quick
    duration_s, rounds = (5.0, 1) if quick else (600.0, 5)
    rows: list[Row] = []
    factors = {}
    for planner, goal in GOALS.items():
        mission = load_mission(SURVEILLANCE, {"backend": "kinematic", "planner": planner, "duration_s": duration_s})
        tape = record(mission, "kinematic")
        replay(tape, verify=True)
        times = in_turns({"bare": partial(replay, tape), "stack": partial(_wall_s, mission)}, rounds)
        bare, stack = (duration_s / min(times[side]) for side in ("bare", "stack"))
        factors[planner] = stack
        rows.append(Row(f"bare kinematic world, as driven with {planner}", f"{bare:.0f} x real time"))
        rows.append(Row(f"mission with {planner}", f"{stack:.0f} x real time", bare / stack))
        rows.append(Row("  against real time", f"{stack:.0f} x real time", stack, f">= {goal:g}", stack >= goal))
    show("Real-time factor", rows, f"{duration_s:g} s of two robots; least of {rounds} rounds.")
    return factors


def _wall_s(mission: MissionFile) -> float:
    return run_mission(mission).result.wall_s


if __name__ == "__main__":
    main()
