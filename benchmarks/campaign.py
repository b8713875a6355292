"""What a campaign costs besides its runs, and what a second worker is worth.

    python benchmarks/campaign.py [--seconds S] [--runs N] [--rounds N] [--quick]

Overhead: the processor time of a campaign with one worker, its start and its store included, over that of the same runs
made one after the other in this process. Two workers: the wall time with one over that with two. The first hardly
depends on what else the machine does; of the second it is most, and a second worker is worth nothing where no second
core is idle. The load is shown; medians of the rounds.
"""

from __future__ import annotations

import argparse
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


def bare_s(campaign: Campaign) -> float:
    """Return the processor time of the same runs in this process."""
    used_s = processor_s()
    for part in campaign.parts.values():
        for job in campaign.jobs(part):
            carry_out(job, lambda: False)
    return processor_s() - used_s


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
    overhead, worth = [], []
    with tempfile.TemporaryDirectory() as folder:
        campaign = planned(Path(folder), duration_s, given.runs)
        for _ in range(given.rounds):
            runs_s = bare_s(campaign)
            one_s, used_s = campaign_s(campaign, 1)
            two_s, _ = campaign_s(campaign, 2)
            overhead.append(used_s / runs_s - 1.0)
            worth.append(one_s / two_s)
            print(
                f"{given.runs} runs of {runs_s / given.runs:.1f} s: overhead {overhead[-1]:.1%}, two workers "
                f"{worth[-1]:.2f} times one; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
                flush=True,
            )
    print(
        f"ratios, medians: overhead {statistics.median(overhead):.1%}, "
        f"two workers {statistics.median(worth):.2f} times one"
    )


if __name__ == "__main__":
    main()
