"""What large workspaces cost: each module's decision over that with three boxes, and a mission in an orchard.

Robots drive on and on, tick by tick, as they do in a run, so that what is worked out for new places counts, but for
what the drive itself has looked at, 0.3 m ahead: that counts in the missions. The world of many edges has half of them
in its fence, and half in what it keeps out; the map has rooms with furniture.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from statistics import median

import numpy as np

from benchmarks.common import ROOT, SURVEILLANCE, Row, arguments, in_turns, show
from benchmarks.decision import bound_modules, drive, judge_of
from soter.config import MissionFile, load_mission
from soter.geometry.cells import pack
from soter.geometry.draft import Draft, Outline, Spot, circle, site_of
from soter.geometry.grid import GridMap
from soter.geometry.workspace import Box, RobotPlace, Workspace, as_box
from soter.rta import DecisionModule, Situation
from soter.runner import run_mission
from soter.sdk import Controller

EDGES = 2000
CELLS = 4000
"""A side of the map."""

DRIVE_S = 14400.0
"""So long a battery lasts: return paths across the map are long."""

GOAL = 1.5
FACTORS = {"straight-line": 400.0, "ompl-bitstar": 250.0}
PATROL = ROOT / "examples" / "worlds" / "patrol.toml"


def of_edges(edges: int) -> Workspace:
    """Return a world in which half of so many edges are the fence's, and half those of round areas."""
    half, step_m = edges // 2, 3.5
    angles = [math.tau * each / half for each in range(half)]
    wide_m = step_m * (math.sqrt(edges / 20.0) / 2.0 + 1.0)
    far_m = [wide_m * (1.5 + 0.1 * math.sin(9.0 * angle)) for angle in angles]
    fence = [(far * math.cos(angle), far * math.sin(angle)) for far, angle in zip(far_m, angles, strict=True)]
    draft = Draft(f"{edges} edges", [Outline("fence", fence)])
    side = math.ceil(math.sqrt(half / 10.0))
    left = half
    for row, column in itertools.product(range(side), repeat=2):
        ring = circle((column - side / 2.0) * step_m, (row - side / 2.0) * step_m, 0.25, around=True)
        if (left := left - len(ring)) < 0:
            break
        draft.keep_outs.append(Outline(f"tree {len(draft.keep_outs)}", ring))
    draft.stations += [Spot("station 1", step_m / 2.0, step_m / 2.0), Spot("station 2", -step_m / 2.0, step_m / 2.0)]
    return site_of(draft, phi_safer_m=0.1, spacing_m=0.5)


def of_map(side: int) -> Workspace:
    """Return a map of so many cells of 5 cm a side: rooms of 10 m with doors, and furniture of any shape in them."""
    stream, room, cell_m = np.random.default_rng(1), 200, 0.05
    occupied = np.zeros((side, side), dtype=np.bool_)
    for wall in [*range(0, side, room), side - 3]:
        for lines in (occupied, occupied.T):
            lines[wall : wall + 3] = True
            for middle in range(room // 2, side, room):
                lines[wall : wall + 3, middle - 20 : middle + 20] = not 0 < wall < side - 3
    for row, column in stream.integers(0, side // 50, (side * side // 50_000, 2)) * 50 + 25:
        wide, deep = stream.integers(2, 12, 2)
        part = occupied[row - deep : row + deep, column - wide : column + wide]
        part |= stream.random(part.shape) < 0.7
    grid = GridMap(side, side, cell_m, 3.0, -4.0, 0.2, pack(occupied))
    draft = Draft("map", [Outline("edge of the map", grid.ring(0, 0, side, side))], map=grid)
    places = [grid.corner(room * (0.5 + each), room / 2) for each in (0, 1)]
    draft.stations += [Spot(f"station {each}", *at) for each, at in enumerate(places, start=1)]
    return site_of(draft, phi_safer_m=0.1, spacing_m=0.3)


def of_boxes() -> Workspace:
    """Return a rectangle of the same size with three boxes."""
    boxes = tuple(Box(x_m, x_m, x_m + 0.5, x_m + 0.5) for x_m in (12.0, 24.0, 36.0))
    places = [RobotPlace(each, 20.0 + 2.0 * each, 20.0, as_box(20.0 + 2.0 * each, 20.0, 0.5)) for each in (1, 2)]
    return Workspace(50.0, 50.0, boxes, tuple(places))


def one_drive(
    asked: dict[str, Callable[[Situation], object]], modules: Sequence[DecisionModule], views: Iterator[Situation],
    ticks: int,
) -> dict[str, float]:  # fmt: skip
    """Drive on for so many ticks; return the mean processor time of each module's decisions in microseconds."""
    drive, times = list(itertools.islice(views, ticks)), {}
    for module in modules:
        module.mode = Controller.AC
    for name, judge in asked.items():
        start_s = time.process_time()
        for view in drive:
            judge(view)
        times[name] = (time.process_time() - start_s) / ticks * 1e6
    return times


def decisions(shapes: Mapping[str, Workspace], ticks: int, rounds: int) -> dict[str, dict[str, float]]:
    """Return the time of each answer in microseconds, by what is asked and by workspace: the median of many drives.

    What binding took, once, is among them.
    """
    times: dict[str, dict[str, list[float]]] = {"binding": {}}
    with ExitStack() as stack:
        sides = {}
        for name, shape in shapes.items():
            start_s = time.process_time()
            workspace, modules = stack.enter_context(bound_modules(workspace=shape, drive_s=DRIVE_S))
            times["binding"][name] = [(time.process_time() - start_s) * 1e6]
            sides[name] = partial(
                one_drive, {each.name: judge_of(each) for each in modules}, modules, drive(workspace), ticks
            )
        for turn in range(rounds):
            for name in list(sides)[:: 1 if turn % 2 else -1]:
                for asked, us in sides[name]().items():
                    times.setdefault(asked, {}).setdefault(name, []).append(us)
    return {asked: {name: median(each) for name, each in sides.items()} for asked, sides in times.items()}


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure and print; return by module and world a decision's ratio, and by planner that of the missions' speeds."""
    quick = arguments(__doc__ or "", argv).quick
    edges, cells, ticks, rounds = (120, 400, 20, 2) if quick else (EDGES, CELLS, 1000, 15)
    large = {f"{edges} edges": of_edges(edges), f"{cells * cells} cells": of_map(cells)}
    measured = decisions({"three boxes": of_boxes(), **large}, ticks, rounds)
    rows, ratios = [Row(f"{name}, bound in", f"{us / 1e6:.2f} s") for name, us in measured.pop("binding").items()], {}
    for asked, us in measured.items():
        few_us = us.pop("three boxes")
        rows.append(Row(f"{asked}, three boxes", f"{few_us:.2f} us"))
        for name, many_us in us.items():
            ratio = ratios[f"{asked}, {name}"] = many_us / few_us
            rows.append(Row(f"{asked}, {name}", f"{many_us:.2f} us", ratio, f"<= {GOAL:g}", ratio <= GOAL))
    duration_s, turns = (1.0, 1) if quick else (600.0, 3)
    for planner, least in list(FACTORS.items())[: 1 if quick else None]:
        chosen = {"backend": "kinematic", "planner": planner, "duration_s": duration_s, "targets": "grid", "robots": 2}
        world = "l-hall.toml" if quick else "orchard.toml"
        missions = {
            "room": load_mission(SURVEILLANCE, chosen),
            world: load_mission(PATROL, {**chosen, "workspace": world}),
        }
        walls = in_turns({name: partial(_wall_s, mission) for name, mission in missions.items()}, turns)
        room, orchard = (duration_s / min(each) for each in walls.values())
        ratios[planner] = orchard / room
        rows.append(Row(f"mission in the room, {planner}", f"{room:.0f} x real time"))
        rows.append(
            Row(
                f"mission in {world}, {planner}",
                f"{orchard:.0f} x real time",
                orchard / room,
                f">= {least:g} x",
                orchard >= least,
            )
        )
    show("Large workspaces", rows, f"Medians of {rounds} drives of {ticks} ticks; least of {turns} missions.")
    return ratios


def _wall_s(mission: MissionFile) -> float:
    return run_mission(mission).result.wall_s


if __name__ == "__main__":
    main()
