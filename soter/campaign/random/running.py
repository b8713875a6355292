"""Runs a mission with a witness, and judges it a second time, by geometry that shares nothing with SOTER's."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from soter.campaign.random.configuration import Configuration
from soter.campaign.random.drawing import draw
from soter.campaign.random.judge import PromisedLimits, RuleBreach, Ways, judge
from soter.campaign.random.room import DrawnRoom
from soter.campaign.random.witness import WATCHED, witnesses
from soter.config import MissionFile, load_mission
from soter.registry import load_backend
from soter.runner import Follower, Run, run_mission
from soter.scratch import Scratch
from soter.specs import asked, read_options

STUCK_S: Final = 300.0
"""A robot in SC for longer than this, without charging, is stuck, but for the time that its way takes at top speed: the
safe controller of a slow robot may well drive it home for longer. One whose battery is empty is another matter."""

_MOVED_M: Final = 0.05
_FULL: Final = 1.0 - 1e-9


@dataclass(frozen=True)
class Judgement:
    """The judgement of the second judge on a run. All values can be written as JSON.

    Attributes:
        truth: violations of promised rules by the simulator's judge.
        judged: violations by the independent judge.
        breaches: the first of these.
        in_sc_s: longest time in SC without charging, by robot, before its battery was empty, less the time that the
            straight way from where that began takes at top speed; robots whose AC failed for good are left out.
        never_moved: robots that stayed where they started although their AC did not fail.
    """

    truth: Mapping[str, int]
    judged: Mapping[str, int]
    breaches: tuple[Mapping[str, Any], ...] = ()
    in_sc_s: Mapping[str, float] = field(default_factory=dict)
    never_moved: tuple[int, ...] = ()

    @property
    def findings(self) -> list[str]:
        """The faults: broken rules, judges that disagree, robots that are stuck."""
        broken = [rule for rule in (*self.truth, *self.judged) if self.truth.get(rule) or self.judged.get(rule)]
        split = [
            f"judges disagree on {rule}" for rule in broken if not (self.truth.get(rule) and self.judged.get(rule))
        ]
        stuck = ["stuck"] if any(time_s > STUCK_S for time_s in self.in_sc_s.values()) else []
        return list(dict.fromkeys([*broken, *split, *stuck]))


def run_drawn(
    settings: Mapping[str, Any], stop: Callable[[], bool], record: Path | None = None
) -> tuple[Run, Judgement]:
    """Run the configuration of a seed: `settings` are `seed`, and maybe `engine` and `duration_s`; see `run_judged`."""
    with closing(Scratch("drawn")) as scratch:
        mission = draw(settings["seed"], settings.get("engine", "kinematic")).write(scratch.path)
        return run_judged(mission, settings.get("duration_s"), stop, record)


def run_judged(
    mission_file: Path, duration_s: float | None, stop: Callable[[], bool], record: Path | None = None
) -> tuple[Run, Judgement]:
    """Run a mission file with a witness.

    Args:
        mission_file: a mission on a simulated backend in process.
        duration_s: a duration in place of the mission's own; None for its own.
        stop: called at every tick; returns whether to end early.
        record: the file to record the run in, or None.

    Raises:
        ConfigError: the mission is bad input, or a module is not proved.
        BackendError: the backend cannot be opened.
        IllFormedModule: a module cannot keep its promise.
    """
    mission = load_mission(mission_file)
    backend = mission.backend
    overrides: dict[str, object] = {"backend": WATCHED[backend], "duration_s": duration_s}
    if backend in mission.backends:
        overrides["backends"] = {**mission.backends, WATCHED[backend]: mission.backends[backend]}
    mission = load_mission(mission_file, overrides)
    run = run_mission(mission, record=record, follower=Follower(stop=stop))
    return run, _judged(Configuration.read(mission_file).room, mission, run)


def _judged(room: DrawnRoom, mission: MissionFile, run: Run) -> Judgement:
    result, witness = run.result, witnesses[-1]
    ways = Ways(witness.ids, *witness.seen(result.duration_s))
    room = room.only([index for index, start in enumerate(room.robots) if start.id in ways.ids])
    backend = load_backend(mission.backend)
    workspace = mission.read_workspace()
    promised = asked(backend, read_options(backend, mission, workspace), mission, workspace)
    radius_m = {robot_id: each.body_radius_m for robot_id, each in promised.items()}
    limits = PromisedLimits.of(mission.rta.model_dump(), radius_m)
    breaches = judge(room, limits, ways)
    return Judgement(
        truth={rule: (result.violations or {}).get(rule, 0) for rule in limits.rules},
        judged={rule: sum(breach.rule == rule for breach in breaches) for rule in limits.rules},
        breaches=tuple(asdict(breach) for breach in _first(breaches)),
        in_sc_s=in_sc_s(room, run, ways, {robot_id: each.v_max_m_s for robot_id, each in promised.items()}),
        never_moved=tuple(
            robot_id
            for index, robot_id in enumerate(ways.ids)
            if robot_id not in result.failed_robots
            and max(np.ptp(ways.x[:, index]), np.ptp(ways.y[:, index])) < _MOVED_M
        ),
    )


def _first(breaches: list[RuleBreach]) -> list[RuleBreach]:
    """Return the first breach of every rule."""
    found: dict[str, RuleBreach] = {}
    for breach in breaches:
        found.setdefault(breach.rule, breach)
    return [*found.values()]


def in_sc_s(room: DrawnRoom, run: Run, ways: Ways, v_max_m_s: Mapping[int, float]) -> dict[str, float]:
    """Return `Judgement.in_sc_s` of a run, for robots with these top speeds.

    A robot with an empty battery stands under any controller. If that breaks a rule, it is a finding of its own.
    """
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
        waits = (np.asarray(track.driver) != 0) & ~charging & (charge[at] > 0.0)
        longest_s = since_s = 0.0
        places = np.column_stack((ways.x[at, index], ways.y[at, index])).tolist()
        began = places[0]
        going_on = False
        for time_s, place, waiting in zip(times, places, waits, strict=True):
            if waiting and not going_on:
                since_s, began = time_s, place
            going_on = bool(waiting)
            if going_on:
                longest_s = max(longest_s, time_s - since_s - math.dist(began, place) / v_max_m_s[robot_id])
        found[str(robot_id)] = round(float(longest_s), 1)
    return found
