"""When SOTER saw what happened to a real vehicle, and how far off its estimate was until then, by the run's recording.

A recording has the host's time of day of every tick, which the supervisor's process reads once that tick is decided.
The tests read the same clock of the same host when they let something happen, so that both are right to one tick.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from soter.record.content import RecordedTick
from soter.record.reader import Recording

LASTS_S: Final = 1.0
"""A sample that a busy host holds up is late for less than this."""


@dataclass(frozen=True)
class Seen:
    """What became of one robot after something happened to it; NaN for what did not.

    Attributes:
        after_s: until it was nobody's, or its samples were older than is promised, and stayed so for `LASTS_S`. Either
            takes its AC from it.
        nobodys_after_s: until it was nobody's. One that has fallen silent is so only after 3 s.
        off_m: how far at most its position was from the truth in this time, by the samples that were used.
        top_m_s: how fast at most it was, by the truth, once it was no longer nobody's.
    """

    after_s: float = math.nan
    nobodys_after_s: float = math.nan
    off_m: float = math.nan
    top_m_s: float = math.nan


def seen(
    recording: Path,
    result: dict[str, Any],
    robot_id: int,
    happened_s: float,
    path: Sequence[tuple[float, float, float, float]],
    sample_age_s: float,
) -> Seen:
    """Look for what SOTER saw.

    Args:
        recording: of the whole run.
        result: of the same run.
        robot_id: to which it happened.
        happened_s: when, by `time.time()`.
        path: where the robot really was, by the same clock: time, x_m, y_m, v_m_s.
        sample_age_s: what is promised.
    """
    ticks = [each for each in Recording(recording).ticks() if robot_id in each.robots]
    lost = result["uncontrolled"].get(str(robot_id))
    # Both are the fleet time of the tick; the result's is rounded to a microsecond.
    nobodys = next((each.host_ns for each in ticks if lost and each.time_s > lost["first_s"] - 1e-5), math.nan)
    nobodys_s = nobodys * 1e-9
    after_s = min(
        (each for each in (nobodys_s, _silent_since_s(ticks, robot_id, happened_s, sample_age_s)) if each == each),
        default=math.nan,
    )
    off_m = max((
        _off_m(path, each, robot_id) for each in ticks if happened_s <= each.host_ns * 1e-9 <= after_s
    ), default=math.nan)  # fmt: skip
    back_s = nobodys_s + lost["lasted_s"] if lost else math.nan
    top_m_s = max((abs(v_m_s) for at_s, _, _, v_m_s in path if at_s > back_s), default=math.nan)
    return Seen(after_s - happened_s, nobodys_s - happened_s, off_m, top_m_s)


def _silent_since_s(ticks: Sequence[RecordedTick], robot_id: int, happened_s: float, sample_age_s: float) -> float:
    since_s = math.nan
    for each in ticks:
        now_s, age_s = each.host_ns * 1e-9, each.time_s - each.robots[robot_id].state.stamp_s
        if now_s < happened_s or age_s <= sample_age_s:
            since_s = math.nan
        elif math.isnan(since_s):
            since_s = now_s
        if now_s - since_s >= LASTS_S:
            return since_s
    return math.nan


def _off_m(path: Sequence[tuple[float, float, float, float]], tick: RecordedTick, robot_id: int) -> float:
    """Return how far a tick's sample is from where the robot was at its stamp, by the truth before and after."""
    state = tick.robots[robot_id].state
    then_s = tick.host_ns * 1e-9 - (tick.time_s - state.stamp_s)
    later = min(max(bisect_left(path, (then_s,)), 1), len(path) - 1)
    (before_s, *before, _), (after_s, *after, _) = path[later - 1], path[later]
    part = min(max((then_s - before_s) / max(after_s - before_s, 1e-9), 0.0), 1.0)
    return math.dist(
        (state.x_m, state.y_m), [(1.0 - part) * old + part * new for old, new in zip(before, after, strict=True)]
    )
