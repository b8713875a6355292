"""How many runs a search needs until it finds a violation, beside drawing at random from the same ranges.

    python benchmarks/search.py [--only PATTERN] [--tries N] [--jobs N]

The set-ups are those of examples/campaigns/search.toml, each tried with several seeds of the optimiser. What is counted
are runs, so that the machine has no say in it: their median over the tries, and all of them over the tries that found
something. The first hardly sees the tries that take long or find nothing, which is what a search is for.
"""

from __future__ import annotations

import argparse
import math
import statistics
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

from soter.campaign.plan import Campaign, load_campaign
from soter.campaign.session import run_campaign
from soter.campaign.store import Store
from soter.campaign.workers import LocalWorkers

CAMPAIGN = Path(__file__).parents[1] / "examples" / "campaigns" / "search.toml"


def runs_until_found(
    campaign: Campaign, name: str, by: str, seed: int, jobs: int, most: int | None
) -> tuple[int, bool]:
    """Return how many runs a search took, and whether it found what it looked for."""
    part = campaign.parts[name]
    assert part.search is not None
    search = part.search.model_copy(update={"by": by, "seed": seed, "runs": most or part.search.runs})
    tried = replace(campaign, parts={name: part.model_copy(update={"search": search})})
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "tried.sqlite", write=True) as store:
        totals = run_campaign(tried, store, LocalWorkers(jobs))
        *_, last = store.rows()
    margin = float(last.result["min_margin"][search.minimise.rpartition(".")[2]])
    return totals.planned, search.below is not None and margin < search.below


def runs_a_find(tries: Sequence[tuple[int, bool]]) -> float:
    """Return how many runs were made for each try that found something; infinite where none did."""
    finds = sum(hit for _, hit in tries)
    return sum(runs for runs, _ in tries) / finds if finds else math.inf


def main(argv: Sequence[str] | None = None) -> None:
    """Print a line for each set-up."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default="*", help="set-ups whose names match")
    parser.add_argument("--tries", type=int, default=5, help="seeds of the optimiser")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    parser.add_argument("--quick", action="store_true", help="only show that it runs")
    given = parser.parse_args(argv)
    if given.quick:
        given.only, given.tries = "brake*", 1
    campaign = load_campaign(CAMPAIGN, {"duration_s": 1.0} if given.quick else None)
    print(f"{'set-up':30} {'CMA-ES, runs':>24} {'at random, runs':>30}   ratios: of medians, of runs a find")
    for name in campaign.parts:
        if not fnmatch(name, given.only):
            continue
        found = {
            by: [
                runs_until_found(campaign, name, by, seed, given.jobs, 2 if given.quick else None)
                for seed in range(1, given.tries + 1)
            ]
            for by in ("cma", "random")
        }
        words = [" ".join(f"{'' if hit else '>'}{runs}" for runs, hit in each) for each in found.values()]
        medians = " : ".join(f"{statistics.median(runs for runs, _ in each):g}" for each in found.values())
        each_find = " : ".join(f"{runs_a_find(each):.1f}" for each in found.values())
        print(f"{name:30} {words[0]:>24} {words[1]:>30}   {medians}, {each_find}", flush=True)


if __name__ == "__main__":
    main()
