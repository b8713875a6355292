"""Shrinks a configuration that fails for as long as it fails in the same way."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, Final

from soter.campaign.job import JUDGED, Done, Job
from soter.campaign.random.configuration import Configuration
from soter.campaign.random.drawing import draw
from soter.campaign.random.running import STUCK_S
from soter.campaign.workers import LocalWorkers
from soter.scratch import Scratch

_AFTER_S: Final = 10.0
_LEAST_S: Final = 20.0

LIMIT_S: Final = 600.0
"""Host time for one run."""

Run = Callable[[Configuration], Done]


def failures(done: Done) -> list[str]:
    """Return the failures of a run: the second judge's findings, or that it did not get to its end."""
    return [done.status] if done.status == "failed" else done.findings


def smaller(config: Configuration) -> Iterator[Configuration]:
    """Yield configurations with one part less, the largest parts first."""
    tables, room = config.tables, config.room
    for index in reversed(range(len(room.robots) if len(room.robots) > 1 else 0)):
        yield _without_robot(config, index)
    for index in reversed(range(len(tables.get("fault", ())))):
        faults = [fault for at, fault in enumerate(tables["fault"]) if at != index]
        rest = {key: value for key, value in tables.items() if key != "fault"}
        yield replace(config, tables={**rest, "fault": faults} if faults else rest)
    for index in reversed(range(len(room.boxes))):
        yield replace(config, room=replace(room, boxes=room.boxes[:index] + room.boxes[index + 1 :]))
    for path in _paths(tables):
        yield replace(config, tables=_without(tables, path))


def _paths(tables: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the keys that may be left out, whole tables before their keys."""
    for key, value in tables.items():
        if not above and key in ("seed", "duration_s", "backend", "backends", "fault"):
            continue
        yield (*above, key)
        if isinstance(value, Mapping):
            yield from _paths(value, (*above, key))


def _without(tables: Mapping[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = copy.deepcopy(dict(tables))
    table = found
    for key in path[:-1]:
        table = table[key]
    del table[path[-1]]
    return found


def _without_robot(config: Configuration, index: int) -> Configuration:
    """Return a configuration without one robot; the ids of the others stay."""
    room, tables = config.room, copy.deepcopy(config.tables)
    gone = room.robots[index].id
    faults = [fault for fault in tables.get("fault", ()) if fault.get("robot") != gone]
    tables.pop("fault", None)
    if faults:
        tables["fault"] = faults
    tables.get("battery", {}).get("initial", {}).pop(str(gone), None)
    robots = tables.get("robots", {})
    if isinstance(robots, dict):
        robots.pop(str(gone), None)
        if "count" in robots:
            robots["count"] = min(robots["count"], len(room.robots) - 1)
    else:
        tables["robots"] = min(robots, len(room.robots) - 1)
    return Configuration(tables, room.only([at for at in range(len(room.robots)) if at != index]))


def shrunk(config: Configuration, run: Run, failure: str, said: Callable[[str], None]) -> tuple[Configuration, Done]:
    """Return the smallest configuration that was found to fail in the same way, and its outcome.

    `run` runs a configuration, `failure` is the one to keep (see `failures`), and `said` is called with a line about
    each step.
    """
    done = run(config)
    if failure not in failures(done):
        raise ValueError(f"it does not fail in this way: {failure}; it does: {failures(done)}")
    config, done = _shorter(config, done, run, failure)
    again = True
    while again:
        again = False
        tried = 0
        # After a part was taken away, the next one to try has the same index.
        while (found := next(islice(smaller(config), tried, None), None)) is not None:
            after = run(found)
            if failure in failures(after):
                config, done, again = found, after, True
                said(f"{len(config.room.robots)} robots, {len(config.room.boxes)} boxes, {', '.join(config.tables)}")
            else:
                tried += 1
        config, done = _shorter(config, done, run, failure)
    return config, done


def _shorter(config: Configuration, done: Done, run: Run, failure: str) -> tuple[Configuration, Done]:
    """Return a configuration whose run ends soon after the failure, and its outcome."""
    result = done.result or {}
    found = result.get(JUDGED, {})
    starts = [breach["end_s"] for breach in found.get("breaches", ()) if breach["rule"] == failure]
    ends = [min(starts) + _AFTER_S] if starts else []
    if failure == "stuck":
        # A robot that is stuck needs only `STUCK_S` of that time to fail.
        ends = [result["duration_s"] - (max(found["in_sc_s"].values()) - STUCK_S) + 1.0]
    for end_s in [round(max(_LEAST_S, end_s), 1) for end_s in ends]:
        if end_s < config.tables["duration_s"]:
            tried = replace(config, tables={**config.tables, "duration_s": end_s})
            after = run(tried)
            if failure in failures(after):
                return tried, after
    return config, done


def shrink(seed: int, engine: str, folder: Path, duration_s: float | None, said: Callable[[str], None]) -> Path | None:
    """Shrink the configuration of a seed and write it into a folder.

    For `engine`, see `draw`. `duration_s` takes the place of the drawn duration, and `said` is called with a line about
    each step.

    Returns:
        The mission file; None if the seed does not fail.
    """
    config = draw(seed, engine)
    if duration_s is not None:
        config = replace(config, tables={**config.tables, "duration_s": duration_s})
    with LocalWorkers(1) as workers, closing(Scratch("shrinking")) as scratch:

        def run(tried: Configuration) -> Done:
            mission = tried.write(scratch.path)
            try:
                return workers.submit(Job("shrink", 0, str(mission), {}, {}, limit_s=LIMIT_S, judged=True)).result()
            except workers.died as death:
                return Done("failed", f"its process died: {death}")

        done = run(config)
        if not failures(done):
            said(f"seed {seed} does not fail: {done.status} {done.failure}")
            return None
        failure = failures(done)[0]
        said(f"seed {seed}: {', '.join(failures(done))}; keeping: {failure}")
        config, done = shrunk(config, run, failure, said)
    found = (done.result or {}).get(JUDGED, {})
    where = next((breach for breach in found.get("breaches", ()) if breach["rule"] == failure), done.failure)
    return config.write(folder, f"Seed {seed}, made smaller: {failure}, {where}")
