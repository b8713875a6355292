"""A robot behind a simulated link in virtual time, done right: what a wire adapter does about a bad link."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, NamedTuple, TypeVar

from soter.adapters.pybullet.robot import SimulatedRobot
from soter.clock import VirtualClock
from soter.conformance import Harness
from soter.conformance.find import open_floor
from soter.drive import Drive
from soter.mux import Mux
from soter.sdk import Capabilities, Controller, Fleet, Goal, Link, Robot, RobotSpec, RobotState
from soter_sim import LIMITS, World

M = TypeVar("M")

LATE_S = 0.12
"""How much later a reordered message comes."""


@dataclass
class Faults:
    """What is wrong with a link."""

    cut: bool = False
    delay_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0


class Channel(Generic[M]):
    """One direction of a link."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self.faults = faults
        self._random = random.Random(seed)
        self._flying: list[tuple[float, M]] = []

    def send(self, now_s: float, message: M) -> None:
        faults, draw = self.faults, self._random.random
        if faults.cut or draw() < faults.loss:
            return
        for _ in range(2 if draw() < faults.duplicate else 1):
            late_s = LATE_S if draw() < faults.reorder else 0.0
            self._flying.append((now_s + faults.delay_s + late_s, message))

    def receive(self, now_s: float) -> list[M]:
        """Return what has arrived, earliest first."""
        if self.faults.cut:
            self._flying.clear()
        due = sorted((each for each in self._flying if each[0] <= now_s + 1e-6), key=lambda each: each[0])
        self._flying = [each for each in self._flying if each[0] > now_s + 1e-6]
        return [message for _, message in due]


class Intent(NamedTuple):
    """All that the robot has to know, in every message: nothing hangs on the one before having arrived."""

    number: int
    in_charge: Controller
    goal: Goal | None
    renew: bool


class WireRobot(Robot):
    """Sends intents, numbered; receives samples stamped by the vehicle."""

    declared: ClassVar[Capabilities] = replace(
        SimulatedRobot.declared, in_process=False, latency_s=0.1, sample_age_s=0.1, jitter_s=0.05
    )
    lease_s: ClassVar[float] = SimulatedRobot.declared.lease_s

    def __init__(self, spec: RobotSpec, clock: VirtualClock, world: World) -> None:
        super().__init__(spec, clock)
        self.faults = Faults()
        self.world = world
        self.down: Channel[Intent] = Channel(self.faults, 2 * spec.id)
        self.up: Channel[RobotState] = Channel(self.faults, 2 * spec.id + 1)
        self.wanted = Intent(0, Controller.SC, None, False)
        self.latest: RobotState | None = None
        # The vehicle's side.
        self.index = world.index(spec.id)
        self.mux: Mux[Controller, Goal] = Mux(Controller.SC, self.lease_s)
        self.drive = Drive(LIMITS, world.period_s)
        self.heard = 0

    # --- the vehicle's side ---

    def control(self, now_s: float, x: float, y: float, heading: float, v: float, rate: float) -> tuple[float, float]:
        for intent in self.down.receive(now_s):
            self.take(intent, now_s)
        goal = self.mux.passing(now_s)
        east, north = self.world.engine.velocity(self.index)
        command = self.mux.command
        self.up.send(now_s, RobotState(
            self.id, now_s, now_s, x, y, 0.0, heading, east, north, rate, self.world.bodies.charge[self.index],
            self.mux.in_charge, None if command is None else command.id, Link.UP,
        ))  # fmt: skip
        return self.drive.command(x, y, heading, v, rate, None if goal is None else goal.target)

    def take(self, intent: Intent, now_s: float) -> None:
        if intent.number <= self.heard:
            return
        self.heard = intent.number
        self.mux.switch(intent.in_charge)
        if intent.goal is None:
            self.mux.halt()
        elif self.mux.command is not intent.goal:
            self.mux.give(intent.in_charge, intent.goal, now_s)
        if intent.renew:
            self.mux.renew(now_s)

    # --- SOTER's side ---

    def want(self, *, renew: bool = False, **changes: Goal | Controller | None) -> None:
        self.wanted = self.wanted._replace(number=self.wanted.number + 1, renew=renew, **changes)  # type: ignore[arg-type]
        self.down.send(self.world.now_s, self.wanted)

    def _connect(self, timeout_s: float) -> Capabilities:
        self.world.set_control(self.id, self.control)
        self.clock.sleep_until(self.clock.now() + self.world.period_s)
        return self.declared

    def _send_goto(self, goal: Goal) -> None:
        self.want(goal=goal)

    def _sample(self) -> RobotState | None:
        for sample in self.up.receive(self.clock.now()):
            if self.latest is None or sample.stamp_s > self.latest.stamp_s:
                self.latest = sample
        return self.latest

    def _hand_over(self, to: Controller) -> None:
        self.want(in_charge=to, goal=None)

    def _renew_lease(self) -> None:
        self.want(renew=True)

    def _halt(self) -> None:
        self.want(goal=None)

    def _disconnect(self, timeout_s: float) -> None:
        self.want(goal=None)
        self.clock.sleep_until(self.clock.now() + min(timeout_s, 0.5))


class SimulatedFleet(Fleet):
    """Robots of any class in one world."""

    def __init__(self, kind: type[SimulatedRobot] | type[WireRobot], specs: Sequence[RobotSpec], engine: str) -> None:
        self.world = World(open_floor().with_robots(len(specs)), specs, engine)
        clock = VirtualClock(self.world.advance)
        super().__init__(clock, [kind(spec, clock, self.world) for spec in specs], self.world.truth)

    def _close(self) -> None:
        self.world.close()


class SimulatedHarness(Harness):
    """Opens robots of any class that lives in a simulated world in this process."""

    def __init__(self, kind: type[SimulatedRobot] | type[WireRobot], engine: str = "kinematic") -> None:
        self.name = kind.__name__
        self.kind = kind
        self.engine = engine

    def open(self, robots: int) -> Fleet:
        places = open_floor().robots[:robots]
        specs = [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad) for place in places]
        return SimulatedFleet(self.kind, specs, self.engine)

    def close(self) -> None:
        pass


class WireHarness(SimulatedHarness):
    """The same with every fault of the link."""

    robots: tuple[Robot, ...] = ()

    def open(self, robots: int) -> Fleet:
        fleet = super().open(robots)
        self.robots = fleet.robots
        return fleet

    def _faults(self) -> list[Faults]:
        return [robot.faults for robot in self.robots if isinstance(robot, WireRobot)]

    def cut(self, robot_id: int) -> None:
        self._set(robot_id, True)

    def restore(self, robot_id: int) -> None:
        self._set(robot_id, False)

    def _set(self, robot_id: int, cut: bool) -> None:
        for robot in self.robots:
            if isinstance(robot, WireRobot) and robot.id == robot_id:
                robot.faults.cut = cut

    def delay(self, seconds: float) -> None:
        for faults in self._faults():
            faults.delay_s = seconds

    def loss(self, fraction: float) -> None:
        for faults in self._faults():
            faults.loss = fraction

    def duplicate(self, fraction: float) -> None:
        for faults in self._faults():
            faults.duplicate = fraction

    def reorder(self, fraction: float) -> None:
        for faults in self._faults():
            faults.reorder = fraction
