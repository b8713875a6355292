"""From a decision to the first velocity at a robot's base, for robots behind a mux, over a bare message.

A robot is driven by its AC. At the decision the supervisor's thread hands it over to the SC, as a disengagement does.
The time ends with the first velocity at the base that is not the AC's; it has come through the mux, which is a process
of its own. In turns with that, a bare publisher of the same process sends a message of the same kind straight to the
same listener, which is a process of its own too. With load, as many more processes spin as there are cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from benchmarks.common import Row, load
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.runner.real_time import real_time
from soter.sdk import Controller, Robot, RobotSpec, Waypoint

_ROUNDS: Final = 300
_QUICK_ROUNDS: Final = 5

ROOM: Final = Workspace(20.0, 20.0, (), (RobotPlace(1, 10.0, 10.0, Box(0.0, 0.0, 20.0, 20.0)),))
SPECS: Final = [RobotSpec(1, 10.0, 10.0, 0.0)]

BASE: Final = "base"
BARE: Final = "bare"
"""What listeners call what they hear: `[name, time in s, forward, turn]` each, all of it printed as JSON in the end."""


def measure(
    robot: Robot, say_bare: Callable[[float], None], listener: subprocess.Popen[str], rounds: int
) -> tuple[list[float], list[float]]:
    """Return the times of so many decisions, and of so many bare messages, in milliseconds.

    Args:
        robot: ready to drive.
        say_bare: sends a bare message with that number in it.
        listener: a program that says "ready", and what it has heard when its input ends.
        rounds: how many.
    """
    assert listener.stdout is not None
    assert listener.stdout.readline() == "ready\n"
    clock = robot.clock
    decided: list[float] = []
    sent: list[float] = []

    def tick(ticks: int) -> None:
        for _ in range(ticks):
            clock.sleep_until(clock.now() + 0.05)
            robot.read_state()
            robot.renew_lease()

    tick(10)
    # As the supervisor of a run is, where the kernel allows it; the bare publisher is in the same process.
    with real_time(required=False):
        for number in range(rounds):
            robot.switch_ac_sc(Controller.AC, "benchmark")
            # To and fro, so that the AC always asks for something.
            robot.goto(Waypoint(10.0 + (3.0 if number % 2 else -3.0), 10.0), Controller.AC)
            tick(4)
            decided.append(time.monotonic())
            robot.switch_ac_sc(Controller.SC, "benchmark")
            tick(2)
            sent.append(time.monotonic())
            say_bare(float(number + 1))
            tick(1)
    # The listener may have waited for the processor: what came of the last decision is still to be heard.
    tick(20)
    said, _ = listener.communicate("", timeout=30.0)
    heard = json.loads(said)
    rests = [at_s for name, at_s, x, w in heard if name == BASE and x == 0.0 and w == 0.0]
    moved = [at_s for name, at_s, x, w in heard if name == BASE and (x != 0.0 or w != 0.0)]
    arrived = {round(x): at_s for name, at_s, x, _ in heard if name == BARE}
    # Only where the AC was really driving until then.
    driven = [at_s for at_s in decided if any(at_s - 0.05 < each <= at_s + 0.02 for each in moved)]
    found = [1e3 * (min(each for each in rests if each >= at_s) - at_s) for at_s in driven]
    return found, [1e3 * (arrived[number + 1] - at_s) for number, at_s in enumerate(sent) if number + 1 in arrived]


def measured_rows(measured: Callable[[int], tuple[list[float], list[float]]], *, quick: bool) -> list[Row]:
    """Measure without load and, unless it is to be quick, with load; return what to show.

    Args:
        measured: opens what is to be measured, and does so many rounds.
        quick: tiny sizes.
    """
    rows = []
    for name, processes in (("", 0),) if quick else (("", 0), (", with load", os.cpu_count() or 1)):
        with load(processes):
            decisions, messages = measured(_QUICK_ROUNDS if quick else _ROUNDS)
        p50, p99 = percentiles(decisions)
        bare50, bare99 = percentiles(messages)
        rows += [
            Row(f"bare message{name}, p50 / p99 of {len(messages)}", f"{bare50:.2f} / {bare99:.2f} ms"),
            Row(
                f"decision{name}, p50 / p99 of {len(decisions)}", f"{p50:.2f} / {p99:.2f} ms", p50 / bare50,
                "45 ms", p99 <= 45.0,
            ),
        ]  # fmt: skip
    return rows


def percentiles(times: Sequence[float]) -> tuple[float, float]:
    """Return the median, and what 99 of 100 stay below."""
    p50, p99 = np.percentile(times, (50, 99))
    return float(p50), float(p99)
