"""Feeds recorded samples to the decision modules again and compares their decisions, bit for bit.

The modules are rebuilt from the recorded mission, workspace and robots, by the code that a run uses; supervisor,
decision modules and safe controllers are the same. Only the robots are recorded ones: they repeat their samples, and
commands move nothing. So a replay under other settings is open loop: it shows what a module would have decided on the
recorded samples, and not what would have happened.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from soter.clock import VirtualClock
from soter.config import make_mission
from soter.errors import IllFormedModule, option_error
from soter.record.about import capabilities_of
from soter.record.check import Flaw, flaw
from soter.record.content import RecordedTick
from soter.record.messages import AC, PeerEvent, RobotTick, SwitchEvent
from soter.record.reader import BadRecording, Recording
from soter.record.samples import sample_of, switch_of
from soter.replay.recorded import RecordedActuator, RecordedPeer, RecordedRobot
from soter.rta import RobotSupervisor, SwitchRecord
from soter.sdk import Waypoint
from soter.stack.actuator import RobotActuator
from soter.stack.assembly import Others, SafetySide, Study, assemble

CHANGEABLE: Final = ("rta", "battery")
"""The tables of a mission that a replay may change: settings of the modules."""

KEPT: Final = 1000
"""How many differences are kept; all are counted."""

_ANYWHERE: Final = Waypoint(0.0, 0.0)


class Difference(NamedTuple):
    """A value of a robot, such as "collision.margin", that differs at a tick from the recorded one."""

    tick: int
    time_s: float
    robot_id: int
    field: str
    recorded: str
    replayed: str


class Spell(NamedTuple):
    """A time in which a robot's driver differs from the recorded one.

    Attributes:
        start_s: fleet time of the first such tick.
        end_s: fleet time of the first tick after it, or of the last recorded one.
        recorded: the recorded driver.
        replayed: the driver in the replay.
    """

    robot_id: int
    start_s: float
    end_s: float
    recorded: str
    replayed: str


@dataclass(slots=True)
class Replay:
    """The result of a replay.

    Attributes:
        settings: the changed settings; empty for a replay of the run as it was.
        ticks: how many ticks were compared.
        duration_s: fleet time from the first to the end of the last of them.
        truncated: whether the recording was cut off, and only compared up to there.
        gap_s: fleet time of the first gap, beyond which nothing can be compared; None without one.
        flaws: records that were changed after they were written.
        differences: the first differences.
        differing: number of values and switches that differ.
        spells: times in which another driver is active.
        before: recorded disengagements, by module.
        after: disengagements in the replay, by module.
        ill_formed: refusals of modules that a run would not have accepted; only with settings.
    """

    settings: Mapping[str, object] = field(default_factory=dict)
    ticks: int = 0
    duration_s: float = 0.0
    truncated: bool = False
    gap_s: float | None = None
    flaws: list[Flaw] = field(default_factory=list)
    differences: list[Difference] = field(default_factory=list)
    differing: int = 0
    spells: list[Spell] = field(default_factory=list)
    before: Counter[str] = field(default_factory=Counter)
    after: Counter[str] = field(default_factory=Counter)
    ill_formed: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether every value equals the recorded one."""
        return not self.differing and not self.flaws


def replay(recording: Recording, settings: Mapping[str, object] | None = None) -> Replay:
    """Replay a recording.

    `settings` are values that replace the recorded mission's, by dotted key in `CHANGEABLE`.

    Raises:
        ConfigError: a setting is not allowed.
        BadRecording: the recording is damaged, or lacks needed data.
    """
    settings = dict(settings or {})
    for key in settings:
        if key.partition(".")[0] not in CHANGEABLE:
            raise option_error(
                key, f"a replay changes what the modules are told, so only keys below {' and '.join(CHANGEABLE)}"
            )
    found = Replay(settings)
    cast = _Cast(recording, settings, found)
    next_tick = 0
    began_s = ended_s = 0.0
    for tick in recording.ticks():
        if not tick.robots:
            continue
        if tick.tick != next_tick:
            found.gap_s = tick.time_s
            break
        began_s = tick.time_s if tick.tick == 0 else began_s
        next_tick += 1
        found.ticks, ended_s = next_tick, tick.time_s + recording.about.base_tick_s
        found.duration_s = round(ended_s - began_s, 6)
        cast.play(tick)
    found.truncated = recording.truncated
    cast.close(ended_s)
    return found


class _Cast:
    """The rebuilt robots and modules of a replay, and the comparison of their values with the recorded ones."""

    def __init__(self, recording: Recording, settings: Mapping[str, object], found: Replay) -> None:
        about = recording.about
        mission = make_mission(about.mission, about.source or str(recording.path), settings)
        self._found: Final = found
        self._path: Final = recording.path
        self._switches: list[SwitchRecord] = []
        self._actuators: dict[int, RecordedActuator] = {}
        self._spells: dict[int, Spell] = {}
        self._peers: Final = {each.robot_id: RecordedPeer(each.robot_id) for each in about.peers}
        clock = VirtualClock()
        try:
            robots = [RecordedRobot(each, clock) for each in about.robots]
            starts = {each.robot_id: sample_of(each.initial, each.robot_id) for each in about.robots}
            elsewhere = {each.robot_id: capabilities_of(each) for each in about.peers}
        except ValueError as failure:
            raise self._bad(failure) from failure

        def tap(robot_id: int, actuator: RobotActuator) -> RecordedActuator:
            self._actuators[robot_id] = RecordedActuator(actuator, starts[robot_id], obeys=not settings)
            return self._actuators[robot_id]

        def refused(refusal: IllFormedModule) -> None:
            if str(refusal) not in found.ill_formed:
                found.ill_formed.append(str(refusal))

        workspace = recording.workspace()
        try:
            self._safety: Final[SafetySide] = assemble(
                mission, workspace, robots, lambda _: None, [self], tap=tap,
                study=Study(on_ill_formed=refused if settings else None),
                others=Others(tuple(self._peers.values()), elsewhere),
            )  # fmt: skip
        except (ValueError, ArithmeticError) as failure:
            # The recorded promises are impossible.
            raise self._bad(failure) from failure
        if settings:
            for supervisor in self._safety.supervisor.robots.values():
                supervisor.expect_no_obedience()

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        self._switches.append(record)

    def play(self, tick: RecordedTick) -> None:
        """Replay one tick and compare."""
        supervisor, ports = self._safety.supervisor, self._safety.ports
        for event in tick.events:
            if isinstance(event, PeerEvent):
                self._judge(event)
                self._load(self._peers, event)
        for robot_id, record in tick.robots.items():
            self._judge(record)
            self._load(self._actuators, record)
            if record.ac_drove:
                ports[robot_id].goto(_ANYWHERE)
        supervisor.tick(tick.time_s)
        for robot_id, record in tick.robots.items():
            if record.ac_drove:
                # If the AC has no control in the replay, its command was not taken: drop it.
                ports[robot_id].take()
            robot = supervisor.robots[robot_id]
            if record.ac_failure:
                robot.fail_ac(record.ac_failure)
            self._compare(record, robot)
        self._compare_switches(tick)

    def close(self, time_s: float) -> None:
        """End the open spells."""
        for spell in self._spells.values():
            self._found.spells.append(spell._replace(end_s=time_s))
        self._found.spells.sort(key=lambda each: (each.start_s, each.robot_id))

    def _load(self, parts: Mapping[int, Any], record: RobotTick | PeerEvent) -> None:
        try:
            parts[record.robot_id].load(record)
        except (KeyError, ValueError) as failure:
            raise self._bad(failure) from failure

    def _bad(self, failure: Exception) -> BadRecording:
        return BadRecording(f"{self._path}: it cannot be replayed: {failure}")

    def _judge(self, record: RobotTick | PeerEvent) -> None:
        wrong = flaw(record)
        if wrong is not None:
            self._found.flaws.append(wrong)

    def _compare(self, record: RobotTick, robot: RobotSupervisor) -> None:
        differ = self._differ
        driver = AC if robot.driver is None else robot.driver.name
        if record.mode != robot.mode.value:
            differ(record, "mode", record.mode, robot.mode.value)
        if record.driver != driver:
            differ(record, "driver", record.driver, driver)
        self._note_driver(record, driver)
        modules = {module.name: module for module in robot.modules}
        for was in record.modules:
            module = modules.get(was.name)
            if module is None:
                # Switched off by the settings: not a difference.
                continue
            if was.mode != module.mode.value:
                differ(record, f"{was.name}.mode", was.mode, module.mode.value)
            if not _same(was.margin_value, module.margin):
                differ(record, f"{was.name}.margin", repr(was.margin_value), repr(module.margin))
            if not _same(was.reach_value, module.reach):
                differ(record, f"{was.name}.reach", repr(was.reach_value), repr(module.reach))

    def _note_driver(self, record: RobotTick, driver: str) -> None:
        spell = self._spells.get(record.robot_id)
        if spell is not None and (spell.recorded, spell.replayed) != (record.driver, driver):
            self._found.spells.append(spell._replace(end_s=record.time_s))
            del self._spells[record.robot_id]
        if record.robot_id not in self._spells and record.driver != driver:
            self._spells[record.robot_id] = Spell(record.robot_id, record.time_s, math.inf, record.driver, driver)

    def _compare_switches(self, tick: RecordedTick) -> None:
        was = [event for event in tick.events if isinstance(event, SwitchEvent)]
        now = [switch_of(each) for each in self._switches]
        self._switches.clear()
        self._found.before.update(_disengaged(was))
        self._found.after.update(_disengaged(now))
        if was == now:
            return
        for robot_id, record in tick.robots.items():
            mine = [[each for each in switches if each.robot_id == robot_id] for switches in (was, now)]
            if mine[0] != mine[1]:
                self._differ(record, "switches", _said(mine[0]), _said(mine[1]))

    def _differ(self, record: RobotTick, name: str, recorded: str, replayed: str) -> None:
        found = self._found
        found.differing += 1
        if len(found.differences) < KEPT:
            found.differences.append(Difference(record.tick, record.time_s, record.robot_id, name, recorded, replayed))


def _same(one: float, other: float) -> bool:
    if one == other:
        # Bit for bit: zeros have a sign.
        return one != 0.0 or math.copysign(1.0, one) == math.copysign(1.0, other)
    return one != one and other != other


def _disengaged(switches: Sequence[SwitchEvent]) -> list[str]:
    return [each.module for each in switches if each.before == AC and each.after != AC]


def _said(switches: Sequence[SwitchEvent]) -> str:
    return "; ".join(f"{each.before} -> {each.after} by {each.module}: {each.cause}" for each in switches) or "none"
