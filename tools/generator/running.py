"""Runs one mission file with a witness, and says what became of it."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import re
import signal
import sys
import time
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event
from typing import Any, Final

import numpy as np

from soter.config import Mission, load_mission
from soter.errors import BackendError, ConfigError, IllFormedModule
from soter.registry import load_backend
from soter.runner import Run, run_mission
from soter.runner.specs import read_options
from tools.generator.configuration import Configuration
from tools.generator.judge import Breach, Limits, Ways, judge
from tools.generator.room import Room
from tools.generator.witness import WATCHED, witnesses

STUCK_S: Final = 300.0
"""A robot in SC for longer than this, without charging, is stuck."""

LIMIT_S: Final = 600.0
"""Host time for one run."""

_POLL_S: Final = 0.5
_MOVED_M: Final = 0.05
_FULL: Final = 1.0 - 1e-9
_PRELOADED: Final = ("tools.generator.running", "tools.generator.attackers", "soter.stack.planners.base")


@dataclass
class Outcome:
    """What became of a configuration. All of it is plain enough for JSON.

    Attributes:
        status: `refused`, `accepted`, `failed` (the run did not get to its end), `crashed`, `late` (it took too long).
        reason: the message of a refusal or a failure.
        group: the same, short enough to be counted.
        robots: how many.
        duration_s: simulated.
        wall_s: of the host.
        truth: violations by the simulator's judge, of the rules that are promised.
        judged: by the independent judge.
        breaches: the first of them.
        in_sc_s: longest time in SC without charging, by robot; robots whose AC failed for good are left out.
        never_moved: robots that stayed where they started although their AC did not fail.
        ac_share: part of the robots' time with the AC in control.
        assumptions: times that each failed, all robots together.
        trace: the hash of the run.
    """

    status: str
    reason: str = ""
    group: str = ""
    robots: int = 0
    duration_s: float = 0.0
    wall_s: float = 0.0
    truth: dict[str, int] = field(default_factory=dict)
    judged: dict[str, int] = field(default_factory=dict)
    breaches: list[dict[str, Any]] = field(default_factory=list)
    in_sc_s: dict[str, float] = field(default_factory=dict)
    never_moved: list[int] = field(default_factory=list)
    ac_share: float = 0.0
    assumptions: dict[str, int] = field(default_factory=dict)
    trace: str = ""

    @property
    def failures(self) -> tuple[str, ...]:
        """What must not be: rules that were broken, judges that disagree, robots that are stuck, runs without end."""
        if self.status != "accepted":
            return () if self.status == "refused" else (self.status,)
        broken = [rule for rule in (*self.truth, *self.judged) if self.truth.get(rule) or self.judged.get(rule)]
        split = [
            f"judges disagree on {rule}" for rule in broken if not (self.truth.get(rule) and self.judged.get(rule))
        ]
        stuck = ["stuck"] if any(time_s > STUCK_S for time_s in self.in_sc_s.values()) else []
        return tuple(dict.fromkeys([*broken, *split, *stuck]))


def run_here(mission_file: Path, duration_s: float | None = None) -> Outcome:
    """Run a mission file in this process.

    Args:
        mission_file: as SOTER takes it, on a simulated backend in process.
        duration_s: in place of its own.
    """
    began_s = time.perf_counter()
    try:
        mission = load_mission(mission_file)
        backend = mission.backend
        overrides: dict[str, object] = {"backend": WATCHED[backend], "duration_s": duration_s}
        if backend in mission.backends:
            overrides["backends"] = {**mission.backends, WATCHED[backend]: mission.backends[backend]}
        mission = load_mission(mission_file, overrides)
        run = run_mission(mission)
    except (ConfigError, BackendError, IllFormedModule) as failure:
        return Outcome("refused", str(failure), _group(failure))
    outcome = _accepted(Configuration.read(mission_file).room, mission, run)
    outcome.wall_s = round(time.perf_counter() - began_s, 2)
    return outcome


def _group(failure: Exception) -> str:
    """Return a refusal's kind: the module and the condition, or the message without its numbers and names."""
    if isinstance(failure, IllFormedModule):
        return f"{failure.module} {failure.condition}"
    text = re.sub(r"\(line \d+\)|'[^']*'|[-+]?\d[\d.e+-]*", "#", str(failure).splitlines()[-1])
    return re.sub(r"\s+", " ", re.sub(r"/\S+", "", text))[:70].strip()


def _accepted(room: Room, mission: Mission, run: Run) -> Outcome:
    result, witness = run.result, witnesses[-1]
    ways = Ways(witness.ids, *witness.seen(result.duration_s))
    kept = [index for index, start in enumerate(room.robots) if start.id in ways.ids]
    room = Room(
        room.width, room.depth, tuple(room.robots[index] for index in kept),
        tuple(room.stations[index] for index in kept), room.boxes,
    )  # fmt: skip
    backend = load_backend(mission.backend)
    promised = backend.promises(read_options(backend, mission, mission.read_workspace()))
    limits = Limits.of(mission.rta.model_dump(), promised.body_radius_m)
    breaches = judge(room, limits, ways)
    return Outcome(
        "accepted" if result.status == "completed" else "failed",
        result.failure,
        result.failure[:70],
        len(ways.ids),
        result.duration_s,
        truth={rule: (result.violations or {}).get(rule, 0) for rule in limits.rules},
        judged={rule: sum(breach.rule == rule for breach in breaches) for rule in limits.rules},
        breaches=[asdict(breach) for breach in _first(breaches)],
        in_sc_s=_in_sc_s(room, run, ways),
        never_moved=[
            robot_id
            for index, robot_id in enumerate(ways.ids)
            if robot_id not in result.failed_robots
            and max(np.ptp(ways.x[:, index]), np.ptp(ways.y[:, index])) < _MOVED_M
        ],
        ac_share=result.ac_share,
        assumptions=_assumptions(run),
        trace=result.trace_sha256[:16],
    )


def _first(breaches: list[Breach]) -> list[Breach]:
    """Return the first breach of every rule."""
    found: dict[str, Breach] = {}
    for breach in breaches:
        found.setdefault(breach.rule, breach)
    return [*found.values()]


def _in_sc_s(room: Room, run: Run, ways: Ways) -> dict[str, float]:
    """Return by robot the longest time in SC in which it was not charging; only while its AC lives."""
    on_station = ways.on_station(room.stations)
    period_s = ways.times[1] - ways.times[0] if len(ways.times) > 1 else 1.0
    found = {}
    for index, robot_id in enumerate(ways.ids):
        if robot_id in run.result.failed_robots:
            continue
        track = run.tracks.tracks[robot_id]
        times = np.frombuffer(track.time_s)
        at = np.minimum((times / period_s + 0.5).astype(int), len(ways.times) - 1)
        before = np.maximum(at - 1, 0)
        charge = ways.charge[:, index]
        charging = on_station[at, index] & (charge[at] >= charge[before]) & (charge[before] < _FULL)
        waits = (np.frombuffer(track.driver, dtype=np.int8) != 0) & ~charging
        longest_s = since_s = 0.0
        going_on = False
        for time_s, waiting in zip(times, waits, strict=True):
            if waiting and not going_on:
                since_s = time_s
            going_on = bool(waiting)
            if going_on:
                longest_s = max(longest_s, time_s - since_s)
        found[str(robot_id)] = round(float(longest_s), 1)
    return found


def _assumptions(run: Run) -> dict[str, int]:
    times: dict[str, int] = {}
    for breaches in run.result.assumptions.values():
        for name, breach in breaches.items():
            times[name] = times.get(name, 0) + breach.times
    return times


# --- in a process of its own -----------------------------------------------------------------------------------


def run_apart(
    mission_file: Path, limit_s: float = LIMIT_S, duration_s: float | None = None, stop: Event | None = None
) -> Outcome:
    """Run a mission file in a process of its own, for so long at most, or until told to stop. Thread-safe."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*_PRELOADED])
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(theirs, mission_file, duration_s))
    began_s = time.perf_counter()
    process.start()
    theirs.close()
    try:
        while not ours.poll(_POLL_S):
            stopped = stop is not None and stop.is_set()
            if not stopped and time.perf_counter() - began_s < limit_s:
                continue
            if stopped:
                return Outcome("stopped")
            return Outcome("late", f"no end after {limit_s:g} s of the host's time", "late", wall_s=limit_s)
        outcome: Outcome = ours.recv()
    except EOFError:
        process.join()
        return Outcome("crashed", f"exit code {process.exitcode}", f"exit code {process.exitcode}")
    else:
        outcome.wall_s = round(time.perf_counter() - began_s, 2)
        return outcome
    finally:
        process.kill()
        process.join()
        ours.close()


def _child(pipe: Connection, mission_file: Path, duration_s: float | None) -> None:
    # Ctrl-C is the campaign's business.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.disable(logging.CRITICAL)
    sys.path.insert(0, str(mission_file.parent))
    try:
        outcome = run_here(mission_file, duration_s)
    except Exception as failure:  # noqa: BLE001 - whatever it is, it is a finding
        outcome = Outcome("crashed", f"{type(failure).__name__}: {failure}", type(failure).__name__)
    with contextlib.suppress(OSError):
        pipe.send(outcome)
