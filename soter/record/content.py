"""The content of a recording, tick by tick and as arrays for drawing."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from soter.record import messages
from soter.record.attachments import About
from soter.record.messages import AC
from soter.record.tracks import Track


class RecordedWay(NamedTuple):
    """The way that an AC intended to drive at a fleet time: its places, x and y in metres."""

    time_s: float
    robot_id: int
    places: list[tuple[float, float]]


class RecordedTick(NamedTuple):
    """All robots at one tick, and the events since the tick before.

    Attributes:
        tick: number of the tick, from 0.
        time_s: fleet time.
        host_ns: the host's time of day, in nanoseconds since 1970.
        robots: the robots' records, by id.
        events: the events, in the order in which they happened.
        ways: the ways that ACs intended to drive.
    """

    tick: int
    time_s: float
    host_ns: int
    robots: Mapping[int, messages.RobotTick]
    events: tuple[messages.Event, ...]
    ways: tuple[RecordedWay, ...] = ()


@dataclass(slots=True)
class Series(Track):
    """One robot over time; `driver` is an index into `Content.drivers`.

    Attributes:
        heading_rad: counter-clockwise from east.
        margins: margins by module, in the module's unit; values may be infinite or NaN.
        reaches: reach bounds, likewise.
    """

    heading_rad: array[float] = field(default_factory=lambda: array("d"))
    margins: dict[str, array[float]] = field(default_factory=dict)
    reaches: dict[str, array[float]] = field(default_factory=dict)


@dataclass(slots=True)
class Content:
    """All of a recording.

    Attributes:
        drivers: "AC" and the names of the modules; `Series.driver` is an index into this.
        series: each robot over time, by id, in the order of the robots.
        ticks: number of recorded ticks.
        first_s: fleet time of the first tick.
        last_s: fleet time of the last tick.
        robot_ticks: number of ticks of all robots together.
        ac_ticks: number of those in which the AC drove.
        switches: every change of control, in order.
        targets: targets begun and ended.
        goals: goals sent and ended.
        transitions: transitions of the mission's machines.
        faults: injected faults, with growing counts.
        violations: the latest event of each violation in ground truth; one that still lasts has no end.
        breaches: the latest event of each spell of a failed assumption, by robot, assumption and beginning.
        stalls: the latest event of each robot's long time without its AC, by robot and beginning.
        drops: gaps in the recording.
        ways: the ways that ACs intended to drive.
    """

    drivers: tuple[str, ...]
    series: dict[int, Series]
    ticks: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    robot_ticks: int = 0
    ac_ticks: int = 0
    switches: list[messages.SwitchEvent] = field(default_factory=list)
    targets: list[messages.TargetEvent] = field(default_factory=list)
    goals: list[messages.GoalEvent] = field(default_factory=list)
    transitions: list[messages.TransitionEvent] = field(default_factory=list)
    faults: list[messages.FaultEvent] = field(default_factory=list)
    violations: list[messages.ViolationEvent] = field(default_factory=list)
    breaches: dict[tuple[int, str, float], messages.BreachEvent] = field(default_factory=dict)
    stalls: dict[tuple[int, float], messages.StallEvent] = field(default_factory=dict)
    drops: list[messages.DropEvent] = field(default_factory=list)
    ways: list[RecordedWay] = field(default_factory=list)
    _violation_at: dict[tuple[str, tuple[int, ...], float], int] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, about: About) -> Content:
        """Return the empty content of a run that is about to begin."""
        return cls((AC, *about.modules), {robot.robot_id: Series() for robot in about.robots})

    def add(self, tick: RecordedTick, every_ticks: int = 1) -> None:
        """Add a tick with its events; to the series only if its number is a multiple of `every_ticks`."""
        for event in tick.events:
            self._sort_in(event)
        self.ways += tick.ways
        if not tick.robots:
            return
        self.first_s = tick.time_s if self.ticks == 0 else self.first_s
        self.last_s = tick.time_s
        self.ticks += 1
        for robot_id, record in tick.robots.items():
            self.robot_ticks += 1
            self.ac_ticks += record.driver == AC
            if tick.tick % every_ticks == 0:
                _append(self.series[robot_id], record, self.drivers.index(record.driver))

    def forget_series(self) -> None:
        """Empty the series, which grow with every tick; events and counts stay."""
        self.series = {robot_id: Series() for robot_id in self.series}

    @property
    def disengagements(self) -> list[messages.SwitchEvent]:
        """The switches in which an AC lost control."""
        return [switch for switch in self.switches if switch.before == AC and switch.after != AC]

    @property
    def dropped_ticks(self) -> int:
        """How many ticks are missing in the recording."""
        return sum(drop.ticks for drop in self.drops)

    def _sort_in(self, event: messages.Event) -> None:
        match event:
            case messages.PeerEvent():
                pass  # only replays need these; there is one at every tick
            case messages.ViolationEvent():
                # Replaces an earlier event about the same violation.
                key = (event.rule, event.robots, event.start_s)
                at = self._violation_at.setdefault(key, len(self.violations))
                self.violations[at : at + 1] = [event]
            case messages.BreachEvent():
                self.breaches[event.robot_id, event.assumption, event.start_s] = event
            case messages.StallEvent():
                self.stalls[event.robot_id, event.start_s] = event
            case messages.SwitchEvent():
                self.switches.append(event)
            case messages.TargetEvent():
                self.targets.append(event)
            case messages.GoalEvent():
                self.goals.append(event)
            case messages.TransitionEvent():
                self.transitions.append(event)
            case messages.FaultEvent():
                self.faults.append(event)
            case messages.DropEvent():
                self.drops.append(event)


def _append(series: Series, record: messages.RobotTick, driver: int) -> None:
    state = record.state
    battery = None if state.battery is msgspec.UNSET else state.battery
    series.add(record.time_s, state.x_m, state.y_m, battery, driver)
    series.heading_rad.append(state.heading_rad)
    for module in record.modules:
        series.margins.setdefault(module.name, array("d")).append(module.margin_value)
        series.reaches.setdefault(module.name, array("d")).append(module.reach_value)
