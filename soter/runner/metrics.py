"""The metrics of a running mission."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from soter.controller import SC
from soter.geometry.workspace import Workspace
from soter.record.looks import Stall
from soter.record.messages import AC
from soter.record.tracks import RunTracks, Track
from soter.rta import ModuleMonitor, RobotSupervisor, SwitchRecord
from soter.runner import result
from soter.sdk import Fleet
from soter.stack.events import Place, TargetOutcome
from soter.stack.right_of_way import BATTERY

STALL_S: Final = 300.0
"""A robot that has been without its AC for this long, and not charging, is stalled."""

MOVED_M: Final = 0.05
LEAST_RUN_S: Final = 60.0
"""A run of at most this length does not show whether a robot moves."""

_FULL: Final = 0.999
"""From this charge on a robot does not count as charging, even if it stands on its station to charge."""


class Standstill:
    """The times without AC, and the movement, of one robot; sampled a few times a second.

    Attributes:
        longest_s: longest time without the AC while not charging, up to the last look.
        stalls: the times that were stalls.
        moved_m: largest distance from where the robot was first seen.
    """

    __slots__ = ("_begin", "_robot_id", "_since_s", "longest_s", "moved_m", "stalls")

    def __init__(self, robot_id: int) -> None:
        self._robot_id: Final = robot_id
        self._begin: tuple[float, float] | None = None
        self._since_s = math.nan
        self.longest_s = 0.0
        self.stalls: list[Stall] = []
        self.moved_m = 0.0

    def look(self, now_s: float, robot: RobotSupervisor, *, charging: bool) -> None:
        """Take one look; `charging` says whether the robot stands on its station because it has to charge."""
        own, driver = robot.situation.own, robot.driver
        begin = self._begin = self._begin or (own.x_m, own.y_m)
        self.moved_m = max(self.moved_m, math.hypot(own.x_m - begin[0], own.y_m - begin[1]))
        charging = charging and not (own.battery is not None and own.battery >= _FULL)
        # A robot whose AC has failed for good rightly stays with its safe controllers.
        if driver is None or charging or robot.ac_failure:
            if self.stalls and self.stalls[-1].end_s is None:
                self.stalls[-1] = replace(self.stalls[-1], end_s=now_s)
            self._since_s = math.nan
            return
        if math.isnan(self._since_s):
            self._since_s = now_s
        lasted_s = now_s - self._since_s
        self.longest_s = max(self.longest_s, lasted_s)
        if lasted_s >= STALL_S:
            goes_on = bool(self.stalls) and self.stalls[-1].end_s is None
            stalled = Stall(self._robot_id, self._since_s, None, driver.name, driver.cause)
            self.stalls[-1 if goes_on else len(self.stalls) :] = [stalled]


class Standstills:
    """All robots of a run."""

    def __init__(self, robot_ids: Sequence[int]) -> None:
        self.robots: Final = {robot_id: Standstill(robot_id) for robot_id in robot_ids}

    @property
    def longest_s(self) -> float:
        """The longest time that a robot was without its AC and not charging."""
        return max((robot.longest_s for robot in self.robots.values()), default=0.0)

    def stalls(self) -> list[Stall]:
        """Return every stall up to now."""
        return [stalled for robot in self.robots.values() for stalled in robot.stalls]

    def permanent(self, end_s: float) -> dict[int, result.StallFigures]:
        """Return, by robot, the stalls that lasted to the end of the run, at fleet time `end_s`."""
        return {
            each.robot_id: result.StallFigures(
                since_s=round(each.start_s, 6), lasted_s=round(end_s - each.start_s, 6), module=each.module,
                cause=each.cause,
            )
            for each in self.stalls()
            if each.end_s is None
        }  # fmt: skip

    def never_moved(self, duration_s: float) -> tuple[int, ...]:
        """Return the robots that never moved; none if the run was too short to tell."""
        if duration_s <= LEAST_RUN_S:
            return ()
        return tuple(robot_id for robot_id, robot in self.robots.items() if robot.moved_m <= MOVED_M)


SAMPLE_TICKS: Final = 5
"""Ticks between two samples of tracks and stalls."""

STALL_M: Final = 0.1

_ROUNDING_S: Final = 1e-9


class LongestStay:
    """The longest time that one robot, short of its target and not charging, stayed inside a circle of `STALL_M`."""

    __slots__ = ("_since_s", "_x_m", "_y_m", "longest_s")

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._since_s = math.nan
        self._x_m = self._y_m = math.inf

    def look(self, now_s: float, x_m: float, y_m: float, counts: bool) -> None:
        """Take one sample; with `counts` False, standing still is no stall."""
        dx, dy = x_m - self._x_m, y_m - self._y_m
        if not counts or not dx * dx + dy * dy <= STALL_M * STALL_M:
            self._x_m, self._y_m, self._since_s = x_m, y_m, now_s
        elif now_s - self._since_s > self.longest_s:
            self.longest_s = now_s - self._since_s


class Metrics:
    """Counts for a run; a `Watch` of every robot's supervisor.

    Attributes:
        targets: by robot, where it is to go, until it is there.
        standstills: the robots' times without AC.
        uncontrolled: robots that for a time did not obey.
        end_s: fleet time of the end of the run, once it is finished.
    """

    def __init__(
        self,
        workspace: Workspace,
        modules: Sequence[str],
        robot_ids: Sequence[int],
        safer_inset_m: float | None,
    ) -> None:
        self.tracks: Final = RunTracks(
            workspace, (AC, *modules), {robot_id: Track() for robot_id in robot_ids},
            safer_inset_m=safer_inset_m,
        )  # fmt: skip
        self.judge: Callable[[SwitchRecord], bool] | None = None
        self.disengagements: Counter[str] = Counter()
        self.disengagements_by_robot: Counter[int] = Counter()
        self.joined: Counter[str] = Counter()
        self.needless = 0
        self.outcomes: Counter[TargetOutcome] = Counter()
        self.reached_by_robot: Counter[int] = Counter()
        self.targets: dict[int, Place] = {}
        self.no_progress_s = 0.0
        self._progress_s = 0.0
        self._begun_s = self.end_s = 0.0
        self._now_s = 0.0
        self._stalls = {robot_id: LongestStay() for robot_id in robot_ids}
        self.standstills: Final = Standstills(robot_ids)
        self._driver_index: dict[str | None, int] = {None: 0}
        self._driver_index.update({name: index for index, name in enumerate(modules, start=1)})
        self._ac_ticks = 0
        self._busy_ticks = 0
        self._robot_ticks = 0
        self._decide_s: array[float] = array("f")
        self._late_s: array[float] = array("d")
        self.uncontrolled: dict[int, result.UncontrolledFigures] = {}

    # --- called by others ------------------------------------------------------------------------------------

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        """Count a change of control."""
        self.tracks.switches.append(record)
        if record.before is None and record.after is not None:
            self.disengagements[record.module] += 1
            self.disengagements_by_robot[record.robot_id] += 1
            self.joined.update(record.joined)
            if self.judge is not None:
                self.needless += self.judge(record)

    def on_target(self, robot_id: int, target_id: int, place: Place) -> None:
        """Note a robot's target."""
        self.targets[robot_id] = place

    def on_ended(self, robot_id: int, target_id: int, outcome: TargetOutcome) -> None:
        """Count how a target ended."""
        self.outcomes[outcome] += 1
        if outcome is TargetOutcome.REACHED:
            self.reached_by_robot[robot_id] += 1
            self.targets.pop(robot_id, None)
        self.no_progress_s = max(self.no_progress_s, self._now_s - self._progress_s)
        self._progress_s = self._now_s

    def begin(self, now_s: float) -> None:
        """Start counting, at the first tick: robots may have been ready, and waiting for others, for long."""
        self._begun_s = self._progress_s = self._now_s = now_s

    def tick(
        self,
        now_s: float,
        tick: int,
        late_s: float,
        robots: Sequence[RobotSupervisor],
        charging: Callable[[int], bool],
    ) -> None:
        """Count one tick, and how late it came."""
        passed_s = max(now_s - self._now_s, 0.0)
        self._now_s = now_s
        self._late_s.append(late_s)
        self._robot_ticks += len(robots)
        decide_s = self._decide_s
        for robot in robots:
            decide_s.append(robot.decide_s)
            if cause := robot.uncontrolled:
                known = self.uncontrolled.get(robot.robot_id)
                first_s, lasted_s, cause = (
                    (now_s, 0.0, cause) if known is None else (known.first_s, known.lasted_s, known.cause)
                )
                self.uncontrolled[robot.robot_id] = result.UncontrolledFigures(
                    first_s=round(first_s, 6), lasted_s=round(lasted_s + passed_s, 6), cause=cause
                )
            if robot.driver is None:
                self._ac_ticks += 1
                self._busy_ticks += 1
            elif not _has_to_charge(robot):
                self._busy_ticks += 1
        if tick % SAMPLE_TICKS == 0:
            self._sample(now_s, robots, charging)

    def _sample(self, now_s: float, robots: Sequence[RobotSupervisor], charging: Callable[[int], bool]) -> None:
        for robot in robots:
            own = robot.situation.own
            robot_id = robot.robot_id
            driver = self._driver_index[None if robot.driver is None else robot.driver.name]
            self.tracks.tracks[robot_id].add(now_s, own.x_m, own.y_m, own.battery, driver)
            charges = charging(robot_id)
            self._stalls[robot_id].look(now_s, own.x_m, own.y_m, robot_id in self.targets and not charges)
            self.standstills.robots[robot_id].look(now_s, robot, charging=charges)

    def finish(self, duration_s: float) -> None:
        """End all open intervals at the end of the run."""
        self.end_s = self._begun_s + duration_s
        self.no_progress_s = max(self.no_progress_s, self.end_s - self._progress_s)

    @property
    def ac_share(self) -> float:
        """Part of the robots' time with the AC in control."""
        return self._ac_ticks / self._robot_ticks if self._robot_ticks else 0.0

    @property
    def ac_share_without_charging(self) -> float:
        """Part of the robots' time with the AC in control, not counting time in which the battery module is in SC."""
        return self._ac_ticks / self._busy_ticks if self._busy_ticks else 0.0

    @property
    def longest_stall_s(self) -> float:
        """The longest stall of any robot."""
        return max((stall.longest_s for stall in self._stalls.values()), default=0.0)

    def target_counts(self) -> result.TargetCounts:
        """How targets ended."""
        return result.TargetCounts(**{outcome.value: self.outcomes[outcome] for outcome in TargetOutcome})

    def tick_times(self) -> result.TickTimes:
        """Host time of one robot's decisions at one tick."""
        return percentiles(np.frombuffer(self._decide_s, dtype=np.float32) * 1e6)

    def tick_lateness(self) -> result.TickTimes:
        """How late ticks came, in milliseconds."""
        return percentiles(np.frombuffer(self._late_s) * 1e3)

    def missed_ticks(self, jitter_s: float) -> int:
        """How many ticks came later than the robots' declared jitter allows."""
        return int(np.count_nonzero(np.frombuffer(self._late_s) > jitter_s + _ROUNDING_S))


def _has_to_charge(robot: RobotSupervisor) -> bool:
    for module in robot.modules:
        if module.name == BATTERY:
            return module.mode is SC
    return False


def counts(counter: Mapping[str, int], names: Sequence[str]) -> dict[str, int]:
    """Return counts for all names, zeros included, then for any others that occurred."""
    return {name: counter.get(name, 0) for name in (*names, *sorted(set(counter) - set(names)))}


def module_figures(robots: Sequence[RobotSupervisor]) -> dict[str, result.ModuleFigures]:
    """Return the figures of every module's spec monitors, summed up over all robots."""
    by_name: dict[str, list[ModuleMonitor]] = {}
    for robot in robots:
        for module in robot.modules:
            by_name.setdefault(module.name, []).append(module.monitor)
    return {
        name: result.ModuleFigures(
            looks=sum(monitor.looks for monitor in monitors),
            to_sc=sum(monitor.to_sc for monitor in monitors),
            to_ac=sum(monitor.to_ac for monitor in monitors),
            sc_s=round(sum(monitor.sc_s for monitor in monitors), 2),
            least_margin=_finite(min(monitor.least_margin for monitor in monitors)),
            broken=sum(monitor.broken for monitor in monitors),
            surprises=sum(monitor.surprises for monitor in monitors),
        )
        for name, monitors in by_name.items()
    }


def breach_figures(robots: Sequence[RobotSupervisor]) -> dict[int, dict[str, result.BreachFigures]]:
    """Return the assumptions that failed, by robot; robots without any are left out."""
    return {
        robot.robot_id: {
            assumption.id: result.BreachFigures(
                times=breach.times, first_s=round(breach.first_s, 6), cause=breach.cause,
                last_s=round(breach.last_s, 6),
                worst=tuple(
                    result.WorstFigures(excess=round(each.excess, 6), unit=each.unit, time_s=round(each.time_s, 6),
                                 cause=each.cause)
                    for each in breach.worst
                ),
            )
            for assumption, breach in robot.log.breaches.items()
        }
        for robot in robots
        if robot.log.breaches
    }  # fmt: skip


def fault_figures(fleet: Fleet) -> tuple[result.FaultFigures, ...]:
    """Return the faults that were injected into a fleet, and how often they had an effect."""
    return tuple(
        result.FaultFigures(kind=fault.kind, robot=fault.robot_id, declared=fault.declared, affected=fault.affected)
        for fault in fleet.injected()
    )


def percentiles(times: NDArray[np.floating[Any]]) -> result.TickTimes:
    """Return median, 99th percentile and maximum of times; zeros if there are none."""
    if not times.size:
        return result.TickTimes(p50=0.0, p99=0.0, max=0.0)
    p50, p99 = (float(value) for value in np.percentile(times, (50, 99)))
    return result.TickTimes(p50=round(p50, 2), p99=round(p99, 2), max=round(float(times.max()), 2))


def _finite(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None
