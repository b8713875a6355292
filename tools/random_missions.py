"""Draws configurations over everything that a mission file can say, runs and judges them, shrinks what fails.

Finished runs are kept, one line each, so that it can be stopped with Ctrl-C and carried on by the same command. A
change of the code begins it anew, because what was measured then is something else. Exit code 1 says that something
accepted went wrong, or that too little was accepted.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from tools.acceptance.store import ROOT
from tools.generator.campaign import Campaign, summary, verdict
from tools.generator.drawing import draw
from tools.generator.running import LIMIT_S, Outcome
from tools.generator.shrinking import shrink

FOLDER = ROOT / "out" / "random"


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the command line's arguments."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", metavar="N", type=int, default=200, help="how many configurations (default: 200)")
    parser.add_argument("--seed", metavar="S", type=int, default=1, help="the first one's seed (default: 1)")
    parser.add_argument("--jobs", metavar="J", type=int, default=1, help="runs at a time (default: 1)")
    parser.add_argument("--out", metavar="FOLDER", type=Path, default=FOLDER, help="where finished runs are kept")
    parser.add_argument(
        "--engine", choices=("kinematic", "pybullet"), default="kinematic", help="what moves the robots"
    )
    parser.add_argument("--duration", metavar="SECONDS", type=float, help="of each run, in place of what is drawn")
    parser.add_argument("--limit", metavar="SECONDS", type=float, default=LIMIT_S, help="host time for one run")
    parser.add_argument("--write", metavar="SEED", type=int, help="only write the files of one seed, into FOLDER/SEED")
    parser.add_argument("--shrink", metavar="SEED", type=int, help="only make one seed smaller, into FOLDER/SEED-small")
    given = parser.parse_args(argv)
    for name in ("count", "jobs"):
        if getattr(given, name) < 1:
            parser.error(f"--{name} is {getattr(given, name)}, allowed: at least 1")
    return given


def run(given: argparse.Namespace) -> int:
    """Run what is missing and sum up."""
    campaign = Campaign(given.out, given.engine, given.duration, given.limit)
    seeds = range(given.seed, given.seed + given.count)
    left = sum(seed not in campaign.outcomes for seed in seeds)
    began_s, done = time.monotonic(), 0

    def said(seed: int, outcome: Outcome) -> None:
        nonlocal done
        done += 1
        rest_s = (time.monotonic() - began_s) / done * (left - done)
        words = ", ".join(outcome.failures) or outcome.group or "kept every rule"
        print(f"{done}/{left}  {seed}: {outcome.status}, {words}  ({rest_s / 60.0:.0f} min left)", flush=True)

    try:
        campaign.run(seeds, given.jobs, said)
    except KeyboardInterrupt:
        print("stopped; finished runs are kept, the same command carries on", file=sys.stderr)
        return 130
    outcomes = {seed: campaign.outcomes[seed] for seed in seeds}
    print("\n".join(summary(outcomes)))
    wrong = verdict(outcomes)
    print("\n".join(wrong), file=sys.stderr)
    return 1 if wrong else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit code: 0 if all is well, 1 if not, 130 after Ctrl-C."""
    given = parse(argv)
    if given.write is not None:
        print(draw(given.write, given.engine).write(given.out / str(given.write)))
        return 0
    if given.shrink is not None:
        return shrink(given.shrink, given.engine, given.out / f"{given.shrink}-small", given.limit, given.duration)
    return run(given)


if __name__ == "__main__":
    # Whoever ends it, its runs end too; and shells take Ctrl-C away from what they start in the background.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    sys.exit(main())
