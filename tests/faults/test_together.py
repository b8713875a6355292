"""Declared faults at once: whatever they do together keeps within what the robot promises then."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import assume, example, given
from hypothesis import strategies as st

from soter.rta import SpeedBound
from soter.sdk import Controller, Waypoint
from tests.faults.bench import TICK_S, Bench

V_MAX = 0.22
SPEED = SpeedBound(V_MAX, 1.0)

spans_s = st.sampled_from([0.0, 0.01, 0.03, 0.05, 0.07, 0.1, 0.15])
parts = st.sampled_from([0.0, 0.3, 0.7, 1.0])


@st.composite
def windows(draw: st.DrawFn, ends: bool = False) -> dict[str, float]:
    """When a fault is on: always, once, or again and again, with gaps that no reading need fall into."""
    window: dict[str, float] = {"start_s": draw(st.sampled_from([0.0, 0.03, 0.2, 0.5]))}
    if ends or draw(st.booleans()):
        window["duration_s"] = draw(st.sampled_from([0.02, 0.05, 0.08, 0.15, 0.2]))
        if draw(st.booleans()):
            window["every_s"] = window["duration_s"] + draw(st.sampled_from([0.01, 0.03, 0.05, 0.1, 0.4]))
    return window


@st.composite
def faults(draw: st.DrawFn) -> dict[str, Any]:
    """One declared fault of commands or samples."""
    kind = draw(st.sampled_from(["delay", "loss", "duplicate", "freeze", "bias", "clock_step"]))
    table: dict[str, Any] = {"kind": kind, **draw(windows(ends=kind == "freeze"))}
    if kind == "delay":
        late = draw(st.tuples(spans_s, spans_s, spans_s).filter(any))
        table |= dict(zip(("commands_s", "samples_s", "jitter_s"), late, strict=True))
    elif kind in ("loss", "duplicate"):
        table |= dict(zip(("commands", "samples"), draw(st.tuples(parts, parts).filter(any)), strict=True))
        table |= {"burst": draw(st.integers(1, 3))} if kind == "loss" else {"after_s": draw(spans_s)}
    elif kind == "freeze":
        table["restamped"] = draw(st.booleans())
    elif kind == "bias":
        table |= {"x_m": draw(st.sampled_from([-0.1, 0.05])), "heading_rad": draw(st.sampled_from([0.0, 0.3]))}
    else:
        table["step_s"] = draw(st.sampled_from([-0.2, -0.05, -0.03, 0.03, 0.05, 0.09]))
    return table


LOSS, TWICE = {"kind": "loss", "samples": 1.0}, {"kind": "duplicate", "samples": 1.0}
FROZEN = {"kind": "freeze", "duration_s": 0.05, "every_s": 0.06}
LATE = {"kind": "delay", "samples_s": 0.1, "start_s": 0.5, "duration_s": 0.05, "every_s": 0.15}


@given(
    st.lists(faults(), min_size=1, max_size=3), st.lists(st.sampled_from([-1.0, 0.0, 1.0]), min_size=1, max_size=8),
    st.integers(0, 99),
)  # fmt: skip
@example([LOSS, TWICE], [1.0], 0)
@example([TWICE, {**LOSS, "burst": 2}, LOSS], [1.0], 0)
@example([{"kind": "delay", "jitter_s": 0.1}, LOSS], [1.0], 3)
@example([FROZEN, LOSS], [1.0], 0)
@example([LATE, LOSS], [1.0], 0)
@example([{**LOSS, "burst": 3}, {"kind": "freeze", "restamped": True, "start_s": 0.4, "duration_s": 0.25}], [1.0], 0)
def test_whatever_declared_faults_do_together_has_been_promised(
    tables: list[dict[str, Any]], ways: list[float], seed: int
) -> None:
    # Of clocks that are farther ahead than samples are believed nothing is promised; they are refused.
    assume(sum(max(0.0, table.get("step_s", 0.0)) for table in tables) < 0.099)
    bench = Bench(*tables, seed=seed)
    promised, exact = bench.robot.capabilities, bench.behind.capabilities
    latency_s, noise_m = promised.latency_s - exact.latency_s, promised.position_noise_m
    assert promised.widened_beyond(bench.robot.declared) is None
    # Where the robot is, at every reading; it turns about as it likes.
    places = [0.0]
    sent: list[tuple[float, Waypoint]] = []
    before = bench.robot.read_state()
    for tick in range(1, 60):
        places.append(places[-1] + V_MAX * TICK_S * ways[tick // 5 % len(ways)])
        sample = bench.look(tick * TICK_S, x_m=places[-1])
        assert sample.age_s(bench.now_s) <= promised.sample_age_s + 1e-9, "A4"
        assert sample.stamp_s >= before.stamp_s, "A15"
        # Where it was at the time of the stamp, which may lie between two readings, or be ahead.
        at = sample.stamp_s / TICK_S
        low = min(max(math.floor(at + 1e-9), 0), tick)
        part = min(max(at - low, 0.0), 1.0) if low < tick else 0.0
        true_m = places[low] + part * (places[min(low + 1, tick)] - places[low])
        assert abs(sample.x_m - true_m) <= noise_m + 1e-9, "A6"
        assert SPEED.admits(before, sample, noise_m), "A1"
        before = sample
        target = Waypoint(float(tick), 0.0)
        bench.robot.goto(target, Controller.SC)
        sent.append((bench.now_s, target))
        bench.run(bench.now_s + 1e-6)
        arrived = {round(goal.target.x_m) for goal in bench.behind.sent}
        for since_s, due in sent:
            if since_s + latency_s <= bench.now_s:
                # Biased robots are sent elsewhere, by less than the half of what targets differ by.
                assert round(due.x_m) in arrived, "A3"
        sent = [(since_s, due) for since_s, due in sent if since_s + latency_s > bench.now_s]
