"""What a campaign costs besides its runs, and what a second worker is worth.

    python benchmarks/campaign.py [--seconds S] [--runs N] [--rounds N] [--quick]

Overhead: the processor time of a campaign with one worker, its start and its store included, over that of the same runs
made one after the other in this process. Two workers: the wall time with one over that with two; and beside it the same
of processes that make the runs and do nothing else, one and two of them. The first hardly depends on what else the
machine does. The second does: a second worker is worth nothing where no second core is idle, and no more than a second
such process anywhere. The load is shown; medians of the rounds.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from soter.campaign.job import carry_out
from soter.campaign.plan import Campaign, load_campaign
from soter.campaign.session import run_campaign
from soter.campaign.store import Store
from soter.campaign.workers import LocalWorkers
from soter.config import load_mission
from soter.runner import run_mission

MISSION = Path(__file__).parents[1] / "examples" / "surveillance.toml"
SETTINGS = {"backend": "kinematic", "planner": "straight-line"}
_TRIED_S = 200.0


def planned(folder: Path, duration_s: float, runs: int) -> Campaign:
    """Return a campaign of so many runs."""
    path = folder / "campaign.toml"
    lines = [f'mission = "{MISSION}"', f"seeds = {{ count = {runs} }}", "[set]", f"duration_s = {duration_s:.1f}"]
    lines += [f'{key} = "{value}"' for key, value in SETTINGS.items()]
    path.write_text("\n".join([*lines, "[[part]]", 'name = "runs"', ""]))
    return load_campaign(path)


def processor_s() -> float:
    """Return the processor time of this process and of those that have ended below it."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def campaign_s(campaign: Campaign, workers: int) -> tuple[float, float]:
    """Return the wall time and the processor time of a campaign."""
    began_s, used_s = time.perf_counter(), processor_s()
    with tempfile.TemporaryDirectory() as kept, Store(Path(kept) / "kept.sqlite", write=True) as store:
        run_campaign(campaign, store, LocalWorkers(workers))
    return time.perf_counter() - began_s, processor_s() - used_s


def make(campaign: Campaign, first: int = 0, every: int = 1) -> None:
    """Make a share of the runs of a campaign, and nothing else."""
    for part in campaign.parts.values():
        for job in [*campaign.jobs(part)][first::every]:
            carry_out(job, lambda: False)


def bare_s(campaign: Campaign) -> tuple[float, float]:
    """Return the wall time and the processor time of the same runs in this process."""
    began_s, used_s = time.perf_counter(), processor_s()
    make(campaign)
    return time.perf_counter() - began_s, processor_s() - used_s


def beside_s(campaign: Campaign) -> float:
    """Return the wall time of the same runs in two processes, each of which makes every second one."""
    began_s = time.perf_counter()
    context = multiprocessing.get_context("spawn")
    both = [context.Process(target=make, args=(campaign, first, 2)) for first in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join()
    return time.perf_counter() - began_s


def told(overhead: Sequence[float], worth: Sequence[float], at_most: Sequence[float]) -> str:
    """Return the medians in words."""
    return (
        f"overhead {statistics.median(overhead):.1%}, two workers {statistics.median(worth):.2f} times one, "
        f"two bare processes {statistics.median(at_most):.2f} times one"
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Print both ratios."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="processor time that a run is to take")
    parser.add_argument("--runs", type=int, default=4, help="runs of each campaign")
    parser.add_argument("--rounds", type=int, default=3, help="campaigns with one and with two workers, in turns")
    parser.add_argument("--quick", action="store_true", help="only show that it runs")
    given = parser.parse_args(argv)
    if given.quick:
        given.seconds, given.runs, given.rounds = 0.2, 2, 1
    used_s, tried_s = processor_s(), 5.0 if given.quick else _TRIED_S
    run_mission(load_mission(MISSION, {**SETTINGS, "duration_s": tried_s}))
    duration_s = given.seconds * tried_s / (processor_s() - used_s)
    overhead, worth, at_most = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        campaign = planned(Path(folder), duration_s, given.runs)
        for _ in range(given.rounds):
            bare_wall_s, runs_s = bare_s(campaign)
            one_s, used_s = campaign_s(campaign, 1)
            two_s, _ = campaign_s(campaign, 2)
            overhead.append(used_s / runs_s - 1.0)
            worth.append(one_s / two_s)
            at_most.append(bare_wall_s / beside_s(campaign))
            print(
                f"{given.runs} runs of {runs_s / given.runs:.1f} s: {told(overhead[-1:], worth[-1:], at_most[-1:])}; "
                f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
                flush=True,
            )
    print(f"ratios, medians: {told(overhead, worth, at_most)}")


if __name__ == "__main__":
    main()
