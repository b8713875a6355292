"""How the cost of a robot grows with the number of robots: 2 to 64 of them, each with 15 square metres to itself.

The workspaces are square, each robot with a charger and a box in a cell of its own; targets are drawn from all over.
Kinematic engine, straight-line planner, all safety modules. Few robots run several seeds, so that every size is
measured over as many robots.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.common import Row, arguments, in_turns, show
from soter.config import load_mission
from soter.runner import run_mission

AREA_M2 = 15.0
SIZES = (2, 8, 16, 32, 64)
GOAL = 1.5
BATTERY_S = 36000.0
"""So long a battery lasts: the more robots, the longer each may have to wait on its way home."""

_CHARGER_M = 0.2
_BOX_M = 0.25
_BOX_NORTH_M = 1.2


def workspace_xml(robots: int) -> str:
    """Return a workspace file for so many robots."""
    side_m = math.sqrt(AREA_M2 * robots)
    columns = math.ceil(math.sqrt(robots))
    cell_x_m, cell_y_m = side_m / columns, side_m / math.ceil(robots / columns)
    centres = [((k % columns + 0.5) * cell_x_m, (k // columns + 0.5) * cell_y_m) for k in range(robots)]
    starts = [
        f'<robot id="{number}"><start x="{x:.3f}" y="{y:.3f}" z="0"/></robot>'
        for number, (x, y) in enumerate(centres, start=1)
    ]
    return "\n".join((
        "<configuration>", f'<dimension x="{side_m:.3f}" y="{side_m:.3f}" z="3"/>',
        "<robots>", *starts, "</robots>",
        "<obstacles>", *(_box(x, y + _BOX_NORTH_M, _BOX_M, 1.0) for x, y in centres), "</obstacles>",
        "<charging_stations>", *(_box(x, y, _CHARGER_M, 0.0) for x, y in centres), "</charging_stations>",
        "</configuration>",
    ))  # fmt: skip


def _box(x: float, y: float, half_m: float, height_m: float) -> str:
    low = f'<low x="{x - half_m:.3f}" y="{y - half_m:.3f}" z="0"/>'
    return f'<box>{low}<high x="{x + half_m:.3f}" y="{y + half_m:.3f}" z="{height_m:g}"/></box>'


def mission_file(folder: Path, robots: int) -> Path:
    """Write a mission for so many robots and return its path."""
    (folder / f"{robots}.xml").write_text(workspace_xml(robots))
    path = folder / f"{robots}.toml"
    path.write_text(
        f'workspace = "{robots}.xml"\nbackend = "kinematic"\nplanner = "straight-line"\ntargets = "uniform"\n'
        f"battery.drive_s = {BATTERY_S}\nbattery.idle_s = {4.0 * BATTERY_S}\n"
    )
    return path


def cost_us(path: Path, robots: int, duration_s: float, seeds: int, setup_s: dict[int, float]) -> float:
    """Return the host time that one second of one robot takes, in microseconds.

    Args:
        path: the mission.
        robots: how many it has.
        duration_s: how long a run is.
        seeds: how many runs.
        setup_s: takes the least time that opening and closing a mission of so many robots took.
    """
    wall_s = 0.0
    for seed in range(1, seeds + 1):
        start_s = time.perf_counter()
        result = run_mission(load_mission(path, {"duration_s": duration_s, "seed": seed})).result
        if result.status != "completed":
            raise RuntimeError(f"{robots} robots: the run {result.status}: {result.failure}")
        wall_s += result.wall_s
        around_s = time.perf_counter() - start_s - result.wall_s
        setup_s[robots] = min(around_s, setup_s.get(robots, math.inf))
    return wall_s / (robots * duration_s * seeds) * 1e6


def main(argv: Sequence[str] | None = None) -> float:
    """Measure and print; return the cost with the most robots over that with the fewest."""
    quick = arguments(__doc__ or "", argv).quick
    sizes, duration_s, rounds = ((2, 8), 1.0, 1) if quick else (SIZES, 120.0, 3)
    setup_s: dict[int, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        sides = {}
        for robots in sizes:
            seeds = 1 if quick else max(1, 16 // robots)
            path = mission_file(Path(folder), robots)
            sides[str(robots)] = partial(cost_us, path, robots, duration_s, seeds, setup_s)
        times = in_turns(sides, rounds)
    costs = {name: min(each) for name, each in times.items()}
    fewest, most = str(sizes[0]), str(sizes[-1])
    # The two ends of one round share its weather, so the median over rounds is less noisy than two minima.
    ratio = statistics.median(large / small for small, large in zip(times[fewest], times[most], strict=True))
    rows = [Row(f"{fewest} robots", f"{costs[fewest]:.0f} us/robot-s")]
    rows += [
        Row(f"{name} robots", f"{cost:.0f} us/robot-s", cost / costs[fewest])
        for name, cost in costs.items()
        if name not in {fewest, most}
    ]
    rows.append(Row(f"{most} robots", f"{costs[most]:.0f} us/robot-s", ratio, f"<= {GOAL}", ratio <= GOAL))
    setting_up = ", ".join(f"{robots} robots {seconds:.2g} s" for robots, seconds in setup_s.items())
    show(
        "Cost of one robot for one second",
        rows,
        f"{duration_s:g} s each; least, and median ratio, of {rounds} rounds. Setting up, not included: {setting_up}.",
    )
    return ratio


if __name__ == "__main__":
    main()
