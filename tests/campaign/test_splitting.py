"""Importance splitting: unbiased where the answer is known, the same however it is run, and repeatable."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from random import Random
from statistics import fmean, stdev
from typing import Any

import pytest

from soter.campaign.again import job_of
from soter.campaign.intervals import proportion
from soter.campaign.job import Done, Job, carry_out
from soter.campaign.plan import Campaign, load_campaign
from soter.campaign.session import run_campaign
from soter.campaign.splitting import BRANCHED, Branch, Repetition
from soter.campaign.store import RunRow, Store
from soter.campaign.summary import groups, judge
from tests.campaign.here import Here, campaign
from tests.campaign.stores import same
from tests.project.source import ROOT

STEPS = 60
LOSSY = {"kind": "loss", "commands": 0.4, "burst": 0, "resend": False, "declared": False}


def walk(
    seed: str, reseeds: list[tuple[float, int]], height: int, steps: Sequence[int] = (1, -1), kept: int = 0
) -> list[list[float]]:
    """How far a walk stays below a height: its margin falls by whole numbers, with many ties.

    One of `kept` steps is drawn from what is never reseeded, as targets are; none for 0.
    """
    random, always, at, falls = Random(seed), Random(f"{seed}, kept"), 0, [[0.0, height - 0.5]]
    later = [*reseeds]
    for step in range(STEPS):
        while later and later[0][0] <= step:
            random = Random(f"{seed}, {later.pop(0)[1]}")
        drawn = always if kept and step % kept == 0 else random
        at += steps[int(drawn.random() * len(steps))]
        if height - at - 0.5 < falls[-1][1]:
            falls.append([step + 1.0, height - at - 0.5])
    return falls


def reaches(height: int, steps: Sequence[int] = (1, -1)) -> float:
    """How likely such a walk ever gets to a height, by where it may be after each step."""
    at, there = {0: 1.0}, 0.0
    for _ in range(STEPS):
        after: dict[int, float] = defaultdict(float)
        for place, step in product(at, steps):
            after[place + step] += at[place] / len(steps)
        there += sum(after.pop(place) for place in [*after] if place >= height)
        at = after
    return there


def estimates(height: int, replicas: int, count: int, *how: Any) -> tuple[list[float], int]:
    """Return estimates, and how many walks they took."""
    found, walks = [], 0
    for number in range(count):
        repetition, told = Repetition(replicas, 0.0, Random(number)), 0
        while repetition.estimate is None:
            branch = repetition.runs[told]
            repetition.tell(told, walk(f"{number}, {branch.root}", [*branch.reseeds], height, *how))
            told += 1
        found.append(repetition.estimate)
        walks += told
    return found, walks


@pytest.mark.parametrize(
    ("height", "steps", "kept"),
    [
        pytest.param(10, (1, -1), 0, id="many are equally near"),
        pytest.param(10, (1, -1), 3, id="a third is never drawn anew"),
        pytest.param(28, (-1, -1, -1, 4), 3, id="past several levels in one tick"),
    ],
)
def test_the_probability_of_a_walk_is_what_it_is(height: int, steps: tuple[int, ...], kept: int) -> None:
    found, _ = estimates(height, 7, 400, steps, kept)
    exact, error = reaches(height, steps), stdev(found) / 400.0**0.5
    assert abs(fmean(found) - exact) < 3.0 * error < 0.2 * exact


def test_what_is_rare_needs_far_fewer_walks() -> None:
    found, walks = estimates(24, 25, 80)
    exact, error = reaches(24), stdev(found) / 80.0**0.5
    assert exact == pytest.approx(0.00187, rel=0.01)
    assert abs(fmean(found) - exact) < 3.0 * error
    assert exact * (1.0 - exact) / error**2 > 3.0 * walks, "plain walks would need three times as many"


def test_what_cannot_be_reached_has_the_bound_of_plain_runs(tmp_path: Path) -> None:
    result = {"duration_s": 1.0, "robots": 1, "falls": [[0.0, 1.0]]}
    read, store = split(tmp_path, workers=Here(carry=lambda job: Done("done", result=result)))
    words, _ = judged(read, store)
    assert words.startswith(f"0 of runs (0 to {proportion(0, 20)[1]:.3g})")
    assert "0 of 5 repetitions got there; the interval is that of the plain runs: 0 of 20" in words


def stepped(height: int) -> Any:
    def carry(job: Job) -> Done:
        reseeds = [(each["at_s"], each["seed"]) for each in job.settings.get("reseed", ())]
        falls = walk(str(job.seed), reseeds, height)
        return Done("done", result={"duration_s": 1800.0, "robots": 2, "falls": falls})

    return carry


def split(
    folder: Path,
    name: str = "kept",
    height: int = 8,
    workers: Here | None = None,
    stop: Any = lambda: False,
    **table: Any,
) -> tuple[Campaign, Path]:
    part = {
        "set": {"fault": [LOSSY]},
        "seeds": {"count": 20},
        "split": {"rule": "collision", "repetitions": 5, **table},
    }
    read = campaign(folder, part)
    with Store(folder / f"{name}.sqlite", write=True) as store:
        store.describe({"sources": read.sources, "path": str(read.path)})
        run_campaign(read, store, workers or Here(carry=stepped(height)), stop=stop)
    return read, folder / f"{name}.sqlite"


def judged(read: Campaign, store: Path) -> tuple[str, bool]:
    with Store(store) as kept:
        (found,) = judge(read, kept)["p0"]
    return found.found, found.holds


def rows(store: Path) -> list[RunRow]:
    with Store(store) as kept:
        return [*kept.rows()]


def test_it_is_the_same_with_more_workers_and_when_it_is_carried_on(tmp_path: Path) -> None:
    looks = 0

    def stop() -> bool:
        nonlocal looks
        looks += 1
        return looks > 30

    _, one = split(tmp_path, "one")
    _, many = split(tmp_path, "many", workers=Here(7, stepped(8)))
    read, stopped = split(tmp_path, "stopped", stop=stop)
    assert (len(rows(stopped)), judged(read, stopped)) == (30, ("0 of 5 repetitions have an end", False))
    split(tmp_path, "stopped", workers=(again := Here(carry=stepped(8))))
    stores = [same(path) for path in (one, many, stopped)]
    assert stores[0] == stores[1] == stores[2]
    assert len(again.carried) == len(stores[0]) - 30


def test_the_share_that_is_allowed_is_held_against_the_upper_end(tmp_path: Path) -> None:
    read, store = split(tmp_path, at_most=0.9)
    words, holds = judged(read, store)
    share, low, high = (float(each) for each in re.findall(r"[\d.e-]+", words)[:3])
    assert low < reaches(8) < high < 0.9
    assert holds
    assert f"{share:.3g} per robot-hour" in words, "a run is a robot-hour"
    assert not judged(*split(tmp_path, at_most=0.2))[1]


def test_runs_that_branch_say_nothing_of_rates(tmp_path: Path) -> None:
    _, store = split(tmp_path)
    plain, branched = groups(rows(store))
    assert (len(plain.rows), plain.branched, branched.branched) == (20, False, True)
    assert branched.axes == BRANCHED
    assert branched.rate("violations") is None


def test_a_repetition_with_runs_that_do_not_fit_has_no_end() -> None:
    lacking = Repetition(2, 0.0, Random(1))
    lacking.tell(0, ())
    lacking.tell(1, [[1.0, 0.5]])
    assert (lacking.estimate, "no such margin" in lacking.void) == (None, True)
    other = Repetition(2, 0.0, Random(1))
    other.tell(0, [[1.0, 5.0]])
    other.tell(1, [[1.0, 4.0], [2.0, 3.0]])
    assert other.runs[2] == Branch(1, other.runs[2].reseeds, [[1.0, 4.0]])
    other.tell(2, [[1.0, 4.5], [2.0, -1.0]])
    assert "does not repeat" in other.void
    other.tell(9, [[1.0, -1.0]])
    assert "another plan" in other.void


def test_real_runs_branch_from_others_are_made_again_and_agree_with_plain_ones(tmp_path: Path) -> None:
    """Of 600 plain runs of other seeds, 340 fell below the value."""
    rare = load_campaign(ROOT / "examples" / "campaigns" / "rare.toml").parts["drift"]
    part = {
        "mission": str(ROOT / "examples" / "missions" / "waypoints.toml"), "set": {**rare.set, "duration_s": 15.0},
        "seeds": {"count": 30}, "split": {"rule": "geofence", "below": 0.2, "repetitions": 5},
    }  # fmt: skip
    read = campaign(tmp_path, part)
    with Store(tmp_path / "kept.sqlite", write=True) as store:
        store.describe({"sources": read.sources, "path": str(read.path)})
        run_campaign(read, store, Here())
        branches = [row for row in store.rows() if row.axes == BRANCHED]
        assert "--set 'reseed=[{ at_s = " in branches[-1].command
        done = carry_out(job_of(store, branches[-1]), lambda: False)
    words, _ = judged(read, tmp_path / "kept.sqlite")
    _, low, high = (float(each) for each in re.findall(r"[\d.e-]+", words)[:3])
    assert low < 340 / 600 < high < 1.0
    assert "5 of 5 repetitions got there; plain runs" in words
    assert done.result == branches[-1].result
    assert len({row.trace_sha256 for row in branches}) == len(branches)
