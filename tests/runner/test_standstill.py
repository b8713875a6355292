"""Robots that get nowhere are in the result: without their AC for long, for good, or without ever having moved."""

from __future__ import annotations

import math
from itertools import accumulate
from types import SimpleNamespace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from soter.config import load_mission
from soter.runner import run_mission
from soter.runner.metrics import STALL_S, Standstill, Standstills
from tests.project.source import ROOT

STEP_S = 10.0
SPELLS = st.lists(
    st.tuples(st.sampled_from(["AC", "SC", "charging", "full", "failed"]), st.integers(1, 60)), min_size=1, max_size=8
)


def robot(who: str) -> Any:
    """As much of a supervisor as is looked at."""
    own = SimpleNamespace(x_m=0.0, y_m=0.0, battery={"charging": 0.5, "full": 1.0}.get(who))
    driver = None if who == "AC" else SimpleNamespace(name="battery", cause=f"{who} it is")
    return SimpleNamespace(situation=SimpleNamespace(own=own), driver=driver, ac_failure=who == "failed")


@given(SPELLS)
def test_a_stall_is_any_time_of_so_long_without_the_ac_and_not_charging(spells: list[tuple[str, int]]) -> None:
    states = [who for who, count in spells for _ in range(count)]
    watched, now_s = Standstill(1), 0.0
    for at, who in enumerate(states):
        now_s = at * STEP_S
        watched.look(now_s, robot(who), charging=who in ("charging", "full"))
    # The same, from the whole of it.
    stuck = [who in ("SC", "full") for who in states]
    lengths = [*accumulate(stuck, lambda before, this: (before + 1) * this)]
    longest_s = max(0, *lengths) * STEP_S - STEP_S if any(stuck) else 0.0
    assert watched.longest_s == longest_s
    ends = [at for at, length in enumerate(lengths) if length and (at + 1 == len(lengths) or not lengths[at + 1])]
    expected = [
        ((at - lengths[at] + 1) * STEP_S, None if at + 1 == len(states) else (at + 1) * STEP_S)
        for at in ends
        if (lengths[at] - 1) * STEP_S >= STALL_S
    ]
    assert [(each.start_s, each.end_s) for each in watched.stalls] == expected


def test_the_stalls_that_go_on_at_the_end_are_the_permanent_ones() -> None:
    found = Standstills([1, 2])
    for step in range(100):
        found.robots[1].look(step * STEP_S, robot("SC" if step >= 20 else "AC"), charging=False)
        found.robots[2].look(step * STEP_S, robot("SC" if step < 90 else "AC"), charging=False)
    assert [each.robot_id for each in found.stalls()] == [1, 2]
    (stall,) = found.permanent(1000.0).values()
    assert (stall.since_s, stall.lasted_s, stall.module, stall.cause) == (200.0, 800.0, "battery", "SC it is")
    assert found.longest_s == 890.0
    assert found.never_moved(60.0) == ()
    assert found.never_moved(61.0) == (1, 2)


def test_a_run_names_robots_that_never_moved_and_none_that_did() -> None:
    def ran(ac: str, duration_s: float) -> Any:
        given = {"backend": "kinematic", "planner": "straight-line", "duration_s": duration_s, "ac": ac}
        return run_mission(load_mission(ROOT / "examples" / "surveillance.toml", given)).result

    assert ran("adversary:frozen", 61.0).never_moved == (1, 2)
    assert ran("adversary:frozen", 5.0).never_moved == ()
    busy = ran("mission", 61.0)
    assert (busy.never_moved, busy.permanent_stalls, busy.troubles) == ((), {}, [])
    assert math.isfinite(busy.longest_without_ac_s)
