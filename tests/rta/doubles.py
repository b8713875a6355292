"""Samples, regions, nodes and actuators that do what a test says."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from soter.rta import (
    Assumed,
    DecisionModule,
    Drivers,
    Node,
    PairBound,
    ReachModel,
    Region,
    RobotSupervisor,
    RTAModule,
    Sample,
    Situation,
    SpeedBound,
    SwitchRecord,
    Timing,
    Topic,
)
from soter.sdk import Controller

TICK_S = 0.05
SPEED = SpeedBound(0.22, 1.0)
PAIR = PairBound(SPEED, SPEED)


class At(NamedTuple):
    """A sample."""

    x_m: float = 0.0
    y_m: float = 0.0
    stamp_s: float = 0.0
    robot_id: int = 1
    heading_rad: float = 0.0
    vx_m_s: float = 0.0
    vy_m_s: float = 0.0
    battery: float | None = 1.0
    z_m: float = 0.0
    vz_m_s: float | None = None


@dataclass(frozen=True)
class Above(Region):
    """Situations with x at least `least_m`."""

    least_m: float = 0.0

    def margin(self, situation: Situation) -> float:
        return situation.own.x_m - self.least_m

    def edge_margin(self, safer: Region) -> float:
        assert isinstance(safer, Above)
        return safer.least_m - self.least_m


class FakeNode(Node):
    """Publishes its name at every step.

    Attributes:
        failing: raise at the next steps.
        engaged: how often it took charge.
        steps: how often it was stepped.
    """

    publishes: tuple[str, ...] = ("waypoint",)

    def __init__(self, name: str, topic: Topic[Any] | None = None, period_s: float = TICK_S) -> None:
        self.name = name
        self.period_s = period_s
        self.topic: Topic[Any] = Topic("waypoint") if topic is None else topic
        self.failing = self.failing_to_engage = False
        self.engaged = 0
        self.steps = 0
        self.silent = False

    def step(self, situation: Situation) -> None:
        self.steps += 1
        if not self.silent:
            self.topic.publish(f"{self.name} {self.steps}")
        if self.failing:
            raise RuntimeError(f"{self.name} failed")

    def engage(self, situation: Situation) -> None:
        self.engaged += 1
        if self.failing_to_engage:
            raise RuntimeError(f"{self.name} failed to engage")


def module(
    name: str = "line",
    *,
    delta_s: float = 0.1,
    phi_safe: Region | None = Above(0.0),
    phi_safer: Region | Callable[[Situation], bool] = Above(0.5),
    ac: Node | None = None,
    sc: Node | None = None,
    **values: Any,
) -> RTAModule:
    """Declare a module that is well-formed unless the test changes that."""
    values.setdefault("model", SPEED)
    return RTAModule(name, ac or FakeNode("ac"), sc or FakeNode("sc"), delta_s, phi_safe, phi_safer, **values)


class FakeActuator:
    """A robot that notes what it is told.

    Attributes:
        sample: what it reads; an exception is raised instead.
        calls: what it was told, in order.
        failing: names of calls that raise.
        report: who is in charge, as the robot itself says.
    """

    def __init__(self, robot_id: int = 1) -> None:
        self.sample: Sample | Exception = At(10.0, robot_id=robot_id)
        self.calls: list[tuple[Any, ...]] = []
        self.failing: set[str] = set()
        self.report: Controller | None = None

    def read(self) -> Sample:
        if isinstance(self.sample, Exception):
            raise self.sample
        return self.sample

    def drive(self, command: Any, mode: Controller) -> None:
        self._note("drive", command, mode)

    def hand_over(self, mode: Controller, module: str, cause: str) -> None:
        self._note("hand_over", mode, module)

    def renew(self) -> None:
        self._note("renew")

    def reported(self, sample: Sample) -> Controller | None:
        return self.report

    def insist(self) -> None:
        self._note("insist")

    def _note(self, *call: Any) -> None:
        self.calls.append(call)
        if call[0] in self.failing:
            raise OSError(f"{call[0]} failed")


class Watcher:
    """Keeps the records of switches; raises if told to."""

    def __init__(self) -> None:
        self.records: list[SwitchRecord] = []
        self.failing = False

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        self.records.append(record)
        if self.failing:
            raise RuntimeError("the watch failed")


class Unspeakable(BaseException):
    """What foreign code may raise at worst: no `Exception`, and nobody can show it."""

    def __repr__(self) -> str:
        raise self

    __str__ = __repr__


class Meddles(Region):
    """Changes what it is given."""

    def margin(self, situation: Situation) -> float:
        situation.own, situation.peers, situation.now_s = At(0.0), (), 0.0
        return 10.0

    def edge_margin(self, safer: Region) -> float:
        return 5.0


class Rule(Region):
    """A rule whose margin the test sets; an exception is raised instead."""

    def __init__(self, value: float | BaseException = 10.0, safer: float = 0.5) -> None:
        self.value = value
        self.safer = safer

    def margin(self, situation: Situation) -> float:
        if isinstance(self.value, BaseException):
            raise self.value
        return self.value

    def edge_margin(self, safer: Region) -> float:
        return self.safer


class Rig:
    """One robot under supervision, with one rule for each name, ticked by hand.

    Attributes:
        rules: by name; set their `value`.
        scs: the safe controllers, by name.
        ac: the advanced controller.
    """

    def __init__(
        self,
        *names: str,
        deltas: Sequence[float] = (),
        timing: Timing | None = None,
        robot_id: int = 1,
        models: Sequence[ReachModel] = (SPEED,),
        heard_within_s: float = math.inf,
    ) -> None:
        self.actuator = FakeActuator(robot_id)
        self.watch = Watcher()
        self.topic: Topic[Any] = Topic("waypoint")
        self.ac = FakeNode("ac", self.topic)
        self.rules = {name: Rule() for name in names}
        self.scs = {name: FakeNode(name, self.topic) for name in names}
        timing = timing or Timing(latency_s=0.05)
        deltas = deltas or [TICK_S] * len(names)
        declared = [
            module(
                name, delta_s=delta_s, phi_safe=self.rules[name], phi_safer=self._safer(name), ac=self.ac,
                sc=self.scs[name], dwell_s=0.0,
            )
            for name, delta_s in zip(names, deltas, strict=True)
        ]  # fmt: skip
        self.modules = {each.name: DecisionModule(each, timing, TICK_S) for each in declared}
        self.robot = RobotSupervisor(
            robot_id, self.actuator,
            Drivers(list(self.modules.values()), self.ac, self.topic, names[-1] if names else ""),
            Assumed(models, timing, heard_within_s), [self.watch],
        )  # fmt: skip
        self.ticks = 0
        self.fresh = True

    def _safer(self, name: str) -> Callable[[Situation], bool]:
        rule = self.rules[name]
        return lambda situation: isinstance(rule.value, float) and rule.value >= rule.safer

    @property
    def now_s(self) -> float:
        return self.ticks * TICK_S

    def driver(self) -> str | None:
        return None if self.robot.driver is None else self.robot.driver.name

    def tick(self, count: int = 1) -> list[tuple[Any, ...]]:
        """Tick; return what the actuator was told at the last tick."""
        for _ in range(count):
            self.actuator.calls.clear()
            sample = self.actuator.sample
            if self.fresh and isinstance(sample, At):
                self.actuator.sample = sample._replace(stamp_s=self.now_s)
            self.robot.sense(self.now_s)
            self.robot.decide(self.ticks)
            self.robot.act()
            self.ticks += 1
        return list(self.actuator.calls)

    def start(self) -> None:
        """Tick until the AC has control."""
        for _ in range(100):
            if self.driver() is None:
                break
            self.tick()
        assert self.driver() is None
        self.tick()
        self.watch.records.clear()

    def names(self) -> list[str]:
        """Return the names of the actuator's calls at the last tick."""
        return [str(call[0]) for call in self.actuator.calls]


def situation(x_m: float = 10.0, now_s: float = 0.0, age_s: float = 0.0, *peers: At) -> Situation:
    """Make a situation of robot 1 at x."""
    made = Situation(1, At(x_m, stamp_s=now_s - age_s), now_s)
    made.peers = peers
    return made


NAN = math.nan
