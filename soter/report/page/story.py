"""The story of a run for its page, which grows with the run; thinned out, so that a long run stays small.

All events are exact: drivers over time, disengagements and their causes, targets, goals, violations, gaps. One pose is
kept of some ticks. Margins and charges are gathered into buckets, of which the least and the largest value are kept,
so that no minimum is lost.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, MutableSequence
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from soter.geometry.workspace import Workspace
from soter.record.attachments import About, RobotAbout
from soter.record.content import Content, RecordedWay, Series
from soter.record.messages import AC, BreachEvent, GoalEvent, StallEvent, SwitchEvent, TargetEvent
from soter.record.tracks import started_s
from soter.report.page.pack import buckets, starts_of_runs
from soter.report.page.rules import add_margins, modules_of

S = TypeVar("S", bound=MutableSequence[Any])


class IncrementalSeries(Generic[S]):
    """A sequence of which only new or changed values need to be sent.

    Args:
        values: the sequence, which is kept and may be read.
    """

    def __init__(self, values: S) -> None:
        self.values: Final = values
        self._told = 0

    def add(self, more: Iterable[Any]) -> None:
        """Append values."""
        self.values.extend(more)

    def set(self, index: int, value: Any) -> None:
        """Change a value; -1 is the last."""
        index %= len(self.values)
        self.values[index] = value
        self._told = min(self._told, index)

    def cut(self, count: int) -> None:
        """Keep only the first `count` values."""
        del self.values[count:]
        self._told = min(self._told, count)

    def whole(self) -> tuple[int, S]:
        """Return index 0 and all values, for a new viewer; they do not count as sent to the others."""
        return 0, self.values

    def news(self) -> tuple[int, S]:
        """Return the first index not sent yet, and all values from there on, which now count as sent."""
        since, self._told = self._told, len(self.values)
        return since, self.values[since:]  # type: ignore[return-value]


class Rows(IncrementalSeries[list[list[Any]]]):
    """Rows of a table."""

    def __init__(self) -> None:
        super().__init__([])


class Numbers(IncrementalSeries["array[float]"]):
    """A column of numbers."""

    def __init__(self) -> None:
        super().__init__(array("d"))

    def add(self, more: Iterable[float]) -> None:
        self.values.frombytes(np.asarray(more, dtype=np.float64).tobytes())

    def replace(self, numbers: NDArray[np.float64]) -> None:
        """Replace all numbers."""
        self.cut(0)
        self.add(numbers)


T = TypeVar("T")


class Buckets:
    """The least and the largest value of each bucket of neighbours."""

    def __init__(self) -> None:
        self.low: Final = Numbers()
        self.high: Final = Numbers()

    def add(self, values: array[float], first: int, step: int) -> None:
        """Gather values, the first of which has the number `first`; the last bucket may still have room."""
        numbers = np.asarray(values, dtype=np.float64)
        room = -first % step
        if room and len(numbers) and self.low.values:
            self.low.set(-1, float(np.fmin.reduce([self.low.values[-1], *numbers[:room]])))
            self.high.set(-1, float(np.fmax.reduce([self.high.values[-1], *numbers[:room]])))
        low, high = buckets(numbers[room:], step)
        self.low.add(low)
        self.high.add(high)

    def halve(self) -> None:
        """Join every two neighbours."""
        low, high = buckets(self.low.values, 2)[0], buckets(self.high.values, 2)[1]
        self.low.replace(low)
        self.high.replace(high)


class RobotStory:
    """One robot.

    Attributes:
        modules: the modules with margins.
        time_s, x_m, y_m, heading_rad: its poses.
        stretches: rows of start in fleet time and index of the driver from then on.
        bucket_s: start of each bucket.
        charge: charges, in buckets.
        margins, reaches: margins and reach bounds, in buckets, for each module.
        targets: rows of number, begin, end, x, y and outcome; without an end until it has ended.
        goals: columns: start and end in fleet time, x, y, and 1 if the AC sent the goal.
        way_s, way_begin, way_x_m, way_y_m: time of each way of the AC, index of its first place, and all places.
    """

    def __init__(self, about: RobotAbout) -> None:
        self.about: Final = about
        self.modules: Final = modules_of(about)
        self.time_s, self.x_m, self.y_m, self.heading_rad = Numbers(), Numbers(), Numbers(), Numbers()
        self.stretches: Final = Rows()
        self.bucket_s: Final = Numbers()
        self.charge: Final = Buckets()
        self.margins: Final = [Buckets() for _ in self.modules]
        self.reaches: Final = [Buckets() for _ in self.modules]
        self.targets: Final = Rows()
        self.goals: Final = tuple(Numbers() for _ in range(5))
        self.way_s, self.way_begin, self.way_x_m, self.way_y_m = Numbers(), Numbers(), Numbers(), Numbers()
        self.way_begin.add([0.0])
        self._target_at: Final[dict[int, int]] = {}
        self._extra_pose = False

    def add(self, series: Series, first: int, pose_ticks: int, bucket_ticks: int) -> None:
        """Add ticks, the first of which has the number `first`."""
        if not series.time_s:
            return
        self._add_poses(series, first, pose_ticks)
        runs = starts_of_runs(series.driver)
        if self.stretches.values and self.stretches.values[-1][1] == series.driver[0]:
            del runs[0]
        self.stretches.add([series.time_s[start], series.driver[start]] for start in runs)
        self.bucket_s.add(np.asarray(series.time_s)[-first % bucket_ticks :: bucket_ticks])
        self.charge.add(series.battery, first, bucket_ticks)
        nothing: array[float] = array("d")
        for module, margin, reach in zip(self.modules, self.margins, self.reaches, strict=True):
            margin.add(series.margins.get(module.name, nothing), first, bucket_ticks)
            reach.add(series.reaches.get(module.name, nothing), first, bucket_ticks)

    def _add_poses(self, series: Series, first: int, step: int) -> None:
        """Add every `step`-th pose, and the last one for as long as it is the last."""
        poses = ((self.time_s, series.time_s), (self.x_m, series.x_m), (self.y_m, series.y_m),
                 (self.heading_rad, series.heading_rad))  # fmt: skip
        if self._extra_pose:
            for column, _ in poses:
                column.cut(len(column.values) - 1)
        last = len(series.time_s) - 1
        self._extra_pose = (first + last) % step != 0
        for column, values in poses:
            numbers = np.asarray(values)
            column.add(numbers[-first % step :: step])
            if self._extra_pose:
                column.add(numbers[last:])

    @property
    def started_s(self) -> float:
        """Until when it was starting, see `soter.record.tracks.started_s`."""
        return started_s([start for start, _ in self.stretches.values], [driver for _, driver in self.stretches.values])

    def halve_poses(self) -> None:
        """Keep every other pose, and the last one."""
        count = len(self.time_s.values) - self._extra_pose
        self._extra_pose = self._extra_pose or count % 2 == 0
        for column in (self.time_s, self.x_m, self.y_m, self.heading_rad):
            # A copy, since an array cannot be shortened while a view of it exists.
            numbers = np.array(column.values)
            kept = numbers[:count:2]
            column.replace(np.append(kept, numbers[-1:]) if self._extra_pose else kept)

    def halve_buckets(self) -> None:
        """Join every two neighbours."""
        self.bucket_s.replace(np.array(self.bucket_s.values)[::2])
        for each in (self.charge, *self.margins, *self.reaches):
            each.halve()

    def add_target(self, target: TargetEvent) -> None:
        """Add a target that has begun, or the end of one."""
        at = self._target_at.get(target.target_id)
        if not target.outcome:
            row = [target.target_id, rounded_s(target.time_s), None, target.x_m, target.y_m, ""]
            if at is None:
                self._target_at[target.target_id] = len(self.targets.values)
                self.targets.add([row])
            else:
                self.targets.set(at, row)
        elif at is not None:
            row = [*self.targets.values[at]]
            row[2], row[5] = rounded_s(target.time_s), target.outcome
            self.targets.set(at, row)

    def add_goal(self, goal: GoalEvent) -> None:
        """Add a goal that was sent, or the end of one."""
        end_s = self.goals[1]
        if end_s.values and np.isinf(end_s.values[-1]):
            # The next goal supersedes one that has not ended.
            end_s.set(-1, goal.time_s)
        if goal.status == "active":
            values = (goal.time_s, np.inf, goal.x_m, goal.y_m, float(goal.by == AC))
            for column, value in zip(self.goals, values, strict=True):
                column.add([value])

    def add_way(self, way: RecordedWay) -> None:
        """Add a way that the AC intends to drive."""
        self.way_s.add([way.time_s])
        self.way_x_m.add([x for x, _ in way.places])
        self.way_y_m.add([y for _, y in way.places])
        self.way_begin.add([len(self.way_x_m.values)])


class Story:
    """All robots.

    Args:
        pose_ticks: number of ticks of which one pose is kept.
        bucket_ticks: number of ticks gathered in a bucket.

    Attributes:
        drivers: "AC" and the names of the modules.
        robots: the robots' stories, in their order.
        switches: rows of fleet time, robot, driver before and after, module, cause, modules that joined.
        drops: rows of fleet time, first missing tick, and number of missing ticks.
        breaches: rows of robot, assumption, fleet time of the first and last look of a spell, looks, cause, and rows of
            the worst: excess, unit, fleet time and cause.
        stalls: rows of robot, begin, end, module and cause; without an end until it has ended.
    """

    def __init__(self, about: About, workspace: Workspace, pose_ticks: int = 1, bucket_ticks: int = 1) -> None:
        self._about: Final = about
        self._workspace: Final = workspace
        self.drivers: Final = (AC, *about.modules)
        self.robots: Final = [RobotStory(each) for each in about.robots]
        self.switches: Final = Rows()
        self.drops: Final = Rows()
        self.breaches: Final = Rows()
        self.stalls: Final = Rows()
        self.pose_ticks = pose_ticks
        self.bucket_ticks = bucket_ticks
        self._ticks = 0
        self._seen: Final[dict[str, int]] = {}
        self._told: Final[dict[tuple[object, ...], tuple[int, object]]] = {}

    def add(self, content: Content) -> None:
        """Add a content's series, and its events since the last call."""
        count = 0
        if not self._about.modules:
            add_margins(content.series, self._about, self._workspace)
        for robot in self.robots:
            series = content.series[robot.about.robot_id]
            robot.add(series, self._ticks, self.pose_ticks, self.bucket_ticks)
            count = len(series.time_s)
        self._ticks += count
        by_id = {robot.about.robot_id: robot for robot in self.robots}
        for target in self._unseen("targets", content.targets):
            # A task planner may also give targets to robots of other processes.
            if target.robot_id in by_id:
                by_id[target.robot_id].add_target(target)
        for goal in self._unseen("goals", content.goals):
            by_id[goal.robot_id].add_goal(goal)
        for way in self._unseen("ways", content.ways):
            by_id[way.robot_id].add_way(way)
        self.switches.add(self._switch(each) for each in self._unseen("switches", content.switches))
        drops = self._unseen("drops", content.drops)
        self.drops.add([rounded_s(each.time_s), each.first_tick, each.ticks] for each in drops)
        for key, breach in content.breaches.items():
            self._put(self.breaches, key, breach, _breach)
        for stalled, stall in content.stalls.items():
            self._put(self.stalls, stalled, stall, _stall)

    def thin_out(self, most_poses: int, most_buckets: int) -> None:
        """Halve the detail of poses or buckets beyond these limits; see `soter.report.page.extract`."""
        while sum(len(robot.time_s.values) for robot in self.robots) > most_poses:
            self.pose_ticks *= 2
            for robot in self.robots:
                robot.halve_poses()
        while max(len(robot.bucket_s.values) for robot in self.robots) > most_buckets:
            self.bucket_ticks *= 2
            for robot in self.robots:
                robot.halve_buckets()

    def _unseen(self, name: str, events: list[T]) -> list[T]:
        since, self._seen[name] = self._seen.get(name, 0), len(events)
        return events[since:]

    def _put(self, rows: Rows, key: tuple[object, ...], event: T, row: Callable[[T], list[object]]) -> None:
        """Add a row for an event, or replace that of an earlier event with the same key."""
        at, told = self._told.get(key, (len(rows.values), None))
        if told is None:
            rows.add([row(event)])
        elif told is not event:
            rows.set(at, row(event))
        self._told[key] = at, event

    def _switch(self, switch: SwitchEvent) -> list[object]:
        return [
            switch.time_s, switch.robot_id, self.drivers.index(switch.before), self.drivers.index(switch.after),
            switch.module, switch.cause, list(switch.joined),
        ]  # fmt: skip


def _breach(breach: BreachEvent) -> list[object]:
    worst = [[each.excess, each.unit, rounded_s(each.time_s), each.cause] for each in breach.worst]
    return [breach.robot_id, breach.assumption, rounded_s(breach.start_s), rounded_s(breach.last_s), breach.times,
            breach.cause, worst]  # fmt: skip


def _stall(stall: StallEvent) -> list[object]:
    end_s = rounded_s(stall.end_s) if isinstance(stall.end_s, float) else None
    return [stall.robot_id, rounded_s(stall.start_s), end_s, stall.module, stall.cause]


def rounded_s(time_s: float) -> float:
    """Return a time rounded as on a page."""
    return round(time_s, 4)
