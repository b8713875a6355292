"""Makes a configuration that fails smaller for as long as it fails in the same way."""

from __future__ import annotations

import copy
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from tools.generator.configuration import Configuration
from tools.generator.drawing import draw
from tools.generator.room import Room
from tools.generator.running import STUCK_S, Outcome, run_apart

_AFTER_S: Final = 10.0
_LEAST_S: Final = 20.0

Run = Callable[[Configuration], Outcome]


def smaller(config: Configuration) -> Iterator[Configuration]:
    """Yield configurations with one thing less: the largest steps first."""
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
    """Yield the keys that may be left out, whole tables before what is in them."""
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
    """Return it with a robot less; the ids of the others stay."""
    room, tables = config.room, copy.deepcopy(config.tables)
    gone = room.robots[index].id
    faults = [fault for fault in tables.get("fault", ()) if fault.get("robot") != gone]
    tables.pop("fault", None)
    if faults:
        tables["fault"] = faults
    tables.get("battery", {}).get("initial", {}).pop(str(gone), None)
    if "robots" in tables:
        tables["robots"] = min(tables["robots"], len(room.robots) - 1)
    return Configuration(tables, _less(room, index))


def _less(room: Room, index: int) -> Room:
    return replace(
        room,
        robots=room.robots[:index] + room.robots[index + 1 :],
        stations=room.stations[:index] + room.stations[index + 1 :],
    )


def shrunk(config: Configuration, run: Run, failure: str, said: Callable[[str], None]) -> tuple[Configuration, Outcome]:
    """Return the smallest configuration that was found to fail in the same way, and its outcome.

    Args:
        config: one that fails.
        run: runs one.
        failure: what has to stay; see `Outcome.failures`.
        said: is told of each step.
    """
    outcome = run(config)
    if failure not in outcome.failures:
        raise ValueError(f"it does not fail in this way: {failure}; it does: {outcome.failures}")
    config, outcome = _shorter(config, outcome, run, failure)
    again = True
    while again:
        again = False
        tried = 0
        # Whatever was taken away, the next thing to try stands at the same place.
        while (found := next(_after(smaller(config), tried), None)) is not None:
            after = run(found)
            if failure in after.failures:
                config, outcome, again = found, after, True
                said(f"{len(config.room.robots)} robots, {len(config.room.boxes)} boxes, {', '.join(config.tables)}")
            else:
                tried += 1
        config, outcome = _shorter(config, outcome, run, failure)
    return config, outcome


def _after(found: Iterator[Configuration], tried: int) -> Iterator[Configuration]:
    for _ in range(tried):
        next(found, None)
    return found


def _shorter(config: Configuration, outcome: Outcome, run: Run, failure: str) -> tuple[Configuration, Outcome]:
    """Return it with a run that ends soon after the failure."""
    starts = [breach["end_s"] for breach in outcome.breaches if breach["rule"] == failure]
    ends = [min(starts) + _AFTER_S] if starts else []
    if failure == "stuck":
        # Where it is stuck from the middle on, so much of the end is not needed.
        ends = [outcome.duration_s - (max(outcome.in_sc_s.values()) - STUCK_S) + 1.0]
    for end_s in [round(max(_LEAST_S, end_s), 1) for end_s in ends]:
        if end_s < outcome.duration_s:
            tried = replace(config, tables={**config.tables, "duration_s": end_s})
            after = run(tried)
            if failure in after.failures:
                return tried, after
    return config, outcome


def shrink(seed: int, engine: str, folder: Path, limit_s: float, duration_s: float | None) -> int:
    """Shrink the configuration of a seed and write it into a folder; return the exit code."""
    config = draw(seed, engine)
    if duration_s is not None:
        config = replace(config, tables={**config.tables, "duration_s": duration_s})
    runs = 0

    def run(tried: Configuration) -> Outcome:
        nonlocal runs
        runs += 1
        with tempfile.TemporaryDirectory() as scratch:
            return run_apart(tried.write(Path(scratch)), limit_s)

    began_s = time.monotonic()
    outcome = run(config)
    if not outcome.failures:
        print(f"seed {seed} does not fail: {outcome.status} {outcome.reason}")
        return 0
    failure = outcome.failures[0]
    print(f"seed {seed}: {', '.join(outcome.failures)}; keeping: {failure}", flush=True)
    config, outcome = shrunk(config, run, failure, lambda words: print(words, flush=True))
    where = next((breach for breach in outcome.breaches if breach["rule"] == failure), outcome.in_sc_s)
    mission = config.write(folder, f"Seed {seed}, made smaller: {failure}, {where}")
    print(f"{mission}: {failure}, {where}; {runs} runs in {time.monotonic() - began_s:.0f} s")
    return 1
